"""Geometry of discs in the plane: distances, gaps, areas, and a search for overlaps.

The search serves the checks of a scene at its start. The solver has its own (kernels/search/neighbors.py).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from math import dist
from typing import Any, NamedTuple, Self

import numpy as np

from warpgrains.base.arrays import BoolArray, FloatArray, IndexArray
from warpgrains.base.errors import InputError

ROUNDING = 8 * np.finfo(np.float64).eps
"""Rounding error of a gap, relative to coordinates: a smaller overlap counts as contact, not as overlap."""
SMALLEST, LARGEST = 1e-140, 1e150  # bounds of lengths [m] whose squares are finite and not 0
MOST_RADII = 1e12  # bound of lengths, in smallest grain radii; beyond it float64 cannot resolve a gap
FEW = 64  # number of discs up to which all pairs are compared


Ends = tuple[float, float]


@dataclass(frozen=True)
class Period:
    """The periodic cell of a scene: its lower and upper end along x and along y [m].

    The ends are None in a direction without a period.
    """

    x: Ends | None = None
    y: Ends | None = None

    def __bool__(self) -> bool:
        return self.x is not None or self.y is not None

    @cached_property
    def repeats(self) -> BoolArray:
        """Which of the directions x and y have a period, shape (2,)."""
        return np.array([self.x is not None, self.y is not None])

    @cached_property
    def low(self) -> FloatArray:
        """Lower corner of the cell [m], shape (2,); 0 in directions without a period."""
        return np.array([ends[0] if ends else 0.0 for ends in (self.x, self.y)])

    @cached_property
    def lengths(self) -> FloatArray:
        """Lengths of the cell [m], shape (2,); 0 in directions without a period."""
        return np.array([ends[1] - ends[0] if ends else 0.0 for ends in (self.x, self.y)])

    @property
    def shifts(self) -> FloatArray:
        """Displacements from the cell to itself and its neighbors [m], shape (k, 2), where k is 1, 3 or 9."""
        steps = [(0.0, 1.0, -1.0) if length else (0.0,) for length in self.lengths]
        return np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 2) * self.lengths

    def wrapped(self, position: FloatArray) -> FloatArray:
        """Wrap points [m], shape (..., 2), into the cell: into [low, low + length) in each direction."""
        if not self:
            return position
        away = position - self.low
        images = np.floor(np.divide(away, self.lengths, np.zeros_like(position), where=self.repeats))
        return np.asarray(position - self.lengths * images)

    def from_corner(self, position: FloatArray) -> FloatArray:
        """Return points, wrapped into the cell, relative to its lower corner [m], shape (n, 2).

        Each component is in [0, length) in a direction with a period.
        """
        places = self.wrapped(position) - self.low
        return np.where(self.repeats, np.clip(places, 0.0, np.nextafter(self.lengths, 0.0)), places)

    def nearest(self, ways: FloatArray) -> FloatArray:
        """Return displacements `ways` [m], shape (..., 2), led to the nearest images (MODEL.md, eq. 36).

        `ways` is not changed; without a period, it is returned itself.
        """
        if not self:
            return ways
        images = np.rint(np.divide(ways, self.lengths, np.zeros_like(ways), where=self.repeats))
        return np.asarray(ways - self.lengths * images)

    def images(self, position: FloatArray, reach: FloatArray) -> tuple[FloatArray, IndexArray]:
        """Return all discs, wrapped into the cell, and images of the discs that cross a periodic side.

        `position` and `reach` are the centers and radii of n discs [m]. The result is k >= n centers [m],
        shape (k, 2), and the index of the disc of each, shape (k,). The first n are the discs themselves.
        """
        places = self.wrapped(position)
        number = np.arange(len(places))
        for d in np.flatnonzero(self.repeats).tolist():
            along, half = places[:, d] - self.low[d], 0.5 * self.lengths[d]
            crosses = np.flatnonzero(half - np.abs(along - half) < reach[number])
            images = places[crosses]
            images[:, d] += np.where(along[crosses] < half, 1.0, -1.0) * self.lengths[d]
            places, number = np.concatenate([places, images]), np.concatenate([number, number[crosses]])
        return places, number


NOWHERE = Period()
"""The period of a scene that does not repeat."""


class Circle(NamedTuple):
    """A circle that bounds a shape."""

    x: float
    y: float
    radius: float
    keeps_inside: bool
    """True if the shape lies inside of the circle, False if outside."""

    def meets(self, other: "Circle") -> bool:
        """Return whether circle `other` may have points on the side of this circle where the shape is not."""
        return self.keeps_inside or dist(self[:2], other[:2]) <= self.radius + other.radius

    def contains(self, points: FloatArray) -> BoolArray:
        """Return which points [m], shape (..., 2), are on the side where the shape lies, shape (...,)."""
        rho = np.hypot(points[..., 0] - self.x, points[..., 1] - self.y)
        return np.asarray(rho <= self.radius if self.keeps_inside else rho >= self.radius)


class Side(NamedTuple):
    """Normals and gaps of n grains at one wall."""

    normal: FloatArray
    """Unit vectors into the wall, shape (n, 2)."""
    gap: FloatArray
    """Gaps [m], shape (n,)."""

    @classmethod
    def at(cls, point: FloatArray, position: FloatArray, radius: FloatArray) -> Self:
        """Return normals and gaps, given the points of the wall nearest to the n grains [m], shape (n, 2)."""
        away = point - position
        return cls(directions(away), distance(away) - radius)

    def without_normal(self, path: float = 0.0) -> BoolArray:
        """Return which grains have the normal 0 and a gap of at most `path` [m], shape (n,).

        The normal is 0 where it is undefined, as for a center on a segment.
        """
        return (distance(self.normal) == 0.0) & ~(self.gap > path)


def distance(vectors: FloatArray) -> FloatArray:
    """Return the lengths of vectors, shape (m, 2) to (m,), with the same rounding as the solver."""
    with np.errstate(over="ignore"):
        return np.sqrt(vectors[:, 0] * vectors[:, 0] + vectors[:, 1] * vectors[:, 1])


def directions(vectors: FloatArray) -> FloatArray:
    """Return the unit vectors of vectors, shape (m, 2); 0 for a vector of length 0."""
    length = distance(vectors)[:, np.newaxis]
    return np.divide(vectors, length, np.zeros_like(vectors), where=length != 0.0)


def require_squares(what: str, length: float) -> None:
    """Raise InputError, which begins with `what`, unless the square of a length [m] is finite and not 0."""
    if not SMALLEST <= length <= LARGEST:
        raise InputError(
            f"{what}: it must be between {SMALLEST:g} and {LARGEST:g} m, for squares of distances to"
            " be finite and not zero; choose another unit of length"
        )


def require_distinct(field: str, position: FloatArray) -> None:
    """Raise InputError if two grains have the same center."""
    in_order = np.lexsort(position.T)
    same = distance(np.diff(position[in_order], axis=0)) == 0.0
    if same.any():
        first, second = sorted(in_order[np.argmax(same) :][:2].tolist())
        place = tuple(position[second].tolist())
        raise InputError(f"{field} of grain {second} is {place}: grain {first} has the same center")


def left_of(directions: FloatArray) -> FloatArray:
    """Return vectors rotated by 90 degrees to the left, shape (m, 2)."""
    return np.stack([-directions[:, 1], directions[:, 0]], axis=1)


def hollow_normals(center: Any, radius: float, point: FloatArray, position: FloatArray) -> FloatArray:
    """Return the outward normal of a circle at `point` for each position inside it, shape (n, 2).

    For a position outside of the circle, 0 is returned.
    """
    outwards = (point - center) / np.hypot(*(point - center))
    within: FloatArray = np.where(distance(position - center)[:, np.newaxis] < radius, outwards, 0.0)
    return within


def area_below(radius: FloatArray, level: FloatArray) -> FloatArray:
    """Return the area [m2] of each disc below a level [m] measured from its center; shapes (n,).

    The segment of a disc of radius r below a level h, -r <= h <= r, has the area
    r^2 (pi/2 + asin(h/r)) + h c, c = sqrt(r^2 - h^2), and asin(h/r) is the angle of (c, h), which loses no
    digits where h is near r.
    """
    h = np.minimum(np.maximum(level, -radius), radius)  # np.clip would double the time of this function
    chord = np.sqrt((radius - h) * (radius + h))
    return radius**2 * (0.5 * np.pi + np.arctan2(h, chord)) + h * chord


def area_in_disc(start: FloatArray, end: FloatArray, radius: float) -> FloatArray:
    """Return the area that a triangle (origin, start, end) shares with a disc about the origin [m2], (c,).

    It is negative if the corners are clockwise.
    """
    along = end - start
    a, b = (along**2).sum(axis=1), (start * along).sum(axis=1)
    inside = np.maximum(b**2 - a * ((start**2).sum(axis=1) - radius**2), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        enter, leave = (np.nan_to_num((-b + sign * np.sqrt(inside)) / a) for sign in (-1.0, 1.0))
    p, q = (start + np.clip(t, 0.0, 1.0)[:, np.newaxis] * along for t in (enter, leave))
    triangle = 0.5 * cross(p, q)
    # if a side ends inside, q is its end, and rounding errors of q would change angles at the origin
    beyond = np.where(leave < 1.0, _angle(q, end), 0.0)
    return triangle + 0.5 * radius**2 * (_angle(start, p) + beyond)


def cross(u: FloatArray, v: FloatArray) -> FloatArray:
    """Return the cross products u_x v_y - u_y v_x of vectors (..., 2), shape (...)."""
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])


def _angle(u: FloatArray, v: FloatArray) -> FloatArray:
    return np.arctan2(cross(u, v), (u * v).sum(axis=1))


def overlapping_pairs(
    position: FloatArray, radius: FloatArray, period: Period | None = None
) -> Iterator[tuple[IndexArray, IndexArray]]:
    """Yield the pairs i < j of discs that overlap, each once, in chunks, in memory proportional to n.

    With a period, images of the discs that cross a periodic side are added to the search.

    The discs are divided into size classes, each a factor of two wide. A disc can overlap one of the same
    or a smaller class only if their cells are neighbors; a cell is as wide as the largest diameter of
    the class. So a few huge discs among many small ones cost no more than discs of one size.
    """
    if period:
        places, grain = period.images(position, radius)
        found = [np.sort(grain[np.stack(pair)], axis=0) for pair in overlapping_pairs(places, radius[grain])]
        i, j = np.unique(np.concatenate([np.empty((2, 0), grain.dtype), *found], axis=1), axis=1)
        yield i, j
        return
    touch = ROUNDING * np.abs(position).max(initial=0.0)
    if len(radius) <= FEW:
        i, j = _all_pairs(len(radius))
        overlap = distance(position[j] - position[i]) - (radius[i] + radius[j]) < -touch
        if overlap.any():
            yield i[overlap], j[overlap]
        return
    size_class = np.frexp(radius)[1]
    for this_class in np.unique(size_class):
        members = np.flatnonzero(size_class == this_class)
        smaller = np.flatnonzero(size_class < this_class)
        cell = np.floor((position - position.min(axis=0)) / (2.0 * radius[members].max())).astype(np.int64)
        stride = cell[:, 1].max() + 3
        key = cell[:, 0] * stride + cell[:, 1]
        members, smaller = (found[np.argsort(key[found], kind="stable")] for found in (members, smaller))
        own, near = key[members], key[smaller]  # ascending, so that searches stay in the cache
        after = np.arange(1, len(members) + 1), np.searchsorted(own, own + 1, side="right")
        searches = [(members, *after), (members, *_within(own, own + stride))]
        searches += [(smaller, *_within(own, near + column)) for column in (-stride, 0, stride)]
        center, reach = position[members], radius[members]  # read in this order, too
        for seekers, first, last in searches:
            seeking, own_reach = position[seekers], radius[seekers]
            for place, among in _matches(first, last):
                gap = distance(center[among] - seeking[place]) - (own_reach[place] + reach[among])
                overlap = gap < -touch
                if overlap.any():
                    i, j = seekers[place[overlap]], members[among[overlap]]
                    yield np.minimum(i, j), np.maximum(i, j)


@cache
def _all_pairs(n: int) -> tuple[IndexArray, IndexArray]:
    i, j = np.triu_indices(n, 1)
    return i, j


def _within(ascending: IndexArray, keys: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Return, for each key, the range [first, last) of indices at which `ascending` is key - 1 to key + 1."""
    return np.searchsorted(ascending, keys - 1, side="left"), np.searchsorted(
        ascending, keys + 1, side="right"
    )


def _matches(first: IndexArray, last: IndexArray) -> Iterator[tuple[IndexArray, IndexArray]]:
    """Yield all (k, m) with first[k] <= m < last[k], as arrays.

    The first arrays have the first m of each k, the second ones the next m, and so on.
    """
    k = np.arange(len(first))
    while (busy := first < last).any():
        k, first, last = k[busy], first[busy], last[busy]
        yield k, first
        first = first + 1
