"""Radial distribution functions of the centers of grains: of all grains, and between kinds of grains."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from warpgrains.analysis.packing import mean_heights
from warpgrains.analysis.region_table import Where, region_of
from warpgrains.analysis.snapshot import HasState, snapshot
from warpgrains.base import checks
from warpgrains.base.arrays import BoolArray, FloatArray, IndexArray
from warpgrains.base.errors import InputError, NoAreaError, requiring
from warpgrains.scene.snapshot import Snapshot
from warpgrains.space.geometry import distance
from warpgrains.space.region import Region


class RadialDistribution(NamedTuple):
    """Radial distribution function of grain centers, of all grains or between k kinds."""

    edges: FloatArray
    """Edges of the bins [m], shape (bins + 1,)."""
    pairs: IndexArray
    """Number of pairs of grains i < j in each bin of distance, shape (bins,). Both centers are in the region.
    With kinds, the number of pairs of a grain of kind a and a grain of kind b, each pair counted once, shape
    (k, k, bins), symmetric."""
    g: FloatArray
    """g(r) or g_ab(r), in the shape of `pairs`: `pairs` divided by its expectation for the same numbers of
    independent, uniformly random points in the region."""


def radial_distribution(
    of: Snapshot | HasState,
    bins: int = 100,
    reach: float | None = None,
    region: Where = None,
    kinds: int | ArrayLike | None = None,
) -> RadialDistribution:
    """Return g(r) of the grains in a region; it tends to 1 if the region is filled uniformly.

    Only the part of the circle of radius r about a grain that lies in the region counts, so that the border
    does not bias g(r). If a region is partly empty, like the space above a pile, g(r) tends to more than 1,
    because the mean density of the region is smaller than the density around a grain.

    Parameters
    ----------
    bins : int
    reach : float, optional
        Upper end of the bins [m]; by default five mean diameters. In a periodic box, it is at most half a
        side.
    region : mapping, optional
        Region of the centers, see `region_of`; ``{}`` is the whole space between the walls. The default
        excludes a mean diameter along the walls, where grains are layered, and under gravity the space above
        the mean height of the grains, weighted by area, as for `pile_packing_fraction`.
    kinds : int or array_like, optional
        For g_ab(r) between kinds a and b: a label for each grain, integers of shape (n,); or a number of
        classes, see `radius_classes`. Kinds are ordered by their labels.

    Raises
    ------
    InputError
        The region is invalid or has no space for centers, as the default in a pile of one layer; labels are
        not n integers; or scipy is not installed, which the extra ``[report]`` installs.

    Examples
    --------
    >>> edges, pairs, g = analysis.radial_distribution(simulation, bins=10, region={"y": (-2.0, -1.5)})
    >>> edges.shape, pairs.shape, g.shape
    ((11,), (10,), (10,))
    >>> analysis.radial_distribution(simulation, bins=10, region={}, kinds=np.arange(15) % 3).g.shape
    (3, 3, 10)
    """
    now = snapshot(of)
    if kinds is None:
        found = _of_kinds(now, np.zeros(now.n, np.int64), bins, reach, region)
        return RadialDistribution(found.edges, found.pairs[0, 0], found.g[0, 0])
    label = np.asarray(radius_classes(now, kinds) if isinstance(kinds, int) else kinds)
    if label.shape != (now.n,) or label.dtype.kind not in "iu":
        raise InputError(f"kinds has shape {label.shape} and type {label.dtype}: it must be {now.n} integers")
    return _of_kinds(now, label, bins, reach, region)


def radius_classes(of: Snapshot | HasState, count: int = 2) -> IndexArray:
    """Return the class of each grain by its radius, shape (n,): 0 for the smallest grains, then 1, 2, ...

    With at most `count` different radii, each is a class. Otherwise the classes have about equal numbers of
    grains: they are divided at quantiles of the radii, and equal radii belong to one class.

    Examples
    --------
    >>> np.bincount(analysis.radius_classes(wg.Simulation("bidisperse")))  # grains of each class
    array([103,  97])
    """
    radius = snapshot(of).scene.radius
    checks.whole_number("count", count)
    different, found = np.unique(radius, return_inverse=True)
    if len(different) <= count:
        return np.asarray(found, np.int64)
    limits = np.quantile(radius, np.arange(1, count) / count)
    return np.searchsorted(limits, radius, "left").astype(np.int64)


def _of_kinds(
    now: Snapshot, label: IndexArray, bins: int, reach: float | None, region: Where
) -> RadialDistribution:
    """Return edges, pairs and g(r) of the grains in a region; `label` is the kind of each grain, (n,)."""
    with requiring("radial_distribution"):
        from scipy.spatial import cKDTree
    counted, position = counted_region(now, region), now.position
    bins = checks.whole_number("bins", bins)
    cell = counted.period
    most = 0.5 * float(min(cell.lengths[cell.repeats], default=np.inf))
    mean = float(now.scene.radius.mean())
    reach = min(10.0 * mean, most) if reach is None else checks.positive("reach", reach)
    if reach > most:
        raise InputError(f"reach is {reach} m: in this periodic box it must be at most {most} m, half of it")
    inside = counted.contains(position)
    kinds, kind = np.unique(label, return_inverse=True)
    position, kind, k = position[inside], kind[inside], len(kinds)
    tree = cKDTree(cell.from_corner(position), boxsize=cell.lengths if cell else None)
    i, j = tree.query_pairs(reach, output_type="ndarray").T
    apart = distance(cell.nearest(position[j] - position[i]))
    of_pair = kind[i] * k + kind[j]
    edges = np.linspace(0.0, reach, bins + 1)
    counts = [np.histogram(apart[of_pair == one], bins, (0.0, reach))[0] for one in range(k * k)]
    pairs = np.array(counts).reshape(k, k, bins)
    pairs = pairs + pairs.swapaxes(0, 1) * ~np.eye(k, dtype=bool)[..., np.newaxis]
    smallest = now.scene.smallest_radius
    reachable = counted.within(now.container.walled.without_layer(smallest))
    if reachable.area <= 0.0:
        raise NoAreaError(
            f"the region has no point for the center of a grain of radius {smallest:g} m: give a larger one"
        )
    expected = _expected(reachable, position, [kind == one for one in range(k)], edges)
    g = np.divide(pairs, expected, out=np.zeros(pairs.shape), where=expected > 0.0)
    return RadialDistribution(edges, pairs, g)


def _expected(
    region: Region, position: FloatArray, of_kind: list[BoolArray], edges: FloatArray
) -> FloatArray:
    """Return the number of pairs to expect in each bin for random centers, shape (k, k, bins).

    `of_kind` holds a mask for each of k kinds, which marks the grains of this kind among those at `position`
    [m], shape (n, 2). The integral over a bin is computed by the midpoint rule.
    """
    middle, k = 0.5 * (edges[1:] + edges[:-1]), len(of_kind)
    inside, clearance = np.empty((k, len(middle))), region.clearance(position)
    for b, r in enumerate(middle):
        share = (clearance > 0.0).astype(np.float64)
        cut = np.flatnonzero(np.abs(clearance) <= r)
        share[cut] = region.angles(position[cut], np.full(len(cut), r)) / (2.0 * np.pi)
        inside[:, b] = [share[own].sum() for own in of_kind]
    others = np.tile([float(own.sum()) for own in of_kind], (k, 1)) - np.eye(k)
    half = 0.5 * others[..., np.newaxis] / region.area * 2.0 * np.pi * middle * np.diff(edges)
    ways = half * inside[:, np.newaxis]  # from a grain of kind a to another one of kind b
    return ways + ways.swapaxes(0, 1) * ~np.eye(k, dtype=bool)[..., np.newaxis]


def counted_region(now: Snapshot, region: Where) -> Region:
    """Return the region of a table, see `region_of`; for None, the part of the container that counts.

    This part is at least a mean diameter away from the walls and, under gravity, below the grains' mean
    height.
    """
    if region is not None:
        return region_of(now, region)
    scene, level, container = now.scene, mean_heights(now.grains).item(), now.container
    is_pile = bool(np.dot(scene.gravity_at(now.time), container.up))
    container.require_known()
    space = container.walled if is_pile and level <= container.mouth else container.closed()
    bulk = space.without_layer(2.0 * float(scene.radius.mean()))
    return bulk.cut((container.up, level)) if is_pile else bulk
