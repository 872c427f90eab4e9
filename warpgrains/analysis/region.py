"""Regions: parts of the space between the walls in which grains and contacts are counted.

A grain belongs to a region if its center lies in it, a contact if its contact point does. So every grain
and every contact belongs to exactly one of several regions that fill a larger one without overlap. The
area of a region is exact: its border is cut where lines and circles meet (outline.py). Discs inside the
annulus are not part of a region; other walls inside have no thickness.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from warpgrains.analysis.outline import (
    angles_at,
    angles_at_edges,
    area_of,
    clip,
    distance_to_edges,
    edges_of,
    windings,
)
from warpgrains.arrays import BoolArray, FloatArray
from warpgrains.errors import InputError
from warpgrains.scene import region as ranges
from warpgrains.scene.geometry import Circle, distance
from warpgrains.scene.walls import Annulus

ROUNDING = 1e-13  # of areas, sums of dozens of parts, in squares of the outer radius

Sides = Sequence[tuple[FloatArray, float]]
"""Half planes, normal . x <= level [m], whose intersection is convex."""


@dataclass(frozen=True, eq=False)
class Region:
    """A part of the space between the walls, as returned by `region_of`.

    Examples
    --------
    >>> lower = analysis.region_of(simulation, {"y": (-2.0, 0.0)})
    >>> int(lower.contains(simulation.position).sum()), f"{lower.area:.3f} m2"
    (15, '5.890 m2')
    """

    space: ranges.Region
    """Ring about the origin, intersected with a box."""
    polygons: tuple[FloatArray, ...] = ()
    """Polygons without overlap in which the region lies, unless there are none: the corners of each [m], in
    counter-clockwise order, shape (k, 2)."""
    discs: tuple[Circle, ...] = ()
    """Discs outside of which, and rings inside of which the region lies."""

    def contains(self, position: FloatArray) -> BoolArray:
        """Return which points [m], shape (..., 2), lie in the region, shape (...,)."""
        found = self.space.contains(position)
        for disc in self.discs:
            found &= disc.contains(position)
        return found & (windings(self.edges, position) > 0) if self.polygons else found

    @cached_property
    def area(self) -> float:
        """Area of the region without the discs inside [m2]."""
        near, far, _ = self.space.ring
        if near >= far:
            return 0.0
        if not self.polygons and not self.discs:
            return self.space.area
        area = area_of(self.edges if self.polygons else edges_of(box_of(self.space)), self.circles)
        return area if area > ROUNDING * far**2 else 0.0

    @cached_property
    def edges(self) -> FloatArray:
        """Directed edges of the polygons [m], shape (e, 2, 2)."""
        return np.concatenate([np.zeros((0, 2, 2)), *map(edges_of, self.polygons)])

    @property
    def circles(self) -> list[Circle]:
        """All circles that bound the region."""
        outer, inner = self.space.ring.borders
        return [inner, outer, *self.discs]

    def between(self, direction: FloatArray, low: float, high: float) -> Region:
        """Return the part with low <= direction . x <= high [m]."""
        sides = ((-direction, -low), (direction, high))
        parts = parts_in(self.polygons or (box_of(self.space),), [sides])
        return Region(ranges.Region(self.space.ring), parts, self.discs)

    def ring(self, near: float, far: float) -> Region:
        """Return the part at distances between near and far from the origin [m]."""
        ring = self.space.ring
        kept = Annulus(max(near, ring.radius_in), min(far, ring.radius_out))
        return replace(self, space=self.space._replace(ring=kept))

    def for_centers(self, smallest: float, annulus: Annulus) -> Region:
        """Return the part that centers of grains of the smallest radius [m] can reach.

        Raises
        ------
        InputError
            There is none.
        """
        reached = annulus.without_layer(smallest)
        left = self.ring(reached.radius_in, reached.radius_out)
        grown = [disc.radius + (-smallest if disc.keeps_inside else smallest) for disc in self.discs]
        discs = zip(self.discs, grown, strict=True)
        left = replace(left, discs=tuple(disc._replace(radius=radius) for disc, radius in discs))
        if left.area <= 0.0:
            raise InputError(
                f"the region has no point for the center of a grain of radius {smallest:g} m:"
                " give a larger one, such as region={}"
            )
        return left

    def share_of_circles(self, position: FloatArray, r: float, clearance: FloatArray) -> FloatArray:
        """Return the fraction of the circle of radius r [m] about each point inside the region, shape (n,).

        The circle is cut at its intersections with the circles and lines that bound the region. An arc
        between two cuts is inside if its midpoint is. A circle within the clearance of its point is not cut.
        """
        share, cut = (clearance > 0.0).astype(np.float64), np.abs(clearance) <= r
        share[cut] = self._share_of_cut_circles(position[cut], r)
        return share

    def _share_of_cut_circles(self, position: FloatArray, r: float) -> FloatArray:
        cuts = [np.zeros((len(position), 1)), *(angles_at(position, r, circle) for circle in self.circles)]
        with np.errstate(invalid="ignore"):
            for corner in (self.space.low, self.space.high):
                x, y = ((np.array(corner) - position) / r).T
                lines = [np.arccos(x), -np.arccos(x), np.arcsin(y), np.pi - np.arcsin(y)]
                cuts.append(np.stack(lines, axis=1))
        if self.polygons:
            cuts.append(angles_at_edges(position, r, self.edges))
        start = np.sort(np.nan_to_num(np.concatenate(cuts, axis=1)) % (2.0 * np.pi), axis=1)
        arc = np.diff(start, axis=1, append=2.0 * np.pi)
        middle = start + 0.5 * arc
        points = position[:, np.newaxis] + r * np.stack([np.cos(middle), np.sin(middle)], axis=-1)
        return np.asarray((arc * self.contains(points)).sum(axis=1) / (2.0 * np.pi))

    def clearance(self, position: FloatArray) -> FloatArray:
        """Return a lower bound of the distance of points from the border [m], < 0 outside, shape (n,)."""
        nearest = distance_to_edges(self.edges, position)
        for x, y, radius, _ in self.circles:
            nearest = np.minimum(nearest, np.abs(distance(position - (x, y)) - radius))
        for corner in (self.space.low, self.space.high):
            nearest = np.minimum(nearest, np.abs(position - corner).min(axis=1))
        nearest = np.maximum(nearest * (1.0 - 1e-9) - 1e-12 * self.space.ring.radius_out, 0.0)
        return np.where(self.contains(position), nearest, -nearest)


def parts_in(polygons: Iterable[FloatArray], cells: Iterable[Sides]) -> tuple[FloatArray, ...]:
    """Return the parts of polygons in convex cells without overlap; a point if there are none."""
    parts = []
    for corner, cell in product(polygons, cells):
        part = corner
        for normal, level in cell:
            part = clip(part, normal, level)
        if len(part):
            parts.append(part)
    return tuple(parts) or (np.zeros((1, 2)),)


def box_of(space: ranges.Region) -> FloatArray:
    """Return the corners of the box of a region, beyond the ring where the ring bounds it, shape (4, 2)."""
    low, high = np.array(space.low), np.array(space.high)
    reach = space.ring.radius_out
    left, bottom = np.where(low > -reach, low, -2.0 * reach)
    right, top = np.where(high < reach, high, 2.0 * reach)
    return np.array([(left, bottom), (right, bottom), (right, top), (left, top)])
