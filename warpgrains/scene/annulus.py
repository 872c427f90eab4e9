"""Walls of a scene on the host: an annulus about the origin, and others inside it (wall.py).

Wall 0 is the outer circle, wall 1 the inner one (the number is reserved even if there is none), and walls
2, 3, ... are those of `Scene.walls`. Where a contact names two bodies, wall w is the negative number -1 - w.
"""

from typing import Any, NamedTuple, Self

import numpy as np

from warpgrains.arrays import BoolArray, FloatArray
from warpgrains.errors import InputError
from warpgrains.scene import checks
from warpgrains.scene.geometry import ROUNDING, Circle, area_below, directions, distance

SMALLEST, LARGEST = 1e-140, 1e150  # m, of the radius of the outer wall
MOST_RADII = 1e12  # radius of the outer wall, in smallest grain radii; beyond it doubles cannot resolve a gap
WALLS = ("tangent", "round")
NO_WALL = "none"  # of the circle about a box
OUTER, INNER, INSIDE = 0, 1, 2
"""Numbers of the circles of the annulus, and of the first wall inside."""


class Side(NamedTuple):
    """Normals and gaps of grains at one wall."""

    normal: FloatArray
    """Unit vectors into the wall, shape (n, 2)."""
    gap: FloatArray
    """Gaps [m], shape (n,)."""

    @classmethod
    def at(cls, point: FloatArray, position: FloatArray, radius: FloatArray) -> Self:
        """Return the side of a wall whose nearest points to grains are given [m], shape (n, 2)."""
        away = point - position
        return cls(directions(away), distance(away) - radius)

    def without_normal(self, path: float = 0.0) -> BoolArray:
        """Return which grains are where a wall within a path [m] has no normal, shape (n,)."""
        return (distance(self.normal) == 0.0) & ~(self.gap > path)


class Annulus(NamedTuple):
    """The space between two circles about the origin."""

    radius_in: float
    """Radius of the inner wall [m]; 0 if there is none."""
    radius_out: float
    """Radius of the outer wall [m]."""
    wall: str = "tangent"
    """Model of the outer wall within a step: its "tangent", or "round"; "none" if no grain touches it."""

    @classmethod
    def checked(cls, radius_in: Any, radius_out: Any, wall: Any = "tangent") -> Self:
        """Return the annulus of these values; raise InputError unless 0 <= radius_in < radius_out."""
        annulus = cls(
            checks.not_negative("radius_in", radius_in),
            checks.positive("radius_out", radius_out),
            checks.one_of("wall", wall, WALLS),
        )
        if annulus.radius_in >= annulus.radius_out:
            raise InputError(
                f"radius_in is {annulus.radius_in} m: it must be less than radius_out, {annulus.radius_out} m"
            )
        return annulus

    @property
    def largest_radius(self) -> float:
        """Radius of the largest grain that fits between the circles [m]."""
        return (self.radius_out - self.radius_in) / 2.0 if self.radius_in > 0.0 else self.radius_out

    @property
    def diameter(self) -> float:
        """Largest distance between two points of the annulus [m]."""
        return 2.0 * self.radius_out

    @property
    def borders(self) -> tuple[Circle, Circle]:
        """The circles, by number; the inner one has the radius 0 if there is none."""
        return Circle(0.0, 0.0, self.radius_out, True), Circle(0.0, 0.0, self.radius_in, False)

    def without_layer(self, depth: Any) -> Self:
        """Return the space without a layer of a depth [m] along each circle."""
        inner = self.radius_in + depth if self.radius_in > 0.0 else 0.0
        return self._replace(radius_in=inner, radius_out=self.radius_out - depth)

    @property
    def area(self) -> float:
        """Area between the circles [m2]."""
        return float(np.pi) * (self.radius_out**2 - self.radius_in**2)

    @property
    def rounding(self) -> float:
        """Overlap below which a contact is not counted as overlapping [m]."""
        return ROUNDING * self.radius_out

    def side(
        self, number: int, position: FloatArray, radius: FloatArray, move: FloatArray | None = None
    ) -> Side:
        """Return normals and gaps at a circle, see `Scene.side`; those at a missing one are inf."""
        rho, normal = distance(position), directions(position)
        if self.wall == NO_WALL or (number == INNER and self.radius_in == 0.0):
            return Side(normal, np.full_like(rho, np.inf))
        if number == INNER:
            return Side(-normal, rho - self.radius_in - radius)
        gap = self.radius_out - rho - radius
        if move is not None and self.wall == "round":
            path_radius = self.radius_out - radius
            path = normal[:, 0] * move[:, 1] - normal[:, 1] * move[:, 0]
            gap = gap - (path_radius - np.sqrt(np.maximum(0.0, path_radius**2 - path**2)))
        return Side(normal, gap)

    def contains(self, position: FloatArray, radius: FloatArray) -> BoolArray:
        """Return which discs lie between the walls."""
        rho, reached = distance(position), self.without_layer(radius)
        return (rho <= reached.radius_out) & (rho >= reached.radius_in)

    def require_size(self) -> None:
        """Raise InputError unless squares of distances neither overflow nor underflow."""
        if not SMALLEST <= self.radius_out <= LARGEST:
            raise InputError(
                f"radius_out is {self.radius_out} m: it must be between {SMALLEST:g} and {LARGEST:g} m,"
                " for squares of distances to be finite and not zero; choose another unit of length"
            )

    def require_inside(self, position: FloatArray, radius: FloatArray) -> None:
        """Raise InputError unless all grains fit between the walls and have their centers there."""
        rho = distance(position)
        too_large = radius > self.largest_radius * (1.0 + ROUNDING)
        if too_large.any():
            grain = checks.first_bad("radius", radius, too_large)
            raise InputError(f"{grain}: at most {self.largest_radius} m fit between the walls")
        demands = (
            (rho > self.radius_out, f"it is outside the outer wall, radius_out {self.radius_out} m"),
            (rho < self.radius_in, f"it is inside the inner wall, radius_in {self.radius_in} m"),
        )
        for bad, reason in demands:
            if bad.any():
                raise InputError(f"{checks.first_bad('position', position, bad)}: {reason}")

    def area_below(self, level: FloatArray | float) -> FloatArray:
        """Return the area of the annulus [m2] below levels [m] measured from the origin, shape (...)."""
        outer, inner = (area_below(np.array(r), np.array(level)) for r in (self.radius_out, self.radius_in))
        return outer - inner
