"""Motion of a wall that is given in advance, on the host; kernels/walls/motion.py is the device's."""

from dataclasses import dataclass, fields
from math import cos, hypot, inf, pi, sin
from typing import Any, NamedTuple

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.described import described
from warpgrains.base.errors import InputError
from warpgrains.space.geometry import left_of

_TIMES = 17  # at which a wall is placed to find how far it reaches

Vector = tuple[float, float]


class Pose(NamedTuple):
    """Place of a wall: a point x of it is at R(angle) x + shift."""

    angle: float
    """Angle by which the wall has turned [rad]."""
    shift: Vector
    """[m]."""

    def turn(self, vectors: FloatArray) -> FloatArray:
        """Return vectors of the wall's frame, shape (n, 2), in that of the scene."""
        c, s = cos(self.angle), sin(self.angle)
        return vectors @ np.array([[c, s], [-s, c]])

    def place(self, points: FloatArray) -> FloatArray:
        """Return where points of the wall are [m], shape (n, 2)."""
        return self.turn(points) + self.shift

    def to_frame(self, points: FloatArray) -> FloatArray:
        """Return points in the wall's frame [m], shape (n, 2)."""
        return Pose(-self.angle, (0.0, 0.0)).turn(points - self.shift)


@dataclass(frozen=True, kw_only=True, repr=False)
class Motion:
    """Translation, and rotation about a pivot that moves along (kernels/MODEL.md, eq. 26).

    The device and the C reference take it as numbers, by the names of its fields.
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
    from_time: float | None = described(
        "Time at which the wall begins to move from the place that is given [s]; by default the start of the"
        " scene or, in `Simulation.change`, the present.",
        check=checks.number,
        default=None,
    )
    to_time: float | None = described(
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
        """Point about which the wall turns, before it moves [m]."""
        return self.middle if self.pivot is None else self.pivot

    @property
    def starts_at(self) -> float:
        """Time at which the motion begins [s]."""
        return self.from_time or 0.0

    @property
    def stops_at(self) -> float:
        """Time at which the motion ends [s]; inf if never."""
        return inf if self.to_time is None else self.to_time

    @property
    def moves(self) -> bool:
        """True if the wall moves at some time as given in advance."""
        return self.velocity != (0.0, 0.0) or self.angular_velocity != 0.0

    @property
    def motion_numbers(self) -> dict[str, float]:
        """The fields as numbers, vectors by component, equal for walls that move alike; 0 at rest."""
        if not self.moves:
            return dict.fromkeys(MOTION_NUMBERS, 0.0)
        values = {own.name: getattr(self, own.name) for own in fields(Motion)}
        values |= {"from_time": self.starts_at, "to_time": self.stops_at}
        values["pivot"] = self.about if self.angular_velocity else (0.0, 0.0)
        return dict(zip(MOTION_NUMBERS, np.hstack([*values.values()]).tolist(), strict=True))

    def require_motion(self, what: str) -> None:
        """Raise InputError if a value has no effect, or the motion would end before it begins."""
        if self.to_time is not None and self.from_time is not None and self.to_time <= self.from_time:
            raise InputError(
                f"to_time of {what} is {self.to_time} s: it must be later than from_time, {self.from_time} s"
            )
        if self.frequency and not self.moves:
            raise InputError(f"frequency of {what} is {self.frequency} Hz: give the velocity that oscillates")
        if self.phase and not self.frequency:
            raise InputError(f"phase of {what} is {self.phase} rad: give the frequency of the oscillation")

    def progress(self, time: float) -> float:
        """Return how long the wall would have moved at its velocities to be where it is at a time [s]."""
        moved = min(max(time, self.starts_at), self.stops_at) - self.starts_at
        rate = 2.0 * pi * self.frequency
        return (sin(rate * moved + self.phase) - sin(self.phase)) / rate if rate else moved

    def share(self, begin: float, end: float) -> float:
        """Return the part of its velocities at which the wall moves on average from begin to end [s]."""
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
        """Return what points move in the step from begin to end [s], over dt [m/s], shape (n, 2)."""
        share = self.share(begin, end)
        turn = self.angular_velocity * (share * dt)
        arm = points - np.add(self.about, np.multiply(self.velocity, self.progress(begin)))
        along, across = -2.0 * sin(0.5 * turn) ** 2 / dt, sin(turn) / dt
        return share * np.array(self.velocity) + along * arm + across * left_of(arm)

    def from_then(self, time: float) -> dict[str, Any]:
        """Return the fields of the motion that goes on from the place at a time [s], or has ended there."""
        if time >= self.stops_at:
            return AT_REST
        return {"from_time": time, "phase": self.phase + 2.0 * pi * self.frequency * (time - self.starts_at)}

    def times(self, begin: float, end: float) -> FloatArray:
        """Return times from begin to end [s] at which the wall is as far as it gets, and others."""
        found = np.linspace(begin, end, _TIMES)
        if self.frequency:
            turns = (np.arange(-1.0, 4.0) + 0.5 - self.phase % (2.0 * pi) / pi) / (2.0 * self.frequency)
            found = np.append(found, np.clip(max(begin, self.starts_at) + turns, begin, end))
        return found

    def largest_speed(self, distance: float) -> float:
        """Return the largest speed of points within a distance [m] of the pivot [m/s]."""
        return hypot(*self.velocity) + abs(self.angular_velocity) * distance


AT_REST: dict[str, Any] = {own.name: own.default for own in fields(Motion)}
"""The fields of a motion that is none."""
MOTION_NUMBERS = tuple(
    f"{own.name}{axis}"
    for own in fields(Motion)
    for axis in (("_x", "_y") if own.metadata["check"] is checks.vector else ("",))
)
"""Names of `Motion.motion_numbers`."""
