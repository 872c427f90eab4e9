"""Times of the frames of a recording or film, and the positions at these times from the states of steps."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import ceil
from typing import TYPE_CHECKING

from warpgrains.arrays import FloatArray
from warpgrains.drawing.colors import Frame
from warpgrains.errors import InputError

if TYPE_CHECKING:
    from warpgrains.solver.forces import PairContacts, WallContacts

_TOLERANCE = Fraction(1, 10**9)  # tolerance, in steps


@dataclass(frozen=True)
class FrameTimes:
    """Frames k = 0, 1, 2, ... at times k / rate, for a scene with time step dt.

    Both numbers are taken as the decimals that a user writes, so that rounding does not shift a frame to
    another step.
    """

    dt: float
    """Time step [s]."""
    rate: float
    """Frames per second of simulated time [1/s], at most one per step."""

    @classmethod
    def of(cls, dt: float, wanted: float) -> FrameTimes:
        """Return frame times with the requested rate [1/s], or one frame per step if steps are longer.

        Raises
        ------
        InputError
            The rate is not a positive finite number.
        """
        if not 0 < wanted < float("inf"):
            raise InputError(f"frames per second is {wanted}: it must be greater than 0")
        return cls(dt, min(float(wanted), float(1 / _as_written(dt))))

    def step(self, k: int) -> int:
        """Return the step in which frame k lies, or at whose end it is."""
        return ceil(k * self._steps_a_frame - _TOLERANCE)

    def frame(
        self,
        k: int,
        position: FloatArray,
        velocity: FloatArray,
        contacts: PairContacts | None = None,
        wall_contacts: WallContacts | None = None,
        spin: FloatArray | None = None,
        angle: FloatArray | None = None,
        time: float | None = None,
        driven: FloatArray | None = None,
    ) -> Frame:
        """Return frame k from the state after `step(k)`, at a time [s] unless the run began with frame 0.

        Within a step, grains move in a straight line and turn with the velocities at its end (eqs. 3, 24).
        The positions and angles are those at the time of the frame, and so are the coordinates of walls, from
        `State.driven`.
        """
        before = self.step(k) - k * self._steps_a_frame
        if before > _TOLERANCE:
            position = position - float(before) * self.dt * velocity
            if spin is not None and angle is not None:
                angle = angle - float(before) * self.dt * spin
        places = None if driven is None else driven[:, 0] - float(before) * self.dt * driven[:, 1]
        end = self.step(k) * self.dt if time is None else time
        time = end - float(before) * self.dt
        return Frame(position, velocity, contacts, wall_contacts, spin, angle, time, places)

    @cached_property
    def _steps_a_frame(self) -> Fraction:
        return 1 / (_as_written(self.rate) * _as_written(self.dt))


def _as_written(value: float) -> Fraction:
    return Fraction(repr(float(value)))
