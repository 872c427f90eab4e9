"""How grains are placed about each other: the radial distribution function."""

from typing import NamedTuple

import numpy as np

from warpgrains.analysis.snapshot import HasState, Snapshot, snapshot
from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.errors import missing_extra
from warpgrains.scene.geometry import distance


class RadialDistribution(NamedTuple):
    """Pairs of grains by their distance."""

    edges: FloatArray
    """Edges of the bins [m], shape (bins + 1,)."""
    pairs: IndexArray
    """Pairs i < j in each, shape (bins,)."""
    g: FloatArray
    """g(r), shape (bins,), pairs in each, over those that as many grains had at random places in the space
    that the walls leave to centres."""


def radial_distribution(
    of: Snapshot | HasState, bins: int = 100, reach: float | None = None
) -> RadialDistribution:
    """Return g(r), 1 for grains anywhere between the walls alike.

    The circle of radius r about a grain counts as far as it is between the walls: no pair is missed beyond.

    Parameters
    ----------
    of : Snapshot or Simulation
    bins : int
    reach : float, optional
        Where the bins end [m]; by default five mean diameters.

    Raises
    ------
    SceneError
        scipy is not installed; it comes with the extra ``[report]``.

    Examples
    --------
    >>> edges, pairs, g = analysis.radial_distribution(simulation, bins=10)
    >>> edges.shape, pairs.shape, g.shape
    ((11,), (10,), (10,))
    """
    try:
        from scipy.spatial import cKDTree
    except ModuleNotFoundError as error:
        raise missing_extra("radial_distribution", error) from error
    moment = snapshot(of)
    reach = 10.0 * float(moment.scene.radius.mean()) if reach is None else reach
    i, j = cKDTree(moment.position).query_pairs(reach, output_type="ndarray").T
    apart = distance(moment.position[j] - moment.position[i])
    pairs, edges = np.histogram(apart, bins, (0.0, reach))
    expected = _expected(moment, edges)
    g = np.divide(pairs, expected, out=np.zeros(bins), where=expected > 0.0)
    return RadialDistribution(edges, pairs, g)


def _expected(moment: Snapshot, edges: FloatArray) -> FloatArray:
    """Return how many pairs each bin has if centres are anywhere alike, by the rule of the middle."""
    smallest, walls, n = moment.scene.radius.min(), moment.scene.walls, moment.n
    outer = walls.radius_out - smallest
    inner = walls.radius_in + smallest if walls.radius_in > 0.0 else 0.0
    area = np.pi * (outer**2 - inner**2)
    rho = distance(moment.position)
    middle = 0.5 * (edges[1:] + edges[:-1])
    shown = [(_share_inside(rho, r, outer) - _share_inside(rho, r, inner)).sum() for r in middle]
    return 0.5 * (n - 1) / area * 2.0 * np.pi * middle * np.diff(edges) * np.array(shown)


def _share_inside(rho: FloatArray, r: float, radius: float) -> FloatArray:
    """Return which share of a circle of radius r, about points rho from the origin, is in a disc about it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = (radius**2 - rho**2 - r**2) / (2.0 * rho * r)
    return 1.0 - np.arccos(np.clip(np.nan_to_num(cosine, nan=1.0), -1.0, 1.0)) / np.pi
