"""The last steps of scenes, of which a report is made when it is read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from warpgrains.base.arrays import FloatArray, IndexArray, IntArray
from warpgrains.base.errors import SimulationError
from warpgrains.kernels.record import StepState, StepSums
from warpgrains.solver.statistics import StepReport, Summary, Sums

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

STEP = tuple(StepState.vars)  # names of its fields
SUMS = tuple(StepSums.vars)
REPORTED = ("iterations", "zeta", "residual", "overlap", "rebuilds", "restarts", "factorizations")

ARRAYS = ("step", "sums", "listed", "left", "seconds")


class LastSteps(NamedTuple):
    """The last steps of the scenes of an engine. Every array has shape (scenes,)."""

    scenes: Sequence[Scene]
    step: np.ndarray[Any, Any]
    """Records of their last steps (kernels/record.py)."""
    sums: np.ndarray[Any, Any]
    """Sums and maxima over the steps."""
    listed: np.ndarray[Any, Any]
    """Numbers of listed contacts."""
    left: IntArray
    """Steps that were not done."""
    seconds: FloatArray
    """Time that the steps took [s]."""
    errors: dict[int, SimulationError]
    """Reasons why scenes stopped early."""

    @classmethod
    def joined(cls, parts: Sequence[tuple[Self, IndexArray]]) -> Self:
        """Return a copy of the last steps of several engines, by the numbers of the scenes of each."""
        order = np.argsort(np.concatenate([numbers for _, numbers in parts]))
        scenes = [scene for last, _ in parts for scene in last.scenes]
        own: dict[str, Any] = {
            name: np.concatenate([getattr(last, name) for last, _ in parts])[order] for name in ARRAYS
        }
        errors = {numbers[k].item(): error for last, numbers in parts for k, error in last.errors.items()}
        return cls([scenes[k] for k in order], errors=dict(sorted(errors.items())), **own)

    def report(self, k: int) -> StepReport:
        """Return the report of the last step of scene k."""
        step = dict(zip(STEP, self.step[k].tolist(), strict=True))
        return StepReport(
            **{name: step[name] for name in REPORTED},
            gap_error=self._gap_error(k, step["residual"]),
            converged=bool(step["converged"]),
            contacts=step["active"],
            candidates=int(self.listed[k]["pairs"] + self.listed[k]["walls"]),
        )

    def summary(self, k: int) -> Summary:
        """Return the summary of the steps of scene k."""
        sums = dict(zip(SUMS, self.sums[k].tolist(), strict=True))
        error = str(self.errors[k]) if k in self.errors else None
        return Summary(
            **sums,
            gap_error=self._gap_error(k, sums["residual"]),
            seconds=self.seconds[k].item(),
            error=error,
        )

    def stacked(self, which: Sequence[int]) -> Sums:
        """Return the sums and maxima of scenes as arrays by name, as `statistics.stacked` does."""
        sums = {name: self.sums[name][which] for name in SUMS}
        return {**sums, "seconds": self.seconds[which], "met": np.zeros(len(which), bool)}

    def _gap_error(self, k: int, residual: float) -> float:
        """Return dt * residual in units of the smallest radius."""
        return self.scenes[k].dt * residual / self.scenes[k].smallest_radius
