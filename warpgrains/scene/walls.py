"""The walls of a scene, as the host sees them: an annulus about the origin, and what stands inside it.

Walls are numbered: 0 is the outer circle, 1 the inner one, whether there is one or not, and 2, 3, ... are
those of `Scene.walls`. The device has the annulus as one body with two sides, and then the others
(kernels/walls.py); with friction, the inner circle is a body too, a disc at the origin
(`Scene.has_two_circles`). Where a contact names two bodies, a wall is the negative number -1 - wall.
"""

from typing import Any, NamedTuple, Self

import numpy as np

from warpgrains.arrays import BoolArray, FloatArray, IntArray
from warpgrains.errors import SceneError
from warpgrains.scene import checks
from warpgrains.scene.geometry import ROUNDING, area_below, distance

SMALLEST, LARGEST = 1e-140, 1e150  # m, of the radius of the outer wall
WALLS = ("tangent", "round")


OUTER, INNER = 0, 1
"""Numbers of the circles of the annulus."""


class Side(NamedTuple):
    """One wall, as each grain sees it."""

    normal: FloatArray
    """Unit vectors into it, shape (n, 2)."""
    gap: FloatArray
    """Free distances [m], shape (n,)."""


class Annulus(NamedTuple):
    """The space between two circles about the origin."""

    radius_in: float
    """Radius of the inner wall [m]; 0 means that there is none."""
    radius_out: float
    """Radius of the outer wall [m]."""
    wall: str = "tangent"
    """What the outer wall is within a step: its "tangent", or "round"."""

    @classmethod
    def checked(cls, radius_in: Any, radius_out: Any, wall: Any = "tangent") -> Self:
        """Return the annulus of these values; raise SceneError unless 0 <= radius_in < radius_out."""
        walls = cls(
            checks.not_negative("radius_in", radius_in),
            checks.positive("radius_out", radius_out),
            checks.one_of("wall", wall, WALLS),
        )
        if walls.radius_in >= walls.radius_out:
            raise SceneError(
                f"radius_in is {walls.radius_in} m: it must be less than radius_out, {walls.radius_out} m"
            )
        return walls

    @property
    def room(self) -> float:
        """Radius of the largest grain that fits [m]."""
        return (self.radius_out - self.radius_in) / 2.0 if self.radius_in > 0.0 else self.radius_out

    @property
    def diameter(self) -> float:
        """How far apart two places in it are at most [m]."""
        return 2.0 * self.radius_out

    @property
    def area(self) -> float:
        """Area of the space between them [m2]."""
        return float(np.pi) * (self.radius_out**2 - self.radius_in**2)

    @property
    def depth(self) -> float:
        """How far its lowest point is below the origin, whichever way is down [m]."""
        return self.radius_out

    @property
    def rounding(self) -> float:
        """A gap within it of zero is a touch, not an overlap [m]."""
        return ROUNDING * self.radius_out

    def side(
        self, number: int, position: FloatArray, radius: FloatArray, move: FloatArray | None = None
    ) -> Side:
        """Return the outer or the inner circle, see `Scene.side`; without an inner one its gaps are inf."""
        rho, normal = distance(position), outward(position)
        if number == INNER:
            nowhere = np.full_like(rho, np.inf)
            return Side(-normal, rho - self.radius_in - radius if self.radius_in > 0.0 else nowhere)
        gap = self.radius_out - rho - radius
        if move is not None and self.wall == "round":
            room = self.radius_out - radius
            path = normal[:, 0] * move[:, 1] - normal[:, 1] * move[:, 0]
            gap = gap - (room - np.sqrt(np.maximum(0.0, room**2 - path**2)))
        return Side(normal, gap)

    def holds(self, position: FloatArray, radius: FloatArray) -> BoolArray:
        """Whether each disc is between the walls, and off the origin, where they have no normal."""
        rho = distance(position)
        nearest = self.radius_in + radius if self.radius_in > 0.0 else 0.0
        return (rho <= self.radius_out - radius) & (rho >= nearest) & (rho > 0.0)

    def require_size(self) -> None:
        """Raise SceneError unless squares of distances are finite, and not zero."""
        if not SMALLEST <= self.radius_out <= LARGEST:
            raise SceneError(
                f"radius_out is {self.radius_out} m: it must be between {SMALLEST:g} and {LARGEST:g} m,"
                " for squares of distances to be finite and not zero; choose another unit of length"
            )

    def require_inside(self, position: FloatArray, radius: FloatArray) -> None:
        """Raise SceneError unless all grains fit between the walls, and have their centres there."""
        rho = distance(position)
        too_large = radius > self.room * (1.0 + ROUNDING)
        if too_large.any():
            grain = checks.of_grain("radius", radius, too_large)
            raise SceneError(f"{grain}: at most {self.room} m fit between the walls")
        demands = (
            (rho == 0.0, "the origin is no place for a grain: the walls have no direction there"),
            (rho > self.radius_out, f"it is outside the outer wall, radius_out {self.radius_out} m"),
            (rho < self.radius_in, f"it is inside the inner wall, radius_in {self.radius_in} m"),
        )
        for bad, reason in demands:
            if bad.any():
                raise SceneError(f"{checks.of_grain('position', position, bad)}: {reason}")

    def area_below(self, level: FloatArray | float) -> FloatArray:
        """Return how much of it is below levels [m2], measured from the origin [m], shape (...)."""
        outer, inner = (area_below(np.array(r), np.array(level)) for r in (self.radius_out, self.radius_in))
        return outer - inner


def outward(position: FloatArray) -> FloatArray:
    """Return the unit vectors from the origin, normal to both walls, shape (n, 2)."""
    return position / distance(position)[:, np.newaxis]


def body_of(wall: IntArray, two_circles: bool) -> IntArray:
    """Return which of the device's walls each of these walls is, or is a side of."""
    return wall if two_circles else np.maximum(wall - 1, 0)


def wall_of(body: IntArray, correction: FloatArray, two_circles: bool) -> IntArray:
    """Return the walls that carry the corrections [m/s] of the device's walls."""
    if two_circles:
        return body.astype(np.int32)
    return np.where(body > 0, body + 1, np.where(correction < 0.0, INNER, OUTER)).astype(np.int32)
