"""A disc inside the domain. This is the host's side; kernels/walls/disc.py is the device's."""

from math import dist, inf
from typing import ClassVar

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.described import described
from warpgrains.space.geometry import Circle, Side, directions, distance, hollow_normals
from warpgrains.walls.band import Band, ring
from warpgrains.walls.wall import Wall, kind_of_wall


@kind_of_wall
class Disc(Wall):
    """A disc that grains touch from outside, or a ring that they touch from inside.

    Parameters
    ----------
    {fields}

    Raises
    ------
    InputError
        A value is invalid.

    Examples
    --------
    >>> disc = wg.Disc(center=(0.0, -1.0), radius=0.2)
    >>> grain = {"position": [[0.3, 0.0]], "radius": 0.1, "mass": 0.1}
    >>> wg.Scene(**grain, radius_out=2.0, walls=[disc]).walls[0]
    Disc(center=(0.0, -1.0), radius=0.2)
    """

    kind: ClassVar[str] = "disc"
    kind_number: ClassVar[int] = 1
    center: tuple[float, float] = described("Center [m], two components.", check=checks.vector)
    radius: float = described("Radius [m].", check=checks.positive)
    inside: bool = described("Whether grains are inside, as in a ring.", check=checks.boolean, default=False)

    @property
    def border(self) -> Circle:
        return Circle(*self.center, self.radius, self.inside)

    @property
    def numbers(self) -> tuple[float, ...]:
        return (*self.center, self.radius, float(self.inside))

    @property
    def circle(self) -> tuple[float, float, float]:
        """Center and radius of a circle about all contact points [m]. For a ring, the radius is inf."""
        return (*self.center, inf if self.inside else self.radius)

    @property
    def middle(self) -> tuple[float, float]:
        return self.center

    def farthest(self, point: tuple[float, float]) -> float:
        """Return the distance [m] from the pivot `point` to the center. Only the center moves in a turn."""
        return dist(self.center, point)

    def side(self, position: FloatArray, radius: FloatArray) -> Side:
        away = np.array(self.center) - position
        rho, normal = distance(away), directions(away)
        if self.inside:
            return Side(-normal, self.radius - rho - radius)
        return Side(normal, rho - (radius + self.radius))

    def hollow_radii(self, position: FloatArray) -> FloatArray:
        return np.full(len(position), self.radius if self.inside else -self.radius)

    def face_normals(self, point: FloatArray, position: FloatArray) -> FloatArray:
        return hollow_normals(self.center, self.radius, point, position)

    def drawn(self, thickness: float) -> Band:
        return ring(self.border, thickness)
