"""Gravity that turns (kernels/MODEL.md, eq. 31). This is the host's side; the device's is kernels/law.py."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, sin
from typing import Any

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import BoolArray, FloatArray
from warpgrains.base.errors import InputError

Vector = tuple[float, float]

EARTH: Vector = (0.0, -9.81)
"""Default acceleration of gravity [m/s2]."""


@dataclass(frozen=True)
class TurningGravity(Sequence[float]):
    """Gravity that turns at a constant rate. As a sequence, it holds the two components at time 0 [m/s2]."""

    vector: Vector
    """Acceleration of gravity at time 0 [m/s2]."""
    angular_velocity: float
    """Angular velocity at which it turns, counterclockwise [rad/s]."""

    def __len__(self) -> int:
        return len(self.vector)

    def __getitem__(self, index: Any) -> Any:
        return self.vector[index]

    @property
    def table(self) -> dict[str, Any]:
        """Keys and values of the table `gravity` in a scene file."""
        return {"vector": list(self.vector), "angular_velocity": self.angular_velocity}

    def at(self, time: float) -> Vector:
        """Return the acceleration at a time [s]."""
        (x, y), angle = self.vector, self.angular_velocity * time
        c, s = cos(angle), sin(angle)
        return c * x - s * y, s * x + c * y


def checked_gravity(field: str, value: Any) -> Vector | TurningGravity:
    """Check gravity: return two components [m/s2], or a TurningGravity for a table with a nonzero rate."""
    if isinstance(value, TurningGravity):
        value = value.table
    if not isinstance(value, Mapping):
        return checks.vector(field, value)
    for key in value:
        checks.one_of(f"{field} key", key, ("vector", "angular_velocity"))
    if "angular_velocity" not in value:
        raise InputError(f"{field}.angular_velocity is missing: give the angular velocity of gravity [rad/s]")
    vector = checks.vector(f"{field}.vector", value.get("vector", EARTH))
    angular_velocity = checks.number(f"{field}.angular_velocity", value["angular_velocity"])
    return TurningGravity(vector, angular_velocity) if angular_velocity else vector


def upwards(gravity: FloatArray, repeats: BoolArray) -> FloatArray:
    """Return the unit vectors against `gravity`, without their components along periods, shape (..., 2).

    `repeats` are the directions with a period. If no component of gravity is left, the vector is (0, 1), or
    (1, 0) with a period only along y.
    """
    g = np.where(repeats, 0.0, gravity)
    sideways = repeats[..., 1:] & ~repeats[..., :1]
    up = np.where(sideways, (1.0, 0.0), (0.0, 1.0))
    size = np.hypot(g[..., :1], g[..., 1:])
    return np.divide(-g, size, out=up, where=size > 0.0)
