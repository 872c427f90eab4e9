"""Heights, packing fractions, and the area of each grain: its radical Voronoi cell, clipped at the walls.

A point belongs to the grain i with the least |x - x_i|^2 - r_i^2. For equal radii this is the Voronoi cell.
For unequal radii it is a cell that no other grain reaches into. These cells are dual to the lower convex hull
of the points (x, y, |x|^2 - r^2) (Aurenhammer, Power diagrams, 1987): a facet z = 2 c . x + d of the hull
corresponds to a corner c of the cells of its three grains.
"""

from dataclasses import replace

import numpy as np

from warpgrains.analysis.region_table import Where, region_of
from warpgrains.analysis.snapshot import HasState, of_runs, snapshot
from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray, IndexArray
from warpgrains.base.errors import NoAreaError, requiring
from warpgrains.scene.snapshot import Snapshot, Snapshots
from warpgrains.space.geometry import area_below, area_in_disc, distance
from warpgrains.space.region import Region, sides_of

BEYOND = 10.0  # distance, in sizes of the region, of three auxiliary points that close the outermost cells


def _heights(grains: Snapshots) -> FloatArray:
    return (grains.position @ grains.up[..., np.newaxis])[..., 0]


@of_runs
def pile_height(of: Snapshots) -> FloatArray:
    """Return the height of the highest point of a grain above the lowest point of the container [m].

    For the container, see `region_of`. The height is NaN in a box that is periodic in both directions.

    Raises
    ------
    NoAreaError
        The container is unknown. Of several scenes, the result is NaN instead.

    Examples
    --------
    >>> f"{analysis.pile_height(simulation):.3f} m"
    '1.638 m'
    """
    lowest = -of.circles[:, 1]
    for k, container in of.containers.items():
        span = container.region.span(container.up)
        lowest[k] = span[0] if container.is_known and not container.walled.period.repeats.all() else np.nan
    return (_heights(of) + of.radius).max(axis=-1) - lowest


def packing_fraction(of: Snapshot | HasState, region: Where = None) -> float:
    """Return the fraction of the container, or of a region, that grains fill.

    Walls that are discs do not count as space.

    Parameters
    ----------
    region : mapping, optional
        See `region_of`. Grains are cut exactly at its border.

    Raises
    ------
    NoAreaError
        The container is open or unknown, or the region has no area, see `region_of`.

    Examples
    --------
    >>> round(analysis.packing_fraction(simulation), 4)
    0.04
    >>> round(analysis.packing_fraction(simulation, region={"below": -1.5}), 3)
    0.48
    """
    now = snapshot(of)
    counted, radius = region_of(now, region), now.scene.radius
    areas = np.pi * radius**2 if region is None else counted.areas(now.position, radius)
    return float(areas.sum() / counted.area)


@of_runs
def pile_packing_fraction(of: Snapshots) -> FloatArray:
    """Return the fraction that grains fill of the container below their mean height.

    The mean height is weighted by area. A pile is dense below this height, so that neither the loose surface
    nor the empty space above counts. Grains and space are cut exactly at this height, or at the mouth of the
    container if it is lower. Walls that are discs do not count as space.

    Raises
    ------
    NoAreaError
        The container is unknown. Of several scenes, the result is NaN instead.

    Examples
    --------
    >>> round(analysis.pile_packing_fraction(simulation), 3)
    0.672
    """
    level = mean_heights(of)
    for k, container in of.containers.items():
        level[k] = min(level[k], container.mouth)
    inner, outer = (area_below(circle, level) for circle in of.circles.T)
    space = outer - inner
    for k, container in of.containers.items():
        space[k] = container.walled.cut((container.up, level[k])).area if container.is_known else np.nan
    filled: FloatArray = area_below(of.radius, level[:, np.newaxis] - _heights(of)).sum(axis=-1)
    return filled / space


def mean_heights(grains: Snapshots) -> FloatArray:
    """Return the mean height of the grains, weighted by area, of each of m scenes [m], shape (m,).

    It is inf in a box that is periodic in both directions, where heights have no meaning.
    """
    area = grains.radius**2
    level: FloatArray = (area * _heights(grains)).sum(axis=-1) / area.sum(axis=-1)
    level[[k for k, container in grains.containers.items() if container.walled.period.repeats.all()]] = np.inf
    return level


def cell_areas(of: Snapshot | HasState) -> FloatArray:
    """Return the area of each grain's radical Voronoi cell in the container [m2], shape (n,).

    For the container, see `region_of`. If it is open above, cells end at the height of the opening.

    Raises
    ------
    InputError
        scipy is not installed; it comes with the extra ``[report]``. It is a `NoAreaError` if the container
        is unknown, or a center is not in it.

    Examples
    --------
    >>> bool(np.isclose(analysis.cell_areas(simulation).sum(), analysis.region_of(simulation).area))
    True
    """
    now = snapshot(of)
    now.container.require_known(takes_region=False)
    region = now.container.region
    outside = ~region.contains(now.position)
    if outside.any():
        grain = checks.first_bad("position", now.position, outside)
        raise NoAreaError(f"{grain}: it is above the mouth of the container, where it has no cell")
    return radical_cell_areas(region.period.wrapped(now.position), now.scene.radius, region)


def local_packing_fractions(of: Snapshot | HasState) -> FloatArray:
    """Return, for each grain, the fraction of its cell that it fills, shape (n,); see `cell_areas`.

    Examples
    --------
    >>> analysis.local_packing_fractions(simulation).shape
    (15,)
    """
    now = snapshot(of)
    return np.pi * now.scene.radius**2 / cell_areas(now)


def radical_cell_areas(position: FloatArray, radius: FloatArray, region: Region) -> FloatArray:
    """Return the areas of the radical cells of discs, clipped to a region of one polygon [m2], shape (n,)."""
    near, far = region.ring
    size, shifts = float(distance(region.outer_box).max()), region.period.shifts
    images = np.concatenate([position + shift for shift in shifts])
    grain, corner = _corners(images / size, np.tile(radius, len(shifts)) / size)
    corner, grain = corner[grain < len(position)], grain[grain < len(position)]
    _, first, count = np.unique(grain, return_index=True, return_counts=True)
    middle = np.repeat(np.add.reduceat(corner, first) / count[:, np.newaxis], count, axis=0)
    around = np.arctan2(*(corner - middle).T[::-1])
    corner = corner[np.lexsort((around, grain))] * size  # by angle, because each cell is convex
    onward = np.arange(1, len(grain) + 1)
    onward[first + count - 1] = first
    outer, inner = (area_in_disc(corner, corner[onward], ring) for ring in (min(far, BEYOND**2 * size), near))
    area = np.bincount(grain, outer - inner, len(position))
    reach = np.maximum.reduceat(np.hypot(*(corner - position[grain]).T), first)  # of each cell from its grain
    is_cut = np.zeros(len(first), bool)
    others = [circle for circle in region.discs if circle[:2] != (0.0, 0.0)]
    for circle in others:
        to = np.hypot(*region.period.nearest(position[grain[first]] - circle[:2]).T)
        is_cut |= to + reach > circle.radius if circle.keeps_inside else to - reach < circle.radius
    sides = [side for cell in region.cells for side in sides_of(np.array(cell))]
    if min(level for _, level in sides) < far:  # a circle does not bound the region all around
        is_cut |= ~np.logical_and.reduceat(replace(region, discs=tuple(others)).contains(corner), first)
    for start, size, own in zip(first[is_cut], count[is_cut], grain[first[is_cut]], strict=True):
        images = corner[start : start + size] + shifts[:, np.newaxis]
        cells = (replace(region, cells=(tuple(map(tuple, cell.tolist())),)) for cell in images)
        area[own] = sum(cell.within(replace(region, discs=())).area for cell in cells)
    return np.asarray(area, np.float64)


def _corners(position: FloatArray, radius: FloatArray) -> tuple[IndexArray, FloatArray]:
    """Return the grain of each corner of the radical cells, shape (c,), and the corners, shape (c, 2).

    Corners are sorted by grain, but not around a cell. Lengths are in units of the size of the region.
    """
    with requiring("cell areas"):
        from scipy.spatial import ConvexHull
    n, angle = len(position), 2.0 * np.pi * np.arange(3) / 3.0
    places = np.concatenate([position, BEYOND * np.stack([np.cos(angle), np.sin(angle)], axis=1)])
    height = (places**2).sum(axis=1)
    height[:n] -= radius**2
    hull = ConvexHull(np.column_stack([places, height]))
    below = hull.equations[:, 2] < 0.0
    a, b, c, _ = hull.equations[below].T
    corner = np.repeat(np.stack([a, b], axis=1) / (-2.0 * c[:, np.newaxis]), 3, axis=0)
    grain = hull.simplices[below].ravel().astype(np.int64)
    order = np.argsort(grain, kind="stable")[: np.count_nonzero(grain < n)]
    return grain[order], corner[order]
