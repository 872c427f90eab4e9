"""Distributions of grains: profiles by height and by distance from the origin, and distances of pairs."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from warpgrains.analysis.packing import heights, mean_heights, upwards
from warpgrains.analysis.snapshot import HasState, Snapshot, snapshot
from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.errors import InputError, missing_extra
from warpgrains.scene.geometry import area_below, distance
from warpgrains.scene.region import Region, region_of
from warpgrains.scene.walls import Annulus, outward


class Profile(NamedTuple):
    """Means over slices; a grain counts in each by how much of its area is inside; NaN without grains.

    Examples
    --------
    >>> analysis.height_profile(simulation)._fields
    ('edges', 'packing_fraction', 'velocity', 'temperature')
    """

    edges: FloatArray
    """Edges of the slices [m], shape (bins + 1,)."""
    packing_fraction: FloatArray
    """Share of the space that grains fill, shape (bins,)."""
    velocity: FloatArray
    """Mean velocity [m/s], shape (bins, 2); its component along the profile, and a quarter turn to the left
    of it. By height these are up and to the left, by radius outwards and anticlockwise."""
    temperature: FloatArray
    """Granular temperature, about the mean of the slice [m2/s2], shape (bins,)."""


def height_profile(of: Snapshot | HasState, bins: int = 20) -> Profile:
    """Return means over slices across gravity, from the lowest point of the walls to the highest.

    Heights are measured from the origin.

    Examples
    --------
    >>> profile = analysis.height_profile(simulation, bins=8)
    >>> profile.packing_fraction.round(2)
    array([0.48, 0.  , 0.  , 0.01, 0.  , 0.  , 0.  , 0.  ])
    """
    moment = snapshot(of)
    walls, up = moment.scene.annulus, upwards(moment.scene.gravity)
    edges = np.linspace(-walls.depth, walls.depth, bins + 1)
    height = heights(moment)
    area = np.array([area_below(moment.scene.radius, edge - height) for edge in edges])
    room = np.array([walls.area_below(edge) for edge in edges])
    return _profile(edges, area, room, _components(moment.velocity, np.broadcast_to(up, (moment.n, 2))))


def radial_profile(of: Snapshot | HasState, bins: int = 20) -> Profile:
    """Return means over rings between the walls, by distance from the origin.

    Examples
    --------
    >>> analysis.radial_profile(simulation, bins=6).packing_fraction.round(2)
    array([0.01, 0.02, 0.  , 0.  , 0.03, 0.12])
    """
    moment = snapshot(of)
    walls, rho = moment.scene.annulus, distance(moment.position)
    edges = np.linspace(walls.radius_in, walls.radius_out, bins + 1)
    area = np.array([_lens(rho, moment.scene.radius, edge) for edge in edges])
    with np.errstate(invalid="ignore"):  # at the origin nothing is outwards
        along = np.nan_to_num(outward(moment.position))
    return _profile(edges, area, np.pi * edges**2, _components(moment.velocity, along))


def _components(velocity: FloatArray, along: FloatArray) -> FloatArray:
    """Return velocities along unit vectors and a quarter turn to their left, shape (n, 2)."""
    left = np.stack([-along[:, 1], along[:, 0]], axis=1)
    return np.stack([(velocity * along).sum(axis=1), (velocity * left).sum(axis=1)], axis=1)


def _profile(edges: FloatArray, area: FloatArray, room: FloatArray, velocity: FloatArray) -> Profile:
    """Return means over slices; areas below edges are of grains, (bins + 1, n), and of space, (bins + 1,)."""
    weight = np.diff(area, axis=0)
    total = weight.sum(axis=1)
    with np.errstate(invalid="ignore"):
        share = weight / total[:, np.newaxis]
    mean = share @ velocity
    temperature = 0.5 * (share @ (velocity**2).sum(axis=1) - (mean**2).sum(axis=1))
    return Profile(edges, total / np.diff(room), mean, np.maximum(temperature, 0.0))


def _lens(rho: FloatArray, radius: FloatArray, edge: float) -> FloatArray:
    """Return the areas [m2] that discs rho from the origin share with one of radius `edge` about it."""
    touching = (rho < edge + radius) & (rho > np.abs(edge - radius))
    area = np.where(rho <= np.abs(edge - radius), np.pi * np.minimum(radius, edge) ** 2, 0.0)
    d, r = rho[touching], radius[touching]
    near = (d**2 + r**2 - edge**2) / (2.0 * d)  # of the common chord, from the centre of the disc
    far = d - near
    half = np.sqrt(np.maximum(r**2 - near**2, 0.0))
    area[touching] = (
        r**2 * np.arctan2(half, near) - near * half + edge**2 * np.arctan2(half, far) - far * half
    )
    return area


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
    InputError
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
        return region_of(scene.annulus, dict(region), "region"), moment.position
    inner, outer, diameter = scene.radius_in, scene.radius_out, 2.0 * float(scene.radius.mean())
    bulk = Region(Annulus(inner + diameter if inner > 0.0 else 0.0, outer - diameter))
    if not any(scene.gravity):
        return bulk, moment.position
    x, y = upwards(scene.gravity)
    turned = np.stack([moment.position @ np.array([y, -x]), heights(moment)], axis=1)
    return bulk._replace(high=(np.inf, mean_heights(moment.grains).item())), turned


def _of_centres(region: Region, moment: Snapshot) -> Region:
    """Return the part of a region that the walls leave to centres of the smallest grains."""
    smallest, walls = moment.scene.radius.min(), moment.scene.annulus
    near = walls.radius_in + smallest if walls.radius_in > 0.0 else 0.0
    near, far = max(region.ring.radius_in, near), min(region.ring.radius_out, walls.radius_out - smallest)
    left = region._replace(ring=Annulus(near, far))
    if near >= far or left.area <= 0.0:
        raise InputError(
            f"the region has no point for the center of a grain of radius {smallest:g} m:"
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
