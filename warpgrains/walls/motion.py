"""Prescribed motion of a wall. This is the host's side; kernels/walls/motion.py is the device's."""

from dataclasses import dataclass, fields
from math import cos, hypot, inf, pi, sin
from typing import Any, NamedTuple

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.described import Described, described
from warpgrains.base.errors import InputError
from warpgrains.space.geometry import left_of

_TIMES = 17  # number of times at which a wall is placed to find how far it moves

Vector = tuple[float, float]


class Pose(NamedTuple):
    """Place of a moved wall. A point that was at x before the motion is at R(angle) x + shift."""

    angle: float
    """Angle by which the wall has turned [rad]."""
    shift: Vector
    """Displacement [m]."""

    def turn(self, vectors: FloatArray) -> FloatArray:
        """Rotate vectors, shape (n, 2), from the frame of the wall to that of the scene."""
        c, s = cos(self.angle), sin(self.angle)
        return vectors @ np.array([[c, s], [-s, c]])

    def place(self, points: FloatArray) -> FloatArray:
        """Transform points [m], shape (n, 2), from the frame of the wall to that of the scene."""
        return self.turn(points) + self.shift

    def to_frame(self, points: FloatArray) -> FloatArray:
        """Transform points [m], shape (n, 2), from the frame of the scene to that of the wall."""
        return Pose(-self.angle, (0.0, 0.0)).turn(points - self.shift)


@dataclass(frozen=True, kw_only=True, repr=False)
class Motion(Described):
    """Prescribed motion: a translation, and a rotation about a pivot that moves with the wall (eq. 26).

    The device and the C reference take the motion as numbers, with the names of its fields.
    """

    velocity: tuple[float, float] = described(
        "Velocity at which the wall moves [m/s], two components.", check=checks.vector, default=(0.0, 0.0)
    )
    angular_velocity: float = described(
        "Angular velocity at which the wall turns about the pivot, counterclockwise [rad/s].",
        check=checks.number,
        default=0.0,
    )
    frequency: float = described(
        "Frequency at which the wall oscillates [Hz]: the velocities above are the largest ones, on the way"
        " to and fro. By default it moves on.",
        check=checks.not_negative,
        default=0.0,
    )
    phase: float = described(
        "Phase at which it begins to oscillate [rad]; at 0 it is in the middle of its way, at the largest"
        " velocity.",
        check=checks.number,
        default=0.0,
    )
    pivot: tuple[float, float] | None = described(
        "Point about which the wall turns, which moves with it [m]; by default its middle.",
        check=checks.vector,
        default=None,
    )
    start_time: float | None = described(
        "Time at which the wall begins to move from the place that is given [s]; by default the start of the"
        " scene or, in `Simulation.change`, the present.",
        check=checks.number,
        default=None,
    )
    end_time: float | None = described(
        "Time at which the wall stops [s]; by default it moves until the end.",
        check=checks.number,
        default=None,
    )

    @property
    def middle(self) -> Vector:
        """Point about which the wall turns by default [m]."""
        raise NotImplementedError

    @property
    def about(self) -> Vector:
        """Point about which the wall turns, at its place before the motion [m]."""
        return self.middle if self.pivot is None else self.pivot

    @property
    def starts_at(self) -> float:
        """Time at which the motion begins [s]."""
        return self.start_time or 0.0

    @property
    def stops_at(self) -> float:
        """Time at which the motion ends [s]; inf if it does not end."""
        return inf if self.end_time is None else self.end_time

    @property
    def moves(self) -> bool:
        """True if the wall has a prescribed motion, at any time."""
        return self.velocity != (0.0, 0.0) or self.angular_velocity != 0.0

    @property
    def motion_numbers(self) -> dict[str, float]:
        """The fields as numbers, by name, such as velocity_x. Walls of equal motion have equal numbers.

        They are 0 for a wall at rest.
        """
        if not self.moves:
            return dict.fromkeys(MOTION_NUMBERS, 0.0)
        values = {own.name: getattr(self, own.name) for own in fields(Motion)}
        values |= {"start_time": self.starts_at, "end_time": self.stops_at}
        values["pivot"] = self.about if self.angular_velocity else (0.0, 0.0)
        return dict(zip(MOTION_NUMBERS, np.hstack([*values.values()]).tolist(), strict=True))

    def require_motion(self, what: str) -> None:
        """Raise InputError if the end is not after the start, or a frequency or phase has no effect.

        `what` is the name of the wall in the message.
        """
        if self.end_time is not None and self.start_time is not None and self.end_time <= self.start_time:
            raise InputError(
                f"end_time of {what} is {self.end_time} s: it must be later than start_time,"
                f" {self.start_time} s"
            )
        if self.frequency and not self.moves:
            raise InputError(f"frequency of {what} is {self.frequency} Hz: give the velocity that oscillates")
        if self.phase and not self.frequency:
            raise InputError(f"phase of {what} is {self.phase} rad: give the frequency of the oscillation")

    def progress(self, time: float) -> float:
        """Return xi of eq. 26 [s]: displacement and angle at `time` [s] are xi times the given velocities.

        It is the time since the start of the motion, except if the wall oscillates or has stopped.
        """
        moved = min(max(time, self.starts_at), self.stops_at) - self.starts_at
        rate = 2.0 * pi * self.frequency
        return (sin(rate * moved + self.phase) - sin(self.phase)) / rate if rate else moved

    def share(self, begin: float, end: float) -> float:
        """Return the mean velocity between two times [s] as a fraction of `velocity`, in -1 to 1.

        The mean angular velocity is the same fraction of `angular_velocity`.
        """
        if self.frequency:
            return (self.progress(end) - self.progress(begin)) / (end - begin)
        return max(0.0, min(end, self.stops_at) - max(begin, self.starts_at)) / (end - begin)

    def pose(self, time: float) -> Pose:
        """Return the pose at a time [s]."""
        moved, (x, y) = self.progress(time), self.about
        angle = self.angular_velocity * moved
        c, s = cos(angle), sin(angle)
        shift = (
            x - (c * x - s * y) + self.velocity[0] * moved,
            y - (s * x + c * y) + self.velocity[1] * moved,
        )
        return Pose(angle, shift)

    def velocities(self, points: FloatArray, begin: float, end: float, dt: float) -> FloatArray:
        """Return the displacement of points of the wall between two times [s], over dt [m/s], (n, 2).

        The points [m], shape (n, 2), are at their places at the first time.
        """
        share = self.share(begin, end)
        turn = self.angular_velocity * (share * dt)
        arm = points - np.add(self.about, np.multiply(self.velocity, self.progress(begin)))
        along, across = -2.0 * sin(0.5 * turn) ** 2 / dt, sin(turn) / dt
        return share * np.array(self.velocity) + along * arm + across * left_of(arm)

    def from_then(self, time: float) -> dict[str, Any]:
        """Return the fields with which the motion continues if the wall starts from its place at `time` [s].

        They are those of `AT_REST` if the motion has ended.
        """
        if time >= self.stops_at:
            return AT_REST
        return {"start_time": time, "phase": self.phase + 2.0 * pi * self.frequency * (time - self.starts_at)}

    def times(self, begin: float, end: float) -> FloatArray:
        """Return times between begin and end [s] at which to place a wall, to find how far it moves.

        They are `_TIMES` equidistant times, then the first turning points of an oscillation, clipped to begin
        and end, and so neither sorted nor distinct.
        """
        found = np.linspace(begin, end, _TIMES)
        if self.frequency:
            turns = (np.arange(-1.0, 4.0) + 0.5 - self.phase % (2.0 * pi) / pi) / (2.0 * self.frequency)
            found = np.append(found, np.clip(max(begin, self.starts_at) + turns, begin, end))
        return found

    def largest_speed(self, distance: float) -> float:
        """Return the largest speed of points within a distance [m] of the pivot [m/s]."""
        return hypot(*self.velocity) + abs(self.angular_velocity) * distance


AT_REST: dict[str, Any] = {own.name: own.default for own in fields(Motion)}
"""The fields of a wall at rest."""
MOTION_NUMBERS = tuple(
    f"{own.name}{axis}"
    for own in fields(Motion)
    for axis in (("_x", "_y") if own.metadata["check"] is checks.vector else ("",))
)
"""Names of the numbers in `Motion.motion_numbers`, in their order."""
