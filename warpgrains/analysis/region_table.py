"""Regions as tables: ranges, sectors, polygons, and the space below the surface of a pile."""

from collections.abc import Iterable, Mapping
from itertools import pairwise
from math import cos, pi, sin
from typing import Any

import numpy as np

from warpgrains.analysis.outline import crosses_itself, edges_of, signed_area
from warpgrains.analysis.region import Region, Sides, box_of, parts_in
from warpgrains.analysis.snapshot import HasState, Snapshot, snapshot, upwards
from warpgrains.arrays import BoolArray, FloatArray
from warpgrains.errors import InputError
from warpgrains.scene import checks
from warpgrains.scene import region as ranges

KEYS = (*ranges.KEYS, "angle", "polygon", "below")
MOST_COLUMNS = 64  # into which the space above a pile is divided

Where = Mapping[str, Any] | Region | None
"""Argument of functions that count in a region; None is the whole space between the walls."""


def region_of(of: Snapshot | HasState, region: Where = None) -> Region:
    """Return the region that a table describes, the part of the space between the walls in which all holds.

    Parameters
    ----------
    of : Snapshot or Simulation
    region : mapping, optional
        None or ``{}`` is the whole space. Keys, all optional:

        - ``x``, ``y``, ``distance``: ranges [m] of coordinates and of the distance from the origin, as for
          `grains.region` of scene files;
        - ``angle``: range [rad] of the direction from the origin, counter-clockwise from the x axis. The
          second number is the larger one, by at most 2 pi. With ``distance`` it is a sector of the annulus;
        - ``polygon``: corners [m], shape (k, 2), in either order; edges do not cross each other;
        - ``below``: a height above the origin, against gravity [m], or ``"surface"``. The latter is the space
          that is at least a mean diameter below the surface of a pile, which leaves out its rough top. The
          surface is at the highest center of a grain in each of the columns into which the space is divided.
          They are as wide as two mean diameters, or as 1/64 of the outer diameter if that is more. Only
          grains with a contact count, if any has one. A column without grains is not part of the region.

    Returns
    -------
    Region
        Its border is inside for circles and ranges. A point on the edge of a polygon, a sector or a column
        belongs to one of its sides.

    Raises
    ------
    InputError
        A key is unknown, a value is invalid, or the region is empty.

    Examples
    --------
    >>> import math
    >>> quarter = analysis.region_of(simulation, {"angle": (-math.pi / 2, 0.0), "distance": (1.0, 2.0)})
    >>> math.isclose(quarter.area, math.pi * (2.0**2 - 1.0**2) / 4)
    True
    """
    if isinstance(region, Region):
        return region
    now, given = snapshot(of), {} if region is None else region
    if not isinstance(given, Mapping):
        raise InputError(f"region is {given!r}: it must be a table such as {{'x': (-1.0, 0.0)}}")
    for key in given:
        checks.one_of("key of region", key, KEYS)
    annulus = now.scene.annulus
    space = ranges.region_of(annulus, {key: given[key] for key in given if key in ranges.KEYS}, "region")
    borders = (wall.border_at(now.time) for wall in now.scene.walls)
    discs = tuple(border for border in borders if border is not None)
    polygons: Iterable[FloatArray] = [_polygon(given["polygon"])] if "polygon" in given else []
    limits = [_box_sides(space)] if polygons else []
    if "angle" in given:
        limits.append(_wedges(given["angle"]))
    if "below" in given and not isinstance(given["below"], str):
        limits.append(
            [[(upwards(now.scene.gravity_at(now.time)), checks.number("region.below", given["below"]))]]
        )
    elif "below" in given:
        checks.one_of("region.below", given["below"], ["surface"])
        columns, union = _below_surface(now)
        if polygons:
            limits.append(columns)
        else:
            polygons, limits = union, [_box_sides(space), *limits]
    if limits and not polygons:
        polygons = [box_of(space)]
    for cells in limits:
        polygons = parts_in(polygons, cells)
    found = Region(ranges.Region(space.ring) if limits else space, tuple(polygons), discs)
    if found.area <= 0.0:
        raise InputError(f"region is {dict(given)!r}: no point between the walls lies in it")
    return found


def grains_in(of: Snapshot | HasState, region: Where) -> BoolArray:
    """Return which grains have their centers in a region, shape (n,); see `region_of`.

    Examples
    --------
    >>> int(analysis.grains_in(simulation, {"below": -1.5}).sum())
    14
    """
    now = snapshot(of)
    return region_of(now, region).contains(now.position)


def _polygon(given: Any) -> FloatArray:
    corner = checks.vectors("region.polygon", given)
    if len(corner) < 3 or crosses_itself(corner):
        raise InputError(
            f"region.polygon has {len(corner)} corners: it must have at least 3, and edges that do not cross"
        )
    return corner if signed_area(edges_of(corner)) > 0.0 else corner[::-1]


def _wedges(given: Any) -> list[Sides]:
    """Return convex wedges that fill a range of directions."""
    start, end = checks.vector("region.angle", given)
    if not start < end <= start + 2.0 * pi * (1.0 + 1e-12):
        raise InputError(
            f"region.angle is ({start}, {end}) rad: the second one must be larger, by at most 2 pi, as in"
            " (-0.5, 0.5)"
        )
    cuts = np.linspace(start, end, 2 if end - start <= pi else 4)
    return [
        [(np.array([sin(a), -cos(a)]), 0.0), (np.array([-sin(b), cos(b)]), 0.0)] for a, b in pairwise(cuts)
    ]


def _box_sides(space: ranges.Region) -> list[Sides]:
    (left, bottom), _, (right, top), _ = box_of(space)
    x, y = np.eye(2)
    return [[(-x, -left), (-y, -bottom), (x, right), (y, top)]]


def _below_surface(now: Snapshot) -> tuple[list[Sides], list[FloatArray]]:
    """Return the columns that hold grains, up to a mean diameter below the uppermost center in each.

    The second part is their union, as one polygon for each run of columns side by side.
    """
    up, reach = upwards(now.scene.gravity_at(now.time)), now.scene.radius_out
    across, bottom = np.array([up[1], -up[0]]), -2.0 * reach  # below all walls
    diameter = 2.0 * float(now.scene.radius.mean())
    count = max(1, min(MOST_COLUMNS, int(reach / diameter)))
    edges = np.linspace(-reach, reach, count + 1)
    grain = np.unique(now.loads.grain) if len(now.loads.grain) else np.arange(now.n)
    column = np.clip(np.searchsorted(edges, now.position[grain] @ across, "right") - 1, 0, count - 1)
    top = np.full(count, -np.inf)
    np.maximum.at(top, column, now.position[grain] @ up)
    edges[[0, -1]] *= 2.0  # beyond the wall, which bounds the outermost columns
    left, right, level = edges[:-1], edges[1:], top - diameter
    held = np.flatnonzero(np.isfinite(top))
    sides: list[Sides] = [[(-across, -left[k]), (across, right[k]), (up, level[k])] for k in held]
    polygons = []
    for run in np.split(held, np.flatnonzero(np.diff(held) > 1) + 1):
        corner = [(left[run[0]], bottom), (right[run[-1]], bottom)]
        corner += [(x, level[k]) for k in run[::-1] for x in (right[k], left[k])]
        polygons.append(np.array(corner) @ np.stack([across, up]))
    return sides, polygons
