"""Regions: parts of the space between the walls, in which grains are placed, counted and cut.

A region is the part of convex polygons outside of discs and inside rings. A grain belongs to a region if its
center lies in it, a contact if its contact point does. Areas, also of grains that the border cuts, are exact
(outline.py). In periodic directions, the images of points and discs in the cell count.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from math import inf
from typing import Any, NamedTuple

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import BoolArray, FloatArray, IndexArray
from warpgrains.base.described import fields_in_help
from warpgrains.base.errors import InputError, NoAreaError
from warpgrains.space.geometry import Circle, Ends, Period, area_below
from warpgrains.space.outline import ONE_CORNER, TOUCH, Part, clip, distinct

RANGES = ("x", "y", "distance")
ROUNDING = 1e-13  # rounding error of an area, relative to the square of the region's diameter

Corners = tuple[Ends, ...]
Side = tuple[FloatArray, float]
"""A half plane: the unit vector `normal` and `level` [m] of normal . x <= level."""
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

    cells: tuple[Corners, ...]
    """Convex polygons without overlap: the corners of each [m], counter-clockwise."""
    discs: tuple[Circle, ...] = ()
    """Circles that bound the region, each on the side that its `keeps_inside` says."""
    period: Period = field(default_factory=Period)
    """The periodic cell, whose images continue the region."""

    @cached_property
    def ring(self) -> Ends:
        """Radii of the smallest ring about the origin that bounds the region [m].

        They are 0 or inf if no circle about the origin bounds the region there.
        """
        near, far = 0.0, inf
        for x, y, radius, keeps_inside in self.discs:
            if x == y == 0.0:
                near, far = (near, min(far, radius)) if keeps_inside else (max(near, radius), far)
        return near, far

    @cached_property
    def parts(self) -> list[Part]:
        """The parts of the region, one for each polygon."""
        corners = [distinct(corner) for corner in self._corners]
        return [Part.of(corner, dict.fromkeys(self.discs)) for corner in corners if len(corner) > 2]

    @property
    def _corners(self) -> list[FloatArray]:
        return [np.array(corner) for corner in self.cells]

    @property
    def outer_box(self) -> FloatArray:
        """Lower left and upper right corner of the smallest box around the polygons [m], shape (2, 2)."""
        corners = np.concatenate(self._corners) if self.cells else np.zeros((1, 2))
        return np.array([corners.min(axis=0), corners.max(axis=0)])

    @property
    def box(self) -> FloatArray:
        """Corners of the intersection of `outer_box` and the box around the outer circle of `ring` [m].

        The first row is the lower left corner, the second one the upper right corner.
        """
        return np.clip(self.outer_box, -self.ring[1], self.ring[1])

    @property
    def is_box(self) -> bool:
        """True if the region is one rectangle along the axes, apart from its discs."""
        corner = np.concatenate([np.zeros((0, 2)), *self._corners])
        return len(corner) == 4 and bool((corner[:, np.newaxis] == self.outer_box).any(axis=1).all())

    def contains(self, position: FloatArray) -> BoolArray:
        """Return which points [m], shape (..., 2), lie in the region or on its border, shape (...,)."""
        position = self.period.wrapped(position)
        found = [part.contains(position) for part in self.parts]
        return np.any([np.zeros(position.shape[:-1], bool), *found], axis=0)

    @property
    def area(self) -> float:
        """Area of the region, and so without the discs that it excludes [m2]."""
        return _area(self)

    def areas(self, position: FloatArray, radius: FloatArray) -> FloatArray:
        """Return the area of each disc inside the region [m2], shape (n,), from positions and radii [m]."""
        return self._sums(Part.areas, position, radius)

    def slices(
        self, direction: FloatArray, edges: FloatArray, center: FloatArray, radius: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Divide the region by lines direction . x = edge; return areas inside the slices [m2].

        The first result are the areas of discs in each slice, shape (slices, n), the second those of the
        slices, shape (slices,). Discs near the border of the region are cut by it and by the edges, all other
        discs by the edges alone.
        """
        slices = _slices(self, tuple(direction.tolist()), tuple(edges.tolist()))
        inner = self._are_clear(center, radius)
        inner &= not (direction[self.period.repeats] != 0.0).any()  # images at both ends of the cell count
        found = np.zeros((len(edges) - 1, len(radius)))
        level = self.period.wrapped(center[inner]) @ direction
        found[:, inner] = np.diff(area_below(radius[inner], edges[:, np.newaxis] - level), axis=0)
        outer = np.flatnonzero(~inner)
        places, disc = self.period.images(center[outer], radius[outer])
        disc, level = outer[disc], places @ direction
        low, high = edges[slices.number, np.newaxis], edges[slices.number + 1, np.newaxis]
        k, near = np.nonzero((level + radius[disc] > low) & (level - radius[disc] < high))
        areas = slices.polygons(k).cut_areas(places[near], radius[disc[near]])
        np.add.at(found, (slices.number[k], disc[near]), areas)
        return found, slices.area

    def _are_clear(self, center: FloatArray, radius: FloatArray) -> BoolArray:
        """Return which discs, with all of their periodic images, lie inside up to rounding, shape (n,)."""
        places, disc = self.period.images(center, radius)
        low, high = self.outer_box
        beyond = self.period.repeats & (high - low >= self.period.lengths)  # periodic sides are no border
        parts = self.parts
        if beyond.any() and self.cells == (rectangle((low[0], high[0]), (low[1], high[1])),):
            low, high = low - beyond * self.period.lengths, high + beyond * self.period.lengths
            parts = replace(self, cells=(rectangle((low[0], high[0]), (low[1], high[1])),)).parts
        apart = np.max([np.full(len(disc), -np.inf), *(part.clearance(places) for part in parts)], axis=0)
        return np.bincount(disc, apart < (1.0 - TOUCH**2) * radius[disc], len(radius)) == 0.0

    def angles(self, center: FloatArray, radius: FloatArray) -> FloatArray:
        """Return the total angle of the arcs of each circle that are inside the region [rad], shape (n,)."""
        return self._sums(Part.angles, center, radius)

    def _sums(self, measure: Measure, center: FloatArray, radius: FloatArray) -> FloatArray:
        """Return, for each disc, the sum of a measure over its periodic images and the parts, shape (n,).

        A measure, such as `Part.areas`, takes a part, centers and radii.
        """
        places, disc = self.period.images(center, radius)
        found = sum((measure(part, places, radius[disc]) for part in self.parts), start=np.zeros(len(disc)))
        return found if len(disc) == len(radius) else np.bincount(disc, found).astype(np.float64)

    def clearance(self, points: FloatArray) -> FloatArray:
        """Return a lower bound of the distance of points from the border [m], < 0 outside, shape (n,)."""
        points = self.period.wrapped(points)
        return np.max([part.clearance(points) for part in self.parts], axis=0)

    def cut(self, *sides: Side) -> Region:
        """Return the part of the region that lies in all of these half planes."""
        if not sides:
            return self
        cells = self._corners
        for side in sides:
            cells = [clip(corner, *side) for corner in cells]
        kept = (tuple(map(tuple, corner.tolist())) for corner in cells if len(corner))
        return replace(self, cells=tuple(kept))

    def between(self, direction: FloatArray, low: float, high: float) -> Region:
        """Return the part of the region with low <= direction . x <= high [m]."""
        return self.cut((-direction, -low), (direction, high))

    def distances(self, near: float, far: float) -> Region:
        """Return the part of the region at distances between `near` and `far` [m] from the origin."""
        inner = (Circle(0.0, 0.0, near, False),) if near > self.ring[0] else ()
        outer = (Circle(0.0, 0.0, far, True),) if far < self.ring[1] else ()
        return replace(self, discs=outer + inner + self.discs)

    def split(self, cells: Iterable[Iterable[Side]]) -> Region:
        """Return the part of the region in a union of cells.

        Each cell is an intersection of half planes. Cells do not overlap.
        """
        parts = [self.cut(*sides).cells for sides in cells]
        return replace(self, cells=tuple(corner for part in parts for corner in part))

    def within(self, other: Region) -> Region:
        """Return the intersection with another region."""
        return _intersection(self, other)

    def without_layer(self, depth: float) -> Region:
        """Return the part at least `depth` [m] from the border, of a region that consists of one polygon."""
        grown = [disc.radius + (-depth if disc.keeps_inside else depth) for disc in self.discs]
        discs = tuple(disc._replace(radius=radius) for disc, radius in zip(self.discs, grown, strict=True))
        if any(disc.radius <= 0.0 for disc in discs):
            return replace(self, cells=(), discs=())
        kept = replace(self, discs=discs)
        sides = (side for cell in self.cells for side in sides_of(np.array(cell)))
        return kept.cut(*((way, level - depth) for way, level in sides if not self._is_periodic(way, level)))

    def _is_periodic(self, normal: FloatArray, level: float) -> bool:
        """Return whether the line normal . x = level is one of the periodic sides of the box."""
        return any(
            ends is not None and level == (ends[1] if along > 0.0 else -ends[0])
            for along, ends in zip(normal.tolist(), (self.period.x, self.period.y), strict=True)
            if abs(along) == 1.0
        )

    def span(self, direction: FloatArray) -> tuple[float, float]:
        """Return the smallest and the largest direction . x [m] in the region and the discs it excludes."""
        return _span(self, tuple(direction.tolist()))


class _Slices(NamedTuple):
    """The slices of a region, divided into p convex polygons."""

    number: IndexArray
    """Index of the slice of each polygon, shape (p,)."""
    corner: FloatArray
    """Corners of the polygons [m], shape (p, k, 2). If a polygon has fewer than k, its last corner is
    repeated."""
    circles: tuple[Circle, ...]
    area: FloatArray
    """Areas of the slices [m2], shape (slices,)."""

    def polygons(self, which: IndexArray) -> Part:
        """Return a part that holds, for each disc, polygon which[disc], for `Part.cut_areas`."""
        return Part(self.corner[which], self.circles)


@lru_cache(64)  # a region at rest has the same slices at every step
def _slices(region: Region, direction: Ends, edges: tuple[float, ...]) -> _Slices:
    way = np.array(direction)
    slices = [region.between(way, low, high) for low, high in pairwise(edges)]
    parts = [(number, part) for number, one in enumerate(slices) for part in one.parts]
    most = max((len(part.corner) for _, part in parts), default=1)
    corner = [part.corner[np.minimum(np.arange(most), len(part.corner) - 1)] for _, part in parts]
    circles = dict.fromkeys(circle for _, part in parts for circle in part.circles)
    numbers = np.array([number for number, _ in parts], np.int64)
    area = np.array([one.area for one in slices])
    return _Slices(numbers, np.array(corner).reshape(-1, most, 2), tuple(circles), area)


@lru_cache(64)
def _span(region: Region, direction: Ends) -> Ends:
    way = np.array(direction)
    found = np.concatenate([part.outermost(way) for part in region.parts]) @ way
    return float(found.min()), float(found.max())


@lru_cache(64)
def _intersection(one: Region, other: Region) -> Region:
    both = one.split(sides_of(np.array(cell)) for cell in other.cells)
    return replace(both, discs=tuple(dict.fromkeys(one.discs + other.discs)))


@lru_cache(256)  # the scenes of a sweep mostly share a region
def _area(region: Region) -> float:
    if not region.parts:
        return 0.0
    low, high = region.outer_box
    size = float(np.hypot(*(high - low)))
    about_all = 0.5 * (low + high)[np.newaxis], np.array([2.0 * size])
    area = sum(part.cut_areas(*about_all).item() for part in region.parts)
    return area if area > ROUNDING * size**2 else 0.0


def rectangle(x: Ends, y: Ends) -> Corners:
    """Return the corners of a rectangle [m]."""
    (left, right), (bottom, top) = x, y
    return (left, bottom), (right, bottom), (right, top), (left, top)


def polygon(field: str, corner: FloatArray) -> Region:
    """Return the region inside a polygon with corners [m], shape (k, 2), divided into trapezoids.

    Raise InputError, which names `field`, if sides of the polygon cross.
    """
    (x, y), (onward, above) = corner.T, np.roll(corner, -1, axis=0).T
    cells: list[Corners] = []
    for low, high in pairwise(np.unique(y).tolist()):
        k = np.flatnonzero((np.minimum(y, above) < high) & (np.maximum(y, above) > low))
        ends = x[k] + (onward - x)[k] / (above - y)[k] * (np.array([[low], [high]]) - y[k])
        ends = ends[:, np.argsort(ends.sum(axis=0))]
        if (np.diff(ends) < -ONE_CORNER * np.abs(corner).max()).any():
            raise InputError(f"{field}: sides of this polygon cross between y = {low:g} and {high:g} m")
        pairs = ends.T.reshape(-1, 2, 2).tolist()
        cells += [((a, low), (b, low), (d, high), (c, high)) for (a, c), (b, d) in pairs]
    return Region(tuple(cells))


def sides_of(corner: FloatArray) -> Iterable[Side]:
    """Yield the half planes whose intersection is a convex polygon."""
    for start, along in zip(corner, Part(corner, ()).along, strict=True):
        if size := np.hypot(*along):
            normal = np.array([along[1], -along[0]]) / size
            yield normal, float(start @ normal)


def region_of(space: Region, given: Any, field: str = "grains.region") -> Region:
    """Return the part of `space` that a table of ranges [m] selects; NoAreaError if it is empty.

    The keys, all optional, are those of `ranges_of`. Messages name `field`.
    """
    if given is None:
        return space
    ranges = ranges_of(field, given)
    near, far = ranges.pop("distance", space.ring)
    if near < space.ring[0] or far > space.ring[1]:
        raise NoAreaError(
            f"{field}.distance is ({near}, {far}) m: it must be between the walls, {space.ring} m"
        )
    region = _in_ranges(space, near, far, tuple(ranges.items()))
    if region.area <= 0.0:
        raise NoAreaError(f"{field} is {given!r}: no point between the walls lies in it")
    return region


@lru_cache(64)
def _in_ranges(space: Region, near: float, far: float, ranges: tuple[tuple[str, Ends], ...]) -> Region:
    """Return the part of `space` at distances from `near` to `far` [m] from the origin, in all `ranges`.

    A range is ("x" or "y", (low, high) [m]).
    """
    region, (least, most) = space.distances(near, far), space.box
    for axis, (low, high) in ((np.eye(2)["xy".index(name)], own) for name, own in ranges):
        lowest, highest = least @ axis, most @ axis  # no cut at or beyond the box, which may touch a circle
        if low > lowest:
            region = region.cut((-axis, -low))
        if high < highest:
            region = region.cut((axis, high))
    return region


def ranges_of(field: str, given: Any) -> dict[str, tuple[float, float]]:
    """Check a table of ranges and return the ranges [m] by name; InputError if it is invalid."""
    if not isinstance(given, Mapping):
        raise InputError(f"{field} is {given!r}: it must be a table of ranges, {' or '.join(RANGES)}")
    for key in given:
        checks.one_of(f"key of {field}", key, RANGES)
    return {key: checks.interval(f"{field}.{key}", value) for key, value in given.items()}


def table_of(field: str, text: Any) -> dict[str, Any]:
    """Parse the text of an option as a table, such as "x = [-1.0, 0.0], below = 0.5"."""
    line = checks.text(field, text).strip()
    try:
        return dict(tomllib.loads(f"region = {line if line.startswith('{') else f'{{{line}}}'}")["region"])
    except (tomllib.TOMLDecodeError, TypeError, ValueError):
        raise InputError(
            f"{field} is {text!r}: it must be ranges such as 'x = [-1.0, 0.0], y = [-1.0, 0.5]'"
        ) from None
