"""The annulus: an outer circle about the origin and, optionally, an inner circle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Self

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import InputError
from warpgrains.space.geometry import NOWHERE, ROUNDING, Period
from warpgrains.walls.boundary import Boundary
from warpgrains.walls.rim import Rim
from warpgrains.walls.wall import Wall

WALLS = ("tangent", "round")


@dataclass(frozen=True)
class Annulus(Boundary):
    """The space between two circles about the origin, with its keys in scene files as fields."""

    radius_in: float
    """Radius of the inner wall [m]; 0 if there is none."""
    radius_out: float
    """Radius of the outer wall [m]."""
    wall: str = "tangent"
    """Model of the outer wall within a step: its "tangent", or "round"."""
    pressure: float | None = None
    """Pressure on the outer wall [N/m]; None if the wall is fixed."""
    wall_mass: float | None = None
    """Mass of the outer wall [kg], only with a pressure."""
    angular_velocity_out: float = 0.0
    """Angular velocity of the outer wall [rad/s]."""
    angular_velocity_in: float = 0.0
    """Angular velocity of the inner wall [rad/s]."""

    def checked(self) -> Self:
        """Check radii and `wall` and return a copy; raise InputError unless 0 <= radius_in < radius_out."""
        annulus = replace(
            self,
            radius_in=checks.not_negative("radius_in", self.radius_in),
            radius_out=checks.positive("radius_out", self.radius_out),
            wall=checks.one_of("wall", self.wall, WALLS),
        )
        if annulus.radius_in >= annulus.radius_out:
            raise InputError(
                f"radius_in is {annulus.radius_in} m: it must be less than radius_out, {annulus.radius_out} m"
            )
        return annulus

    def __str__(self) -> str:
        return f"{f'{self.radius_in:g} to ' if self.radius_in > 0.0 else ''}{self.radius_out:g} m"

    @property
    def size(self) -> str:
        return f"radius_out is {self.radius_out} m"

    @property
    def walls(self) -> tuple[Rim, ...]:
        """The outer wall and, if radius_in > 0, the inner wall."""
        return _walls_of(self)

    def owns(self, wall: Wall) -> bool:
        return isinstance(wall, Rim)

    def among(self, walls: Sequence[Wall]) -> tuple[Wall, ...]:
        return *(wall for wall in walls if not self.owns(wall)), *self.walls

    def continuing(self, before: Boundary, walls: Sequence[Wall], time: float) -> tuple[Rim, ...]:
        return self.walls

    @property
    def period(self) -> Period:
        return NOWHERE

    @property
    def reach(self) -> float:
        return self.radius_out

    @property
    def widest(self) -> float:
        return 2.0 * self.radius_out

    def require_fits(self, radius: FloatArray) -> None:
        largest = (self.radius_out - self.radius_in) / 2.0 if self.radius_in > 0.0 else self.radius_out
        too_large = radius > largest * (1.0 + ROUNDING)
        if too_large.any():
            grain = checks.first_bad("radius", radius, too_large)
            raise InputError(f"{grain}: at most {largest} m fit between the walls")


KEYS = tuple(own.name for own in fields(Annulus))
"""The keys of an annulus. They are fields of a scene, too."""


@lru_cache(64)  # thousands of scenes of a sweep have few annuli
def _walls_of(annulus: Annulus) -> tuple[Rim, ...]:
    outer = Rim(
        (0.0, 0.0),
        annulus.radius_out,
        inside=True,
        rotation=annulus.angular_velocity_out,
        is_round=annulus.wall == "round",
        pressure=annulus.pressure,
        mass=annulus.wall_mass,
    )
    if annulus.radius_in == 0.0:
        return (outer,)
    return outer, Rim((0.0, 0.0), annulus.radius_in, rotation=annulus.angular_velocity_in)
