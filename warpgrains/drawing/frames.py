"""Times of the frames of a run."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import ceil, floor

from warpgrains.base.errors import InputError

_TOLERANCE = Fraction(1, 10**9)  # tolerance, in steps


@dataclass(frozen=True)
class FrameTimes:
    """Times of the frames k = 0, 1, 2, ... of a run: frame k is k / rate after its start.

    The time step is dt, and a frame may lie within a step. Rate and dt are taken as the decimal numbers that
    a user writes, so that rounding does not move a frame to another step.
    """

    dt: float
    """Time step [s]."""
    rate: float
    """Frames per second of simulated time [1/s], at most one per step."""
    first_step: int = 0
    """Number of time steps of the simulation before the run."""
    start: float = 0.0
    """Time at the start of the simulation [s]."""
    slow: float = 1.0
    """Factor by which the run plays slower than it happened."""

    @classmethod
    def of(
        cls, dt: float, wanted: float, first_step: int = 0, start: float = 0.0, slow: float = 1.0
    ) -> FrameTimes:
        """Return the times for `wanted` frames per second of playing time [1/s], but at most one per step."""
        if not 0 < wanted < float("inf"):
            raise InputError(f"frames per second is {wanted}: it must be greater than 0")
        rate = float(_as_written(wanted) * _as_written(slow))
        return cls(dt, min(rate, float(1 / _as_written(dt))), first_step, start, slow)

    @property
    def played(self) -> float:
        """Frames per second of playing time [1/s]: `rate` divided by `slow`."""
        return float(_as_written(self.rate) / _as_written(self.slow))

    def step(self, k: int) -> int:
        """Return the step within which, or at whose end, frame k lies.

        Steps of the run count from 1. The result is 0 for k = 0, which is before all steps.
        """
        return ceil(k * self._steps_a_frame - _TOLERANCE)

    def simulated_step(self, k: int) -> int:
        """Return `step(k)` counted from the start of the simulation."""
        return self.first_step + self.step(k)

    def count(self, steps: int) -> int:
        """Return the number of frames within the first `steps` steps of a run, including frame 0."""
        return floor((steps + _TOLERANCE) / self._steps_a_frame) + 1

    @property
    def begin(self) -> float:
        """The simulated time of the first frame [s]."""
        return self.start + self.first_step * self.dt

    def time(self, k: int) -> float:
        """Return the simulated time of frame k [s]."""
        return self.start + self.simulated_step(k) * self.dt - self.left(k)

    def left(self, k: int) -> float:
        """Return the time from frame k to the end of the step in which it lies, `step(k)` [s]."""
        left = self.step(k) - k * self._steps_a_frame
        return float(left) * self.dt if left > _TOLERANCE else 0.0

    @cached_property
    def _steps_a_frame(self) -> Fraction:
        return 1 / (_as_written(self.rate) * _as_written(self.dt))


def _as_written(value: float) -> Fraction:
    return Fraction(repr(float(value)))
