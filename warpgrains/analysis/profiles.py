"""Profiles over height and over distance from the origin."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from warpgrains.analysis.packing import heights, space_below
from warpgrains.analysis.region import Region
from warpgrains.analysis.region_table import Where, region_of
from warpgrains.analysis.snapshot import HasState, Snapshot, snapshot, upwards
from warpgrains.arrays import FloatArray
from warpgrains.scene.geometry import area_below, directions, distance, left_of


class Profile(NamedTuple):
    """Means over slices, in which each grain is weighted by its area inside; NaN without grains.

    In a region, each grain that has its center there counts as a whole, in the slice of its center.

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


def height_profile(of: Snapshot | HasState, bins: int = 20, region: Where = None) -> Profile:
    """Return means over slices perpendicular to gravity.

    They reach from the lowest to the highest point of the walls.

    Heights are measured from the origin.

    Parameters
    ----------
    of : Snapshot or Simulation
    bins : int
    region : mapping, optional
        Region whose parts the slices are, see `region_of`; without area in it, their packing fraction is NaN.

    Examples
    --------
    >>> profile = analysis.height_profile(simulation, bins=8)
    >>> profile.packing_fraction.round(2)
    array([0.48, 0.  , 0.  , 0.01, 0.  , 0.  , 0.  , 0.  ])
    """
    now = snapshot(of)
    annulus, up = now.scene.annulus, upwards(now.scene.gravity_at(now.time))
    edges = np.linspace(-annulus.depth, annulus.depth, bins + 1)
    height, grains = heights(now), now.grains
    if region is not None:
        counted = region_of(now, region)
        space = np.array([counted.between(up, low, high).area for low, high in pairwise(edges)])
        area = _whole_areas(now, counted, edges, height)
    else:
        space = np.diff([space_below(grains, np.array([edge])).item() for edge in edges])
        area = np.diff([area_below(now.scene.radius, edge - height) for edge in edges], axis=0)
    return _means(edges, area, space, now.velocity, np.broadcast_to(up, (now.n, 2)))


def radial_profile(of: Snapshot | HasState, bins: int = 20, region: Where = None) -> Profile:
    """Return means over rings about the origin between the walls.

    Parameters
    ----------
    of, bins, region
        See `height_profile`.

    Examples
    --------
    >>> analysis.radial_profile(simulation, bins=6).packing_fraction.round(2)
    array([0.01, 0.02, 0.  , 0.  , 0.03, 0.12])
    """
    now = snapshot(of)
    annulus, rho = now.scene.annulus, distance(now.position)
    edges = np.linspace(annulus.radius_in, annulus.radius_out, bins + 1)
    if region is not None:
        counted = region_of(now, region)
        space = np.array([counted.ring(near, far).area for near, far in pairwise(edges)])
        area = _whole_areas(now, counted, edges, rho)
    else:
        space = np.diff(np.pi * edges**2)
        area = np.diff([_lens(rho, now.scene.radius, edge) for edge in edges], axis=0)
    return _means(edges, area, space, now.velocity, directions(now.position))


def _whole_areas(now: Snapshot, region: Region, edges: FloatArray, at: FloatArray) -> FloatArray:
    """Return the areas of the grains of a region in the slices of their centers, at coordinates [m]."""
    whole = np.pi * now.scene.radius**2 * region.contains(now.position)
    in_slice = np.searchsorted(edges, at, "right") - 1 == np.arange(len(edges) - 1)[:, np.newaxis]
    return in_slice * whole


def _means(
    edges: FloatArray, weight: FloatArray, space: FloatArray, velocity: FloatArray, along: FloatArray
) -> Profile:
    """Return means of grains weighted by their areas in slices, shape (bins, n).

    `space` holds the areas of the slices, and `along` the unit vectors along the profile, shape (n, 2).
    """
    velocity = np.stack([(velocity * way).sum(axis=1) for way in (along, left_of(along))], axis=1)
    total = weight.sum(axis=1)
    with np.errstate(invalid="ignore"):
        share = weight / total[:, np.newaxis]
    mean = share @ velocity
    temperature = 0.5 * (share @ (velocity**2).sum(axis=1) - (mean**2).sum(axis=1))
    with np.errstate(invalid="ignore"):
        fraction = np.where(space > 0.0, total / space, np.nan)
    return Profile(edges, fraction, mean, np.maximum(temperature, 0.0))


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
