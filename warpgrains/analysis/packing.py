"""Heights, packing fractions, and the area of each grain: its radical Voronoi cell, clipped at the walls.

A point belongs to the grain i with the least |x - x_i|^2 - r_i^2. For equal radii this is the Voronoi cell.
For unequal radii it is a cell that no other grain reaches into. These cells are dual to the lower convex hull
of the points (x, y, |x|^2 - r^2) (Aurenhammer, Power diagrams, 1987): a facet z = 2 c . x + d of the hull
corresponds to a corner c of the cells of its three grains.
"""

import numpy as np

from warpgrains.analysis.region_table import Where, region_of
from warpgrains.analysis.snapshot import HasState, Snapshot, snapshot, upwards
from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.errors import requiring
from warpgrains.scene.geometry import area_below, area_in_disc
from warpgrains.scene.walls import Annulus
from warpgrains.solver.final_states import StackedGrains

BEYOND = 10.0  # in radii of the outer wall: three auxiliary points there close the outermost cells


def heights(of: Snapshot | HasState) -> FloatArray:
    """Return the heights of the grains' centers above the origin, against gravity [m], shape (n,).

    Examples
    --------
    >>> analysis.heights(simulation).shape
    (15,)
    """
    return _heights(snapshot(of).grains)[0]


def _heights(grains: StackedGrains) -> FloatArray:
    return (grains.position @ upwards(grains.gravity)[..., np.newaxis])[..., 0]


def pile_height(of: Snapshot | HasState) -> float:
    """Return the height of the highest point of a grain above the lowest point of the walls [m].

    Examples
    --------
    >>> f"{analysis.pile_height(simulation):.3f} m"
    '1.638 m'
    """
    return pile_heights(snapshot(of).grains).item()


def pile_heights(grains: StackedGrains) -> FloatArray:
    """Return the pile heights of many runs [m], shape (m,)."""
    return (_heights(grains) + grains.radius).max(axis=-1) + grains.annulus.depth


def packing_fraction(of: Snapshot | HasState, region: Where = None) -> float:
    """Return the fraction of the area between the walls that grains fill, below their mean height.

    The mean height is weighted by area. A pile is dense below it, so that neither its loose surface nor the
    empty space above counts. Grains and space are cut exactly at that height.
    The whole area of a disc inside the annulus is that of a wall. Rings are not considered.

    Parameters
    ----------
    of : Snapshot or Simulation
    region : mapping, optional
        Region in which the fraction is measured instead, see `region_of`: the area of all grains that have
        their centers in it, each as a whole, divided by its area, of which discs inside are no part. At a
        border within the packing some grains stick out, and parts of others stick in.

    Examples
    --------
    >>> round(analysis.packing_fraction(simulation), 3)
    0.672
    >>> round(analysis.packing_fraction(simulation, region={"below": -1.5}), 3)
    0.485
    """
    if region is not None:
        now, counted = snapshot(of), region_of(of, region)
        radius = now.scene.radius[counted.contains(now.position)]
        return float(np.pi * (radius**2).sum() / counted.area)
    return packing_fractions(snapshot(of).grains).item()


def packing_fractions(grains: StackedGrains) -> FloatArray:
    """Return the packing fractions of many runs, shape (m,)."""
    radius, height, mean = grains.radius, _heights(grains), mean_heights(grains)
    return area_below(radius, mean[:, np.newaxis] - height).sum(axis=-1) / space_below(grains, mean)


def space_below(grains: StackedGrains, level: FloatArray) -> FloatArray:
    """Return the area between the walls, without discs inside, below levels [m] of many runs [m2], (m,)."""
    height = (grains.discs[..., :2] @ upwards(grains.gravity)[..., np.newaxis])[..., 0]
    discs = area_below(grains.discs[..., 2], level[:, np.newaxis] - height).sum(axis=-1)
    space: FloatArray = grains.annulus.area_below(level) - discs
    return space


def mean_heights(grains: StackedGrains) -> FloatArray:
    """Return the mean heights of the grains of many runs, weighted by area [m], shape (m,)."""
    area = grains.radius**2
    return (area * _heights(grains)).sum(axis=-1) / area.sum(axis=-1)


def global_packing_fraction(of: Snapshot | HasState) -> float:
    """Return the fraction of the whole area between the walls that grains fill.

    Examples
    --------
    >>> round(analysis.global_packing_fraction(simulation), 4)
    0.04
    """
    scene = snapshot(of).scene
    return float(np.pi * (scene.radius**2).sum() / scene.area)


def cell_areas(of: Snapshot | HasState) -> FloatArray:
    """Return the area of each grain's radical Voronoi cell between the walls [m2], shape (n,).

    Raises
    ------
    InputError
        scipy is not installed; it comes with the extra ``[report]``.

    Examples
    --------
    >>> bool(np.isclose(analysis.cell_areas(simulation).sum(), simulation.scene.annulus.area))
    True
    """
    now = snapshot(of)
    return radical_cell_areas(now.position, now.scene.radius, now.scene.annulus)


def local_packing_fractions(of: Snapshot | HasState) -> FloatArray:
    """Return the fraction of its cell that each grain fills, shape (n,); see `cell_areas`.

    Examples
    --------
    >>> analysis.local_packing_fractions(simulation).shape
    (15,)
    """
    now = snapshot(of)
    return np.pi * now.scene.radius**2 / cell_areas(now)


def radical_cell_areas(position: FloatArray, radius: FloatArray, annulus: Annulus) -> FloatArray:
    """Return the areas of the cells of discs between the walls [m2], shape (n,)."""
    grain, corner = _corners(position / annulus.radius_out, radius / annulus.radius_out)
    _, first, count = np.unique(grain, return_index=True, return_counts=True)
    middle = np.repeat(np.add.reduceat(corner, first) / count[:, np.newaxis], count, axis=0)
    around = np.arctan2(*(corner - middle).T[::-1])
    corner = corner[np.lexsort((around, grain))]  # by angle, because each cell is convex
    onward = np.arange(1, len(grain) + 1)
    onward[first + count - 1] = first
    inner = annulus.radius_in / annulus.radius_out
    area = area_in_disc(corner, corner[onward], 1.0) - area_in_disc(corner, corner[onward], inner)
    return np.asarray(annulus.radius_out**2 * np.bincount(grain, area, len(position)), np.float64)


def _corners(position: FloatArray, radius: FloatArray) -> tuple[IndexArray, FloatArray]:
    """Return the corners of all cells, shape (c, 2), and the grain of each corner, in ascending order.

    Lengths are in units of the outer radius.
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
