"""Regions as tables: ranges, sectors, convex polygons, and the space below the surface of a pile."""

from collections.abc import Mapping
from itertools import pairwise
from math import cos, pi, sin
from typing import Any

import numpy as np

from warpgrains.analysis.snapshot import HasState, snapshot
from warpgrains.base import checks
from warpgrains.base.arrays import BoolArray
from warpgrains.base.errors import InputError, NoAreaError
from warpgrains.base.shown import number_of
from warpgrains.scene.snapshot import Snapshot
from warpgrains.space import region as ranges
from warpgrains.space.region import Region, Side, sides_of

KEYS = (*ranges.RANGES, "angle", "polygon", "below")
MOST_COLUMNS = 64  # largest number of columns to find the surface of a pile

Where = Mapping[str, Any] | Region | None
"""Argument of functions that count in a region; None is the whole container."""


def region_of(of: Snapshot | HasState, region: Where = None) -> Region:
    """Return the part of the container of the grains in which all conditions of a table hold.

    The container is the space between the circles, or between the sides of the box at their present places,
    minus discs inside. Segments have to form a convex polygon around the grains. If it is open above,
    the container ends at the height of the opening. With other walls, or segments that cut the space
    otherwise, the container is unknown; the region is then a part of the space between the circles or sides.
    In periodic directions, grains count where their images in the box are.

    Parameters
    ----------
    region : mapping, optional
        None or ``{}`` is the whole container. Keys, all optional:

        - ``x``, ``y``, ``distance``: ranges [m] of coordinates and of the distance from the origin, as for
          `grains.region` of scene files;
        - ``angle``: range [rad] of the direction from the origin, counter-clockwise from the x axis. The
          second number is the larger one, by at most 2 pi. With ``distance`` it is a sector of the annulus;
        - ``polygon``: corners [m] of a convex polygon, shape (k, 2), in either order;
        - ``below``: a height above the origin, against gravity [m], or ``"surface"``. The latter is the space
          that is at least a mean diameter below the surface of a pile, which leaves out its rough top. The
          surface is at the highest center of a grain in each of the columns into which the space is divided.
          The columns are at least two mean diameters and at least 1/64 of the domain wide. Only grains
          with a contact count, if any has one. A column without grains is not part of the region.

    Returns
    -------
    Region
        The border belongs to the region.

    Raises
    ------
    InputError
        A key is unknown, or a value is invalid. It is a `NoAreaError` if the region is empty, or if the
        container is open and `region` is None or empty, or if the container is unknown and the region is
        bounded neither by ``x`` and ``y``, nor by ``distance`` or ``polygon``.

    Examples
    --------
    >>> import math
    >>> quarter = analysis.region_of(simulation, {"angle": (-math.pi / 2, 0.0), "distance": (1.0, 2.0)})
    >>> math.isclose(quarter.area, math.pi * (2.0**2 - 1.0**2) / 4)
    True
    """
    if isinstance(region, Region):
        return region
    now = snapshot(of)
    if not region:
        return now.container.closed()
    if not isinstance(region, Mapping):
        raise InputError(f"region is {region!r}: it must be a table such as {{'x': (-1.0, 0.0)}}")
    for key in region:
        checks.one_of("key of region", key, KEYS)
    own = {key: region[key] for key in region if key in ranges.RANGES}
    found = ranges.region_of(now.scene.space_at(now.time), own, "region")
    for key, cells_of in _CELLS.items():
        if key in region:
            found = found.split(cells_of(now, region[key]))
    container = now.container
    if not ({"x", "y"} <= region.keys() or region.keys() & {"distance", "polygon"}):
        container.require_known()
    found = found.within(container.region)
    if found.area <= 0.0:
        raise NoAreaError(f"region is {dict(region)!r}: no point between the walls lies in it")
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


def _polygon(_: Snapshot, given: Any) -> list[list[Side]]:
    corner = checks.vectors("region.polygon", given, of="corner")
    x, y = corner.T
    clockwise = float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) < 0.0
    sides = list(sides_of(corner[::-1] if clockwise else corner))
    rounding = 1e-9 * float(np.ptp(corner, axis=0).max(initial=0.0))
    if len(corner) < 3 or any((corner @ normal > level + rounding).any() for normal, level in sides):
        corners = number_of(len(corner), "corner")
        raise InputError(f"region.polygon has {corners}: it must have at least 3, and be convex")
    return [sides]


def _wedges(_: Snapshot, given: Any) -> list[list[Side]]:
    """Return convex wedges that together fill a range of angles [rad]. Each is a list of half planes."""
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


def _below(now: Snapshot, given: Any) -> list[list[Side]]:
    """Return the cells of the key `below`, each as a list of half planes.

    A height has one cell, the half plane below it; "surface" has one cell for each column of a pile.
    """
    up, space = now.scene.up_at(now.time), now.scene.space_at(now.time)
    if not isinstance(given, str):
        return [[(up, checks.number("region.below", given))]]
    checks.one_of("region.below", given, ["surface"])
    across, diameter = np.array([up[1], -up[0]]), 2.0 * float(now.scene.radius.mean())
    low, high = space.span(across)
    count = max(1, min(MOST_COLUMNS, int((high - low) / 2.0 / diameter)))
    edges = np.linspace(low, high, count + 1)
    grain = np.unique(now.loads.grain) if len(now.loads.grain) else np.arange(now.n)
    place = space.period.wrapped(now.position[grain])
    column = np.clip(np.searchsorted(edges, place @ across, "right") - 1, 0, count - 1)
    top = np.full(count, -np.inf)
    np.maximum.at(top, column, place @ up)
    edges[0], edges[-1] = low - (high - low), high + (high - low)  # beyond the walls at both ends
    left, right, level = edges[:-1], edges[1:], top - diameter
    held = np.flatnonzero(np.isfinite(top))
    return [[(-across, -left[k]), (across, right[k]), (up, level[k])] for k in held]


_CELLS = {"polygon": _polygon, "angle": _wedges, "below": _below}
"""Functions that read the value of a key. Each returns convex cells, as lists of half planes, that do not
overlap; the region lies in their union."""
