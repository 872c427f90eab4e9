"""Region for random grains: the space between the walls, or a part of it."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from warpgrains.arrays import BoolArray, FloatArray
from warpgrains.errors import InputError
from warpgrains.scene import checks
from warpgrains.scene.geometry import area_in_disc
from warpgrains.scene.obstacle import Obstacle
from warpgrains.scene.walls import Annulus

KEYS = ("x", "y", "distance")


class Region(NamedTuple):
    """A ring about the origin intersected with a box. Discs lie completely inside, and clear of obstacles."""

    ring: Annulus
    low: tuple[float, float] = (-np.inf, -np.inf)
    """Left and lower edge [m]."""
    high: tuple[float, float] = (np.inf, np.inf)
    """Right and upper edge [m]."""
    obstacles: tuple[Obstacle, ...] = ()
    """Walls inside the annulus. They are not subtracted from the area."""

    @property
    def box(self) -> FloatArray:
        """Bounding box of the region: lower left and upper right corner [m], shape (2, 2)."""
        reach = self.ring.radius_out
        return np.array([np.maximum(self.low, -reach), np.minimum(self.high, reach)])

    def contains(self, position: FloatArray) -> BoolArray:
        """Return which points [m], shape (..., 2), lie in the region, shape (...,)."""
        rho = np.hypot(position[..., 0], position[..., 1])
        in_ring = (rho >= self.ring.radius_in) & (rho <= self.ring.radius_out)
        return np.asarray(in_ring & ((position >= self.low) & (position <= self.high)).all(axis=-1))

    @property
    def area(self) -> float:
        """Area of the region [m2]."""
        return _area(self)


@lru_cache(256)  # the scenes of a sweep mostly share a region
def _area(region: Region) -> float:
    (left, bottom), (right, top) = region.box
    corner = np.array([(left, bottom), (right, bottom), (right, top), (left, top)])
    onward = np.roll(corner, -1, axis=0)
    radii = (region.ring.radius_out, region.ring.radius_in)
    outer, inner = (area_in_disc(corner, onward, radius).sum() for radius in radii)
    return float(outer - inner)


def region_of(
    annulus: Annulus, given: Any, field: str = "grains.region", obstacles: Sequence[Obstacle] = ()
) -> Region:
    """Return the region that a field such as `grains.region` gives as a table of ranges [m].

    All ranges are optional.

    Raises
    ------
    InputError
        The table is invalid, or the region is empty.
    """
    if given is None:
        return Region(annulus, obstacles=tuple(obstacles))
    if not isinstance(given, dict):
        raise InputError(f"{field} is {given!r}: it must be a table such as {{x = [-1.0, 0.0]}}")
    for key in given:
        checks.one_of(f"key of {field}", key, KEYS)
    ranges = {key: _range(f"{field}.{key}", value) for key, value in given.items()}
    between = (annulus.radius_in, annulus.radius_out)
    near, far = ranges.get("distance", between)
    if near < annulus.radius_in or far > annulus.radius_out:
        raise InputError(f"{field}.distance is ({near}, {far}) m: it must be between the walls, {between} m")
    x, y = (ranges.get(key, (-np.inf, np.inf)) for key in ("x", "y"))
    region = Region(Annulus(near, far), (x[0], y[0]), (x[1], y[1]), tuple(obstacles))
    if not (region.box[0] < region.box[1]).all() or region.area <= 0.0:
        raise InputError(f"{field} is {given!r}: no point between the walls lies in it")
    return region


def _range(field: str, value: Any) -> tuple[float, float]:
    low, high = checks.vector(field, value)
    if low >= high:
        raise InputError(f"{field} is ({low}, {high}) m: the smaller one comes first")
    return low, high
