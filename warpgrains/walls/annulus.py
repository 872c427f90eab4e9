"""The annulus: an outer circle about the origin and, optionally, an inner circle."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import InputError
from warpgrains.space.geometry import NOWHERE, ROUNDING, Period
from warpgrains.space.region import Region
from warpgrains.walls.container import space_of
from warpgrains.walls.rim import Rim
from warpgrains.walls.wall import Wall

WALLS = ("tangent", "round")


@dataclass(frozen=True)
class Annulus:
    """The keys of `[domain]` for the space between two circles about the origin.

    Both circles are walls of the scene, the last ones in `Scene.walls`. A `Box` has the same methods.
    """

    radius_in: float
    """Radius of the inner wall [m]; 0 if there is none."""
    radius_out: float
    """Radius of the outer wall [m]."""
    wall: str = "tangent"
    """Outer wall within a step: "tangent", its tangent at each grain, or "round", the circle (eq. 18)."""
    pressure: float | None = None
    """Pressure on the outer wall [N/m]; None if the wall is fixed."""
    wall_mass: float | None = None
    """Mass of the outer wall [kg], only with a pressure."""
    angular_velocity_out: float = 0.0
    """Angular velocity of the outer wall [rad/s]."""
    angular_velocity_in: float = 0.0
    """Angular velocity of the inner wall [rad/s]."""

    def __post_init__(self) -> None:
        if self.radius_in >= self.radius_out:
            raise InputError(
                f"radius_in is {self.radius_in} m: it must be less than radius_out, {self.radius_out} m"
            )

    def __str__(self) -> str:
        return f"{f'{self.radius_in:g} to ' if self.radius_in > 0.0 else ''}{self.radius_out:g} m"

    @property
    def size(self) -> str:
        """Text that describes the size of the annulus. Error messages begin with it."""
        return f"radius_out is {self.radius_out} m"

    @property
    def walls(self) -> tuple[Rim, ...]:
        """The outer wall and, if radius_in > 0, the inner wall."""
        return _walls_of(self)

    def completed(self, walls: tuple[Wall, ...]) -> tuple[Wall, ...]:
        """Return `walls`, followed by those of the annulus."""
        return walls + self.walls

    @property
    def period(self) -> Period:
        """The periodic cell, here `NOWHERE`, because an annulus has no period."""
        return NOWHERE

    @property
    def space(self) -> Region:
        """The space between the circles."""
        return space_of(tuple(self.walls), NOWHERE, self.reach)

    @property
    def reach(self) -> float:
        """Upper bound of the distance of positions from the origin [m], the scale of rounding errors."""
        return self.radius_out

    @property
    def widest(self) -> float:
        """Diameter of the annulus [m]."""
        return 2.0 * self.radius_out

    def require_fits(self, radius: FloatArray) -> None:
        """Raise InputError if a grain is too large for the annulus; radii [m], shape (n,)."""
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
