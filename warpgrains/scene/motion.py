"""Motion of a wall that is given in advance. This is the host's side; kernels/motion.py is the device's."""

from math import cos, hypot, sin
from typing import NamedTuple

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.scene.geometry import left_of

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


class Motion(NamedTuple):
    """Translation, and rotation about a pivot that moves along (kernels/MODEL.md, eq. 26)."""

    pivot: Vector
    """Where the pivot is before the motion [m]."""
    velocity: Vector
    """[m/s]."""
    angular_velocity: float
    """[rad/s]."""
    from_time: float
    """Time at which the motion begins [s]."""
    to_time: float
    """Time at which the motion ends [s]; inf if never."""

    def duration(self, time: float) -> float:
        """Return for how long the wall has moved at a time [s]."""
        return min(max(time, self.from_time), self.to_time) - self.from_time

    def pose(self, time: float) -> Pose:
        """Return the pose at a time [s]."""
        moved, (x, y) = self.duration(time), self.pivot
        angle = self.angular_velocity * moved
        c, s = cos(angle), sin(angle)
        shift = (
            x - (c * x - s * y) + self.velocity[0] * moved,
            y - (s * x + c * y) + self.velocity[1] * moved,
        )
        return Pose(angle, shift)

    def share(self, begin: float, end: float) -> float:
        """Return the part of the time from begin to end [s] in which the wall moves."""
        return max(0.0, min(end, self.to_time) - max(begin, self.from_time)) / (end - begin)

    def velocities(self, points: FloatArray, begin: float, end: float, dt: float) -> FloatArray:
        """Return what points move in the step from begin to end [s], over dt [m/s], shape (n, 2)."""
        share = self.share(begin, end)
        turn = self.angular_velocity * (share * dt)
        arm = points - np.add(self.pivot, np.multiply(self.velocity, self.duration(begin)))
        along, across = -2.0 * sin(0.5 * turn) ** 2 / dt, sin(turn) / dt
        return share * np.array(self.velocity) + along * arm + across * left_of(arm)

    def largest_speed(self, distance: float) -> float:
        """Return the largest speed of points within a distance [m] of the pivot [m/s]."""
        return hypot(*self.velocity) + abs(self.angular_velocity) * distance
