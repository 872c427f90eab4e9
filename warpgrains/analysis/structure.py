"""How grains are placed about each other: the radial distribution function."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from warpgrains.analysis.packing import heights, mean_heights, upwards
from warpgrains.analysis.snapshot import HasState, Snapshot, snapshot
from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.errors import SceneError, missing_extra
from warpgrains.scene.geometry import distance
from warpgrains.scene.region import Region, region_of
from warpgrains.scene.walls import Annulus


class RadialDistribution(NamedTuple):
    """Pairs of grains by their distance."""

    edges: FloatArray
    """Edges of the bins [m], shape (bins + 1,)."""
    pairs: IndexArray
    """Pairs i < j of grains of the region in each, shape (bins,)."""
    g: FloatArray
    """g(r), shape (bins,): pairs in each, over the mean number of pairs if as many grains were at independent
    random places of the region."""


def radial_distribution(
    of: Snapshot | HasState,
    bins: int = 100,
    reach: float | None = None,
    region: Mapping[str, Sequence[float]] | None = None,
) -> RadialDistribution:
    """Return g(r) of the grains of a region, which tends to 1 where the region is filled evenly.

    Only the part of the circle of radius r about a grain that is in the region counts, so that g(r) is not
    too small near its border. Where a region is partly empty, as the space above a pile is, g(r) tends to
    more than 1: the density, averaged over the region, is smaller than that about a grain.

    Parameters
    ----------
    of : Snapshot or Simulation
    bins : int
    reach : float, optional
        Where the bins end [m]; by default five mean diameters.
    region : mapping, optional
        Ranges [m] of the centres, as `grains.region` of scene files has them: of x, y and distance from
        the origin; without any, ``{}``, all space between the walls. By default the space at least a mean
        diameter from the walls, along which grains are layered, and, where there is gravity, beneath the mean
        height of the grains, weighted by area, as for `packing_fraction`.

    Raises
    ------
    SceneError
        The region is none, or has no space for centres, as the default in a pile of one layer. Or scipy is
        not installed; it comes with the extra ``[report]``.

    Examples
    --------
    >>> edges, pairs, g = analysis.radial_distribution(simulation, bins=10, region={"y": (-2.0, -1.5)})
    >>> edges.shape, pairs.shape, g.shape
    ((11,), (10,), (10,))
    """
    try:
        from scipy.spatial import cKDTree
    except ModuleNotFoundError as error:
        raise missing_extra("radial_distribution", error) from error
    moment = snapshot(of)
    counted, position = _counted(moment, region)
    position = position[counted.contains(position)]
    reach = 10.0 * float(moment.scene.radius.mean()) if reach is None else reach
    i, j = cKDTree(position).query_pairs(reach, output_type="ndarray").T
    pairs, edges = np.histogram(distance(position[j] - position[i]), bins, (0.0, reach))
    expected = _expected(_of_centres(counted, moment), position, edges)
    g = np.divide(pairs, expected, out=np.zeros(bins), where=expected > 0.0)
    return RadialDistribution(edges, pairs, g)


def _counted(moment: Snapshot, region: Any) -> tuple[Region, FloatArray]:
    """Return the region, and the centres [m], shape (n, 2), with up along y if the region is the default."""
    scene = moment.scene
    if region is not None:
        return region_of(scene.walls, dict(region), "region"), moment.position
    inner, outer, diameter = scene.radius_in, scene.radius_out, 2.0 * float(scene.radius.mean())
    bulk = Region(Annulus(inner + diameter if inner > 0.0 else 0.0, outer - diameter))
    if not any(scene.gravity):
        return bulk, moment.position
    x, y = upwards(scene.gravity)
    turned = np.stack([moment.position @ np.array([y, -x]), heights(moment)], axis=1)
    return bulk._replace(high=(np.inf, mean_heights(moment.grains).item())), turned


def _of_centres(region: Region, moment: Snapshot) -> Region:
    """Return the part of a region that the walls leave to centres of the smallest grains."""
    smallest, walls = moment.scene.radius.min(), moment.scene.walls
    near = walls.radius_in + smallest if walls.radius_in > 0.0 else 0.0
    near, far = max(region.ring.radius_in, near), min(region.ring.radius_out, walls.radius_out - smallest)
    left = region._replace(ring=Annulus(near, far))
    if near >= far or left.area <= 0.0:
        raise SceneError(
            f"there is no space for centres of grains of radius {smallest:g} m in the region:"
            " give a larger one, such as region={}"
        )
    return left


def _expected(region: Region, position: FloatArray, edges: FloatArray) -> FloatArray:
    """Return the mean number of pairs in each bin if centres are at random places, by the midpoint rule."""
    middle = 0.5 * (edges[1:] + edges[:-1])
    inside = np.array([share_inside(region, position, r).sum() for r in middle])
    return 0.5 * (len(position) - 1) / region.area * 2.0 * np.pi * middle * np.diff(edges) * inside


def share_inside(region: Region, position: FloatArray, r: float) -> FloatArray:
    """Return the share of the circle of radius r [m] about each point that is in a region, shape (n,).

    The circle is cut where it crosses the circles and lines that bound the region; an arc between two
    cuts is inside if its middle is.
    """
    rho, towards = distance(position), np.arctan2(position[:, 1], position[:, 0])
    cuts = [np.zeros(len(position))]
    with np.errstate(divide="ignore", invalid="ignore"):
        for radius in (region.ring.radius_in, region.ring.radius_out):
            half = np.arccos((radius**2 - rho**2 - r**2) / (2.0 * rho * r))
            cuts += [towards - half, towards + half]
        for corner in (region.low, region.high):
            x, y = ((np.array(corner) - position) / r).T
            cuts += [np.arccos(x), -np.arccos(x), np.arcsin(y), np.pi - np.arcsin(y)]
    start = np.sort(np.nan_to_num(np.stack(cuts, axis=1)) % (2.0 * np.pi), axis=1)
    arc = np.diff(start, axis=1, append=2.0 * np.pi)
    middle = start + 0.5 * arc
    place = position[:, np.newaxis] + r * np.stack([np.cos(middle), np.sin(middle)], axis=-1)
    return np.asarray((arc * region.contains(place)).sum(axis=1) / (2.0 * np.pi))
