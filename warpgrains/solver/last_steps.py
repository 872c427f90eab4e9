"""The results of the last steps of scenes, from which reports and summaries are made on request."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from warpgrains.base.arrays import FloatArray, IndexArray, IntArray
from warpgrains.base.errors import SimulationError
from warpgrains.kernels.record import StepState, StepSums
from warpgrains.solver.statistics import StepReport, Summary

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

STEP = tuple(StepState.vars)  # names of its fields
SUMS = tuple(StepSums.vars)
REPORTED = ("iterations", "zeta", "residual", "overlap", "rebuilds", "restarts", "factorizations")

ARRAYS = ("step", "sums", "listed", "left", "seconds")


class LastSteps(NamedTuple):
    """Results of the steps since `Engine.submit`. Every array has shape (scenes,)."""

    scenes: Sequence[Scene]
    step: np.ndarray[Any, Any]
    """`StepState` of the last step that each scene has done (kernels/record.py)."""
    sums: np.ndarray[Any, Any]
    """`StepSums`: sums and maxima over the steps of each scene."""
    listed: np.ndarray[Any, Any]
    """`ContactCount` of each scene: numbers of listed contacts."""
    left: IntArray
    """Number of submitted steps that were not done."""
    seconds: FloatArray
    """Time that the steps took [s]."""
    errors: dict[int, SimulationError]
    """Errors of the scenes that stopped early, by index of the scene."""

    @classmethod
    def joined(cls, parts: Sequence[tuple[Self, IndexArray]]) -> Self:
        """Return a copy that joins the results of several engines, given with the indices of their scenes."""
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

    def _gap_error(self, k: int, residual: float) -> float:
        """Return dt * residual in units of the smallest radius."""
        return self.scenes[k].dt * residual / self.scenes[k].smallest_radius
