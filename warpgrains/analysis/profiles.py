"""Profiles over height and over distance from the origin, and the radial distribution function."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from warpgrains.analysis.packing import heights, mean_heights, space_below, upwards
from warpgrains.analysis.snapshot import HasState, Snapshot, snapshot
from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.errors import InputError, missing_extra
from warpgrains.scene.geometry import area_below, distance
from warpgrains.scene.region import Region, region_of
from warpgrains.scene.walls import Annulus, outward


class Profile(NamedTuple):
    """Means over slices, in which each grain is weighted by its area inside; NaN without grains.

    Examples
    --------
    >>> analysis.height_profile(simulation)._fields
    ('edges', 'packing_fraction', 'velocity', 'temperature')
    """

    edges: FloatArray
    """Edges of the slices [m], shape (bins + 1,)."""
    packing_fraction: FloatArray
    """Fraction of the area of each slice that grains fill, shape (bins,)."""
    velocity: FloatArray
    """Mean velocity [m/s], shape (bins, 2): the component along the profile, and the one 90 degrees to its
    left. For heights these are upwards and to the left, for radii outwards and counter-clockwise."""
    temperature: FloatArray
    """Granular temperature relative to the mean velocity of the slice [m2/s2], shape (bins,)."""


def height_profile(of: Snapshot | HasState, bins: int = 20) -> Profile:
    """Return means over slices perpendicular to gravity.

    They reach from the lowest to the highest point of the walls.

    Heights are measured from the origin.

    Examples
    --------
    >>> profile = analysis.height_profile(simulation, bins=8)
    >>> profile.packing_fraction.round(2)
    array([0.48, 0.  , 0.  , 0.01, 0.  , 0.  , 0.  , 0.  ])
    """
    now = snapshot(of)
    walls, up = now.scene.annulus, upwards(now.scene.gravity_at(now.time))
    edges = np.linspace(-walls.depth, walls.depth, bins + 1)
    height = heights(now)
    area = np.array([area_below(now.scene.radius, edge - height) for edge in edges])
    grains = now.grains
    space = np.array([space_below(grains, np.array([edge])).item() for edge in edges])
    return _profile(edges, area, space, _components(now.velocity, np.broadcast_to(up, (now.n, 2))))


def radial_profile(of: Snapshot | HasState, bins: int = 20) -> Profile:
    """Return means over rings about the origin between the walls.

    Examples
    --------
    >>> analysis.radial_profile(simulation, bins=6).packing_fraction.round(2)
    array([0.01, 0.02, 0.  , 0.  , 0.03, 0.12])
    """
    now = snapshot(of)
    walls, rho = now.scene.annulus, distance(now.position)
    edges = np.linspace(walls.radius_in, walls.radius_out, bins + 1)
    area = np.array([_lens(rho, now.scene.radius, edge) for edge in edges])
    with np.errstate(invalid="ignore"):  # no outward direction at the origin
        along = np.nan_to_num(outward(now.position))
    return _profile(edges, area, np.pi * edges**2, _components(now.velocity, along))


def _components(velocity: FloatArray, along: FloatArray) -> FloatArray:
    """Return the components of velocities along unit vectors and 90 degrees to their left, shape (n, 2)."""
    left = np.stack([-along[:, 1], along[:, 0]], axis=1)
    return np.stack([(velocity * along).sum(axis=1), (velocity * left).sum(axis=1)], axis=1)


def _profile(edges: FloatArray, area: FloatArray, space: FloatArray, velocity: FloatArray) -> Profile:
    """Return means over slices.

    `area` holds areas below the edges of grains, (bins + 1, n), and `space` those of the space, (bins + 1,).
    """
    weight = np.diff(area, axis=0)
    total = weight.sum(axis=1)
    with np.errstate(invalid="ignore"):
        share = weight / total[:, np.newaxis]
    mean = share @ velocity
    temperature = 0.5 * (share @ (velocity**2).sum(axis=1) - (mean**2).sum(axis=1))
    return Profile(edges, total / np.diff(space), mean, np.maximum(temperature, 0.0))


def _lens(rho: FloatArray, radius: FloatArray, edge: float) -> FloatArray:
    """Return the areas [m2] that discs at distances rho from the origin share with that of radius `edge`."""
    touching = (rho < edge + radius) & (rho > np.abs(edge - radius))
    area = np.where(rho <= np.abs(edge - radius), np.pi * np.minimum(radius, edge) ** 2, 0.0)
    d, r = rho[touching], radius[touching]
    near = (d**2 + r**2 - edge**2) / (2.0 * d)  # distance of the common chord from the center of the disc
    far = d - near
    half = np.sqrt(np.maximum(r**2 - near**2, 0.0))
    area[touching] = (
        r**2 * np.arctan2(half, near) - near * half + edge**2 * np.arctan2(half, far) - far * half
    )
    return area


class RadialDistribution(NamedTuple):
    """Radial distribution function of grain centers."""

    edges: FloatArray
    """Edges of the bins [m], shape (bins + 1,)."""
    pairs: IndexArray
    """Number of pairs i < j in each bin, both in the region, shape (bins,)."""
    g: FloatArray
    """g(r), shape (bins,): `pairs` divided by its expectation for the same number of independent, uniformly
    random points in the region."""


def radial_distribution(
    of: Snapshot | HasState,
    bins: int = 100,
    reach: float | None = None,
    region: Mapping[str, Sequence[float]] | None = None,
) -> RadialDistribution:
    """Return g(r) of the grains in a region; it tends to 1 if the region is filled uniformly.

    Only the part of the circle of radius r about a grain that lies in the region counts, so that the border
    does not bias g(r). If a region is partly empty, like the space above a pile, g(r) tends to more than 1,
    because the mean density of the region is smaller than the density around a grain.

    Parameters
    ----------
    of : Snapshot or Simulation
    bins : int
    reach : float, optional
        Upper end of the bins [m]; by default five mean diameters.
    region : mapping, optional
        Ranges of the centers [m] in x, y and distance from the origin, as for `grains.region` of scene
        files; ``{}`` is the whole space between the walls. The default excludes a mean diameter along the
        walls, where grains are layered, and under gravity the space above the mean height of the grains,
        weighted by area, as for `packing_fraction`.

    Raises
    ------
    InputError
        The region is invalid or has no space for centers, as the default in a pile of one layer; or scipy is
        not installed, which the extra ``[report]`` installs.

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
    now = snapshot(of)
    counted, position = _region_and_centers(now, region)
    position = position[counted.contains(position)]
    reach = 10.0 * float(now.scene.radius.mean()) if reach is None else reach
    i, j = cKDTree(position).query_pairs(reach, output_type="ndarray").T
    pairs, edges = np.histogram(distance(position[j] - position[i]), bins, (0.0, reach))
    expected = _expected(_region_of_centers(counted, now), position, edges)
    g = np.divide(pairs, expected, out=np.zeros(bins), where=expected > 0.0)
    return RadialDistribution(edges, pairs, g)


def _region_and_centers(now: Snapshot, region: Any) -> tuple[Region, FloatArray]:
    """Return region and centers [m], shape (n, 2).

    If the region is the default, they are rotated so that up is y.
    """
    scene = now.scene
    if region is not None:
        return region_of(scene.annulus, dict(region), "region"), now.position
    inner, outer, diameter = scene.radius_in, scene.radius_out, 2.0 * float(scene.radius.mean())
    bulk = Region(Annulus(inner + diameter if inner > 0.0 else 0.0, outer - diameter))
    if not any(scene.gravity):
        return bulk, now.position
    x, y = upwards(scene.gravity_at(now.time))
    turned = np.stack([now.position @ np.array([y, -x]), heights(now)], axis=1)
    return bulk._replace(high=(np.inf, mean_heights(now.grains).item())), turned


def _region_of_centers(region: Region, now: Snapshot) -> Region:
    """Return the part of a region that the centers of the smallest grains can reach."""
    smallest, walls = now.scene.radius.min(), now.scene.annulus
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
    """Return the expected number of pairs in each bin for random centers, by the midpoint rule."""
    middle = 0.5 * (edges[1:] + edges[:-1])
    inside = np.array([share_inside(region, position, r).sum() for r in middle])
    return 0.5 * (len(position) - 1) / region.area * 2.0 * np.pi * middle * np.diff(edges) * inside


def share_inside(region: Region, position: FloatArray, r: float) -> FloatArray:
    """Return the fraction of the circle of radius r [m] about each point inside a region, shape (n,).

    The circle is cut at its intersections with the circles and lines that bound the region. An arc between
    two cuts is inside if its midpoint is.
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
