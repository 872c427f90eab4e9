"""Packing, velocity and agitation across a domain: by height, and by distance from the origin."""

from typing import NamedTuple

import numpy as np

from warpgrains.analysis.packing import heights, upwards
from warpgrains.analysis.snapshot import HasState, Snapshot, snapshot
from warpgrains.arrays import FloatArray
from warpgrains.scene.geometry import area_below, distance
from warpgrains.scene.walls import outward


class Profile(NamedTuple):
    """Means over slices; a grain counts in each by how much of its area is there. NaN where there is none.

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
    walls, up = moment.scene.walls, upwards(moment.scene.gravity)
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
    walls, rho = moment.scene.walls, distance(moment.position)
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
