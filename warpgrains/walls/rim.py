"""A circle of an annulus. On the device, kernels/walls/annulus.py has both circles."""

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from warpgrains.base.arrays import BoolArray, FloatArray
from warpgrains.space.geometry import Side, directions, distance
from warpgrains.walls.disc import Disc
from warpgrains.walls.wall import Drive


@dataclass(frozen=True, repr=False)
class Rim(Disc):
    """The outer or the inner circle of an annulus, about the origin. It can rotate in place."""

    kind: ClassVar[str] = "rim"
    takes_joints: ClassVar[bool] = False
    rotation: float = 0.0
    """Angular velocity [rad/s]."""
    is_round: bool = False
    """Whether the wall within a step is the circle itself; else it is the tangent at each grain."""
    pressure: float | None = None
    """Pressure that drives the outer circle outwards [N/m]."""
    mass: float | None = None
    """Mass of a circle that a pressure drives [kg]."""

    def __str__(self) -> str:
        which, key = ("outer", "radius_out") if self.inside else ("inner", "radius_in")
        return f"the {which} wall, {key} {self.radius} m"

    def named(self, number: int) -> str:
        return "Outer" if self.inside else "Inner"

    @property
    def surface_speed(self) -> float:
        return self.radius * self.rotation if self.inside else -self.radius * self.rotation

    @property
    def drive(self) -> Drive | None:
        if self.pressure is None or self.mass is None:
            return None
        return Drive(1.0 / self.mass, pressure=self.pressure)

    @property
    def coordinate(self) -> float:
        return self.radius if self.inside else 0.0

    def driven_to(self, coordinate: float, direction: tuple[float, float]) -> Self:
        return self.changed({"radius": coordinate})

    def covers(self, position: FloatArray) -> BoolArray:
        rho = distance(position)
        return rho > self.radius if self.inside else rho < self.radius

    def complaint(self, number: int) -> str:
        return f"it is {'outside' if self.inside else 'inside'} {self}"

    def side(self, position: FloatArray, radius: FloatArray, move: FloatArray | None = None) -> Side:
        rho, normal = distance(position), directions(position)
        if not self.inside:
            return Side(-normal, rho - self.radius - radius)
        gap = self.radius - rho - radius
        if move is not None and self.is_round:
            path_radius = self.radius - radius
            path = normal[:, 0] * move[:, 1] - normal[:, 1] * move[:, 0]
            gap = gap - (path_radius - np.sqrt(np.maximum(0.0, path_radius**2 - path**2)))
        return Side(normal, gap)
