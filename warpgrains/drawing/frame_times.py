"""Times of the frames of a recording or film, and positions at these from the states after whole steps."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import ceil
from typing import TYPE_CHECKING

from warpgrains.arrays import FloatArray
from warpgrains.drawing.colors import Frame
from warpgrains.errors import SceneError

if TYPE_CHECKING:
    from warpgrains.solver.forces import PairContacts, WallContacts

_NOTHING = Fraction(1, 10**9)  # of a step


@dataclass(frozen=True)
class FrameTimes:
    """Frames k = 0, 1, 2, ... at the times k / rate, of a scene with steps of dt.

    Both are taken as the decimal numbers a user writes, so that no rounding of a float decides on a step.
    """

    dt: float
    """[s]."""
    rate: float
    """Frames per second of simulated time [1/s], at most one a step."""

    @classmethod
    def of(cls, dt: float, wanted: float) -> FrameTimes:
        """Return those with the wanted rate [1/s], or of one frame a step where steps are longer.

        Raises
        ------
        SceneError
            The rate is not a positive finite number.
        """
        if not 0 < wanted < float("inf"):
            raise SceneError(f"frames per second must be a positive number, not {wanted}")
        return cls(dt, min(float(wanted), float(1 / _as_written(dt))))

    def step(self, k: int) -> int:
        """Return the step at whose end frame k is, or in which it lies."""
        return ceil(k * self._steps_a_frame - _NOTHING)

    def frame(
        self,
        k: int,
        position: FloatArray,
        velocity: FloatArray,
        contacts: PairContacts | None = None,
        wall_contacts: WallContacts | None = None,
        spin: FloatArray | None = None,
        angle: FloatArray | None = None,
    ) -> Frame:
        """Return frame k, made of the state after `step(k)`.

        Within a step, grains move straight on and turn with the velocities after it (eqs. 3, 24): if the
        frame lies within the step, positions and angles are those at its time.
        """
        before = self.step(k) - k * self._steps_a_frame
        if before > _NOTHING:
            position = position - float(before) * self.dt * velocity
            if spin is not None and angle is not None:
                angle = angle - float(before) * self.dt * spin
        return Frame(position, velocity, contacts, wall_contacts, spin, angle)

    @cached_property
    def _steps_a_frame(self) -> Fraction:
        return 1 / (_as_written(self.rate) * _as_written(self.dt))


def _as_written(value: float) -> Fraction:
    return Fraction(repr(float(value)))
