"""Regions: parts of the space between the walls, in which grains are placed, counted and cut.

A region is a ring about the origin, cut by convex polygons, without the discs inside. A grain belongs to it
if its center lies in it, a contact if its contact point does. Areas, also those of grains that the border
cuts, are exact (outline.py).
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from warpgrains.arrays import BoolArray, FloatArray
from warpgrains.described import fields_in_help
from warpgrains.errors import InputError, NoAreaError
from warpgrains.scene import checks
from warpgrains.scene.geometry import Circle, area_in_disc
from warpgrains.scene.outline import Part, clearance, clip, uncovered
from warpgrains.scene.walls import Annulus

KEYS = ("x", "y", "distance")
ROUNDING = 1e-13  # of areas, sums of dozens of parts, in squares of the outer radius

Corners = tuple[tuple[float, float], ...]
Side = tuple[FloatArray, float]
"""Half plane, normal . x <= level [m]."""


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

    @cached_property
    def parts(self) -> list[Part]:
        """The parts of the region, one for each polygon."""
        near, far, _ = self.ring
        inner = (Circle(0.0, 0.0, near, False),) if near > 0.0 else ()
        circles = (Circle(0.0, 0.0, far, True), *inner, *dict.fromkeys(self.discs))
        return [Part(corner, circles) for corner in self._corners] if near < far else []

    @property
    def _corners(self) -> list[FloatArray]:
        cells = (rectangle(self.ring),) if self.cells is None else self.cells
        return [np.array(corner) for corner in cells]

    @property
    def low(self) -> FloatArray:
        """Left and lower edge of the polygons [m], shape (2,)."""
        return np.min([corner.min(axis=0) for corner in self._corners], axis=0)

    @property
    def high(self) -> FloatArray:
        """Right and upper edge of the polygons [m], shape (2,)."""
        return np.max([corner.max(axis=0) for corner in self._corners], axis=0)

    @property
    def box(self) -> FloatArray:
        """Bounding box of the region: lower left and upper right corner [m], shape (2, 2)."""
        reach = self.ring.radius_out
        return np.array([np.maximum(self.low, -reach), np.minimum(self.high, reach)])

    def contains(self, position: FloatArray) -> BoolArray:
        """Return which points [m], shape (..., 2), lie in the region or on its border, shape (...,)."""
        found = np.zeros(position.shape[:-1], bool)
        for part in self.parts:
            found |= part.contains(position)
        return found

    @property
    def area(self) -> float:
        """Area of the region without the discs inside [m2]."""
        return _area(self)

    def areas(self, position: FloatArray, radius: FloatArray) -> FloatArray:
        """Return the areas of discs inside the region [m2], of centers (n, 2) and radii (n,), shape (n,)."""
        area = np.zeros(len(radius))
        for part in self.parts:
            area += part.areas(position, radius)
        return area

    def clearance(self, points: FloatArray) -> FloatArray:
        """Return a lower bound of the distance of points from the border [m], < 0 outside, shape (n,)."""
        inside = self.contains(points)
        return clearance(self._border, self.parts[0].circles, points, inside)

    @cached_property
    def _border(self) -> FloatArray:
        """Edges of the polygons but for those that two of them share [m], shape (k, 2, 2)."""
        edges, rounding = [part.edges for part in self.parts], 1e-12 * self.ring.radius_out
        if len(edges) == 1:
            return edges[0]
        found = []
        for k, own in enumerate(edges):
            others = np.concatenate(edges[:k] + edges[k + 1 :])
            found += [uncovered(edge, others, rounding) for edge in own]
        return np.concatenate(found)

    def angles(self, center: FloatArray, radius: FloatArray) -> FloatArray:
        """Return the angle of the circle of each disc that lies in the region [rad], shape (n,)."""
        angle = np.zeros(len(radius))
        for part in self.parts:
            angle += part.angles(center, radius)
        return angle

    def cut(self, *sides: Side) -> Region:
        """Return the part in half planes."""
        if not sides:
            return self
        cells = self._corners
        for normal, level in sides:
            cells = [clip(corner, normal, level) for corner in cells]
        return replace(
            self, cells=tuple(tuple(map(tuple, corner.tolist())) for corner in cells if len(corner))
        )

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
        return kept.cut(*((normal, level - depth) for normal, level in sides))

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
            area += part.cut_areas(
                np.zeros((1, 2)), np.array([4.0 * far])
            ).item()  # of a disc about all of it
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


def region_of(annulus: Annulus, given: Any, field: str = "grains.region") -> Region:
    """Return the region that a field such as `grains.region` gives as a table of ranges [m].

    All ranges are optional.

    Raises
    ------
    InputError
        The table is invalid, or the region is empty.
    """
    if given is None:
        return Region(annulus)
    if not isinstance(given, Mapping):
        raise InputError(f"{field} is {given!r}: it must be a table such as {{x = [-1.0, 0.0]}}")
    for key in given:
        checks.one_of(f"key of {field}", key, KEYS)
    ranges = {key: _range(f"{field}.{key}", value) for key, value in given.items()}
    between = (annulus.radius_in, annulus.radius_out)
    near, far = ranges.pop("distance", between)
    if near < annulus.radius_in or far > annulus.radius_out:
        raise NoAreaError(f"{field}.distance is ({near}, {far}) m: it must be between the walls, {between} m")
    ring = annulus._replace(radius_in=near, radius_out=far)
    region = Region(ring, (rectangle(ring, **ranges),) if ranges else None)
    if not (region.box[0] < region.box[1]).all() or region.area <= 0.0:
        raise NoAreaError(f"{field} is {given!r}: no point between the walls lies in it")
    return region


def table_of(field: str, text: Any) -> dict[str, Any]:
    """Return the table that a text of an option describes, such as "x = [-1.0, 0.0], below = 0.5".

    Raises
    ------
    InputError
        It is no table.
    """
    line = checks.text(field, text).strip()
    try:
        return dict(tomllib.loads(f"region = {line if line.startswith('{') else f'{{{line}}}'}")["region"])
    except (tomllib.TOMLDecodeError, TypeError, ValueError):
        raise InputError(
            f"{field} is {text!r}: it must be ranges such as 'x = [-1.0, 0.0], y = [-1.0, 0.5]'"
        ) from None


def _range(field: str, value: Any) -> tuple[float, float]:
    low, high = checks.vector(field, value)
    if low >= high:
        raise InputError(f"{field} is ({low}, {high}) m: the smaller one comes first")
    return low, high
