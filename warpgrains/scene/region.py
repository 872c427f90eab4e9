"""Regions: parts of the space between the walls, in which grains are placed, counted and cut.

A region is a ring about the origin, cut by convex polygons, without the discs inside. A grain belongs to it
if its center lies in it, a contact if its contact point does. Areas, also those of grains that the border
cuts, are exact (outline.py). In periodic directions, points and discs count where their images are.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from warpgrains.arrays import BoolArray, FloatArray, IndexArray
from warpgrains.described import fields_in_help
from warpgrains.errors import InputError, NoAreaError
from warpgrains.scene import checks
from warpgrains.scene.annulus import Annulus
from warpgrains.scene.geometry import Circle, area_in_disc, nearest_image, with_images, wrapped
from warpgrains.scene.outline import Part, clip, distinct

RANGES = ("x", "y", "distance")
ROUNDING = 1e-13  # of areas, sums of dozens of parts, in squares of the outer radius

Ends = tuple[float, float]
Corners = tuple[Ends, ...]
Side = tuple[FloatArray, float]
"""Half plane, normal . x <= level [m]."""
Measure = Callable[[Part, FloatArray, FloatArray], FloatArray]


@fields_in_help
@dataclass(frozen=True)
class Region:
    """A part of the space between the walls, as returned by `region_of`.

    Examples
    --------
    >>> lower = analysis.region_of(simulation, {"y": (-2.0, 0.0)})
    >>> int(lower.contains(simulation.position).sum()), f"{lower.area:.3f} m2"
    (15, '5.890 m2')
    """

    ring: Annulus
    """Ring about the origin."""
    cells: tuple[Corners, ...] | None = None
    """Convex polygons without overlap that cut the ring: the corners of each [m], counter-clockwise. None for
    the whole ring."""
    discs: tuple[Circle, ...] = ()
    """Discs outside of which, and rings inside of which the region lies."""
    periodic: tuple[Ends | None, Ends | None] = (None, None)
    """Where a periodic box begins and ends along x and y [m]; None for directions that are not periodic."""

    @property
    def low(self) -> FloatArray:
        """Lower ends of the box in periodic directions [m], shape (2,); 0 in others."""
        return np.array([ends[0] if ends else 0.0 for ends in self.periodic])

    @property
    def period(self) -> FloatArray:
        """Lengths of the box in periodic directions [m], shape (2,); 0 in others."""
        return np.array([ends[1] - ends[0] if ends else 0.0 for ends in self.periodic])

    def wrapped(self, position: FloatArray) -> FloatArray:
        """Return the images of points in the box [m], shape (..., 2)."""
        return wrapped(position, self.period, self.low)

    def nearest_image(self, ways: FloatArray) -> FloatArray:
        """Return the shortest of ways and their images in the box [m], shape (..., 2)."""
        return nearest_image(ways, self.period)

    def images(self, position: FloatArray, reach: FloatArray) -> tuple[FloatArray, IndexArray]:
        """Return discs in the box, and the images of those that reach across a periodic side.

        The centers [m], shape (k, 2), and the disc of each as a number, shape (k,).
        """
        return with_images(self.wrapped(position), reach, self.period, self.low)

    @property
    def shifts(self) -> FloatArray:
        """Ways from a cell of a periodic box to itself and those around it [m], shape (1, 3 or 9; 2)."""
        steps = [(0.0, 1.0, -1.0) if length else (0.0,) for length in self.period]
        return np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 2) * self.period

    @cached_property
    def parts(self) -> list[Part]:
        """The parts of the region, one for each polygon."""
        near, far, _ = self.ring
        inner = (Circle(0.0, 0.0, near, False),) if near > 0.0 else ()
        circles = (Circle(0.0, 0.0, far, True), *inner, *dict.fromkeys(self.discs))
        corners = [distinct(corner) for corner in self._corners] if near < far else []
        return [Part.of(corner, circles) for corner in corners if len(corner) > 2]

    @property
    def _corners(self) -> list[FloatArray]:
        cells = (rectangle(self.ring),) if self.cells is None else self.cells
        return [np.array(corner) for corner in cells]

    @property
    def outer_box(self) -> FloatArray:
        """Box about the polygons: its lower left and upper right corner [m], shape (2, 2)."""
        corners = np.concatenate(self._corners)
        return np.array([corners.min(axis=0), corners.max(axis=0)])

    @property
    def box(self) -> FloatArray:
        """The part of it that lies in the box about the ring [m], shape (2, 2)."""
        return np.clip(self.outer_box, -self.ring.radius_out, self.ring.radius_out)

    def contains(self, position: FloatArray) -> BoolArray:
        """Return which points [m], shape (..., 2), lie in the region or on its border, shape (...,)."""
        position = self.wrapped(position)
        found = [part.contains(position) for part in self.parts]
        return np.any([np.zeros(position.shape[:-1], bool), *found], axis=0)

    @property
    def area(self) -> float:
        """Area of the region without the discs inside [m2]."""
        return _area(self)

    def areas(self, position: FloatArray, radius: FloatArray) -> FloatArray:
        """Return the areas of discs inside the region [m2], of centers (n, 2) and radii (n,), shape (n,)."""
        return self._sums(Part.areas, position, radius)

    def angles(self, center: FloatArray, radius: FloatArray) -> FloatArray:
        """Return the angle of the circle of each disc that lies in the region [rad], shape (n,)."""
        return self._sums(Part.angles, center, radius)

    def _sums(self, measure: Measure, center: FloatArray, radius: FloatArray) -> FloatArray:
        """Return the sums of a measure of discs over the parts and the images, shape (n,)."""
        places, disc = self.images(center, radius)
        found = sum((measure(part, places, radius[disc]) for part in self.parts), start=np.zeros(len(disc)))
        return found if len(disc) == len(radius) else np.bincount(disc, found).astype(np.float64)

    def clearance(self, points: FloatArray) -> FloatArray:
        """Return a lower bound of the distance of points from the border [m], < 0 outside, shape (n,)."""
        points = self.wrapped(points)
        return np.max([part.clearance(points) for part in self.parts], axis=0)

    def cut(self, *sides: Side) -> Region:
        """Return the part in half planes."""
        if not sides:
            return self
        cells = self._corners
        for side in sides:
            cells = [clip(corner, *side) for corner in cells]
        kept = (tuple(map(tuple, corner.tolist())) for corner in cells if len(corner))
        return replace(self, cells=tuple(kept))

    def between(self, direction: FloatArray, low: float, high: float) -> Region:
        """Return the part with low <= direction . x <= high [m]."""
        return self.cut((-direction, -low), (direction, high))

    def distances(self, near: float, far: float) -> Region:
        """Return the part at distances between near and far from the origin [m]."""
        kept = Annulus(max(near, self.ring.radius_in), min(far, self.ring.radius_out))
        return replace(self, ring=kept)

    def split(self, cells: Iterable[Iterable[Side]]) -> Region:
        """Return the parts in convex cells without overlap, each the intersection of half planes."""
        parts = [self.cut(*sides).cells or () for sides in cells]
        return replace(self, cells=tuple(corner for part in parts for corner in part))

    def within(self, other: Region) -> Region:
        """Return the part that lies in another region as well."""
        both = self if other.cells is None else self.split(sides_of(np.array(cell)) for cell in other.cells)
        both = both.distances(other.ring.radius_in, other.ring.radius_out)
        return replace(both, discs=self.discs + other.discs)

    def without_layer(self, depth: float) -> Region:
        """Return the part at a depth [m] from the border of a region of one polygon, or of the whole ring."""
        grown = [disc.radius + (-depth if disc.keeps_inside else depth) for disc in self.discs]
        discs = (disc._replace(radius=radius) for disc, radius in zip(self.discs, grown, strict=True))
        kept = replace(self, ring=self.ring.without_layer(depth), discs=tuple(discs))
        sides = (side for cell in self.cells or () for side in sides_of(np.array(cell)))
        return kept.cut(*((way, level - depth) for way, level in sides if not self._is_periodic(way, level)))

    def _is_periodic(self, normal: FloatArray, level: float) -> bool:
        """Return whether a side is one of the periodic sides of the box."""
        return any(
            ends is not None and level == (ends[1] if along > 0.0 else -ends[0])
            for along, ends in zip(normal.tolist(), self.periodic, strict=True)
            if abs(along) == 1.0
        )

    def span(self, direction: FloatArray) -> tuple[float, float]:
        """Return the smallest and the largest direction . x of the region, discs inside included [m]."""
        found = np.concatenate([part.outermost(direction) for part in self.parts]) @ direction
        return float(found.min()), float(found.max())


@lru_cache(256)  # the scenes of a sweep mostly share a region
def _area(region: Region) -> float:
    near, far, _ = region.ring
    area = 0.0
    for part in region.parts:
        onward = part.corner + part.along
        if region.discs:
            about_all = np.zeros((1, 2)), np.array([4.0 * far])
            area += part.cut_areas(*about_all).item()
        else:
            outer, inner = (area_in_disc(part.corner, onward, radius).sum() for radius in (far, near))
            area += float(outer - inner)
    return area if area > ROUNDING * far**2 else 0.0


def rectangle(
    ring: Annulus, x: tuple[float, float] = (-np.inf, np.inf), y: tuple[float, float] = (-np.inf, np.inf)
) -> Corners:
    """Return the corners of a rectangle [m]; beyond the ring where the ring bounds it."""
    reach = ring.radius_out
    (left, right), (bottom, top) = (
        (low if low > -reach else -2.0 * reach, high if high < reach else 2.0 * reach) for low, high in (x, y)
    )
    return (left, bottom), (right, bottom), (right, top), (left, top)


def sides_of(corner: FloatArray) -> Iterable[Side]:
    """Yield the half planes whose intersection is a convex polygon."""
    for start, along in zip(corner, Part(corner, ()).along, strict=True):
        if size := np.hypot(*along):
            normal = np.array([along[1], -along[0]]) / size
            yield normal, float(start @ normal)


def region_of(space: Region, given: Any, field: str = "grains.region") -> Region:
    """Return the part of a domain in a table of ranges [m], all optional; NoAreaError if it is empty."""
    if given is None:
        return space
    if not isinstance(given, Mapping):
        raise InputError(f"{field} is {given!r}: it must be a table such as {{x = [-1.0, 0.0]}}")
    for key in given:
        checks.one_of(f"key of {field}", key, RANGES)
    ranges = {key: checks.interval(f"{field}.{key}", value) for key, value in given.items()}
    annulus = space.ring
    between = (annulus.radius_in, annulus.radius_out)
    near, far = ranges.pop("distance", between)
    if near < annulus.radius_in or far > annulus.radius_out:
        raise NoAreaError(f"{field}.distance is ({near}, {far}) m: it must be between the walls, {between} m")
    ring = annulus._replace(radius_in=near, radius_out=far)
    region = Region(ring, (rectangle(ring, **ranges),) if ranges else None, periodic=space.periodic)
    if space.cells is not None:
        region = region.within(space)
    if region.area <= 0.0:
        raise NoAreaError(f"{field} is {given!r}: no point between the walls lies in it")
    return region


def table_of(field: str, text: Any) -> dict[str, Any]:
    """Return the table that a text of an option describes, such as "x = [-1.0, 0.0], below = 0.5"."""
    line = checks.text(field, text).strip()
    try:
        return dict(tomllib.loads(f"region = {line if line.startswith('{') else f'{{{line}}}'}")["region"])
    except (tomllib.TOMLDecodeError, TypeError, ValueError):
        raise InputError(
            f"{field} is {text!r}: it must be ranges such as 'x = [-1.0, 0.0], y = [-1.0, 0.5]'"
        ) from None
