"""Profiles over height and over distance from the origin."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from warpgrains.analysis.contacts import force_moments, momentum_flow
from warpgrains.analysis.region_table import Where, region_of
from warpgrains.analysis.snapshot import HasState, snapshot
from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.described import fields_in_help
from warpgrains.scene.snapshot import Snapshot
from warpgrains.space.geometry import directions, left_of
from warpgrains.space.region import Region


@fields_in_help
class Profile(NamedTuple):
    """Means over slices, in which each grain is weighted by its area inside the slice.

    Velocity, spin and temperature are NaN in slices without grains.

    Examples
    --------
    >>> analysis.height_profile(simulation)._fields
    ('edges', 'packing_fraction', 'velocity', 'spin', 'temperature', 'stress')
    """

    edges: FloatArray
    """Edges of the slices [m], shape (bins + 1,)."""
    packing_fraction: FloatArray
    """Fraction of the area of each slice that grains fill, shape (bins,)."""
    velocity: FloatArray
    """Mean velocity [m/s], shape (bins, 2): the component along the profile, and the one 90 degrees to its
    left. For heights these are upwards and to the left, for radii outwards and counter-clockwise."""
    spin: FloatArray
    """Mean angular velocity [rad/s], shape (bins,)."""
    temperature: FloatArray
    """Granular temperature relative to the mean velocity of the slice [m2/s2], shape (bins,)."""
    stress: FloatArray
    """Stress [N/m], shape (bins, 2, 2), with the components of `velocity`: the sum over grains as for
    `mean_stress`, each weighted by the share of its area inside, divided by the area of the slice. The
    kinetic part is about the mean velocity of the slice."""


def height_profile(of: Snapshot | HasState, bins: int = 20, region: Where = None) -> Profile:
    """Return means over slices perpendicular to gravity, or along the direction in which a box is periodic.

    The slices reach from the lowest to the highest point of the container, see `region_of`. Heights are
    measured from the origin. Without gravity, they are along y, or along x in a box that is periodic in y.

    Parameters
    ----------
    bins : int
    region : mapping, optional
        Region that is divided into slices, see `region_of`. In a slice without area, the packing fraction is
        NaN.

    Raises
    ------
    InputError
        `bins` is no positive whole number, or the region is invalid. It is a `NoAreaError` if the container
        is unknown.

    Examples
    --------
    >>> profile = analysis.height_profile(simulation, bins=8)
    >>> profile.packing_fraction.round(2)
    array([0.48, 0.  , 0.  , 0.01, 0.  , 0.  , 0.  , 0.  ])
    """
    now = snapshot(of)
    up, counted = now.scene.up_at(now.time), _counted(now, region)
    edges = np.linspace(*now.container.region.span(up), checks.whole_number("bins", bins) + 1)
    areas = counted.slices(up, edges, now.position, now.scene.radius)
    return _means(now, edges, areas, np.broadcast_to(up, (now.n, 2)))


def radial_profile(of: Snapshot | HasState, bins: int = 20, region: Where = None) -> Profile:
    """Return means over rings about the origin in the container.

    Parameters
    ----------
    of, bins, region
        See `height_profile`, which raises the same errors.

    Examples
    --------
    >>> analysis.radial_profile(simulation, bins=6).packing_fraction.round(2)
    array([0.01, 0.02, 0.  , 0.  , 0.03, 0.12])
    """
    now = snapshot(of)
    space, counted = now.scene.space_at(now.time), _counted(now, region)
    near, far = space.ring
    far = min(far, float(np.hypot(*np.abs(space.outer_box).max(axis=0))))
    edges = np.linspace(near, far, checks.whole_number("bins", bins) + 1)
    slices = [counted.distances(near, far) for near, far in pairwise(edges)]
    weight = np.array([one.areas(now.position, now.scene.radius) for one in slices])
    spaces = np.array([one.area for one in slices])
    return _means(now, edges, (weight, spaces), directions(counted.period.wrapped(now.position)))


def _counted(now: Snapshot, region: Where) -> Region:
    """Return a region, by default the container, which ends at its opening if it is open above."""
    if not region:
        now.container.require_known()
        return now.container.region
    return region_of(now, region)


def _means(
    now: Snapshot, edges: FloatArray, slices: tuple[FloatArray, FloatArray], along: FloatArray
) -> Profile:
    """Return the profile of means over slices, whose edges are given [m].

    `slices` holds the area of each grain inside each slice [m2], shape (slices, n), and the areas of the
    slices, shape (slices,). `along` is the unit vector along the profile at each grain, shape (n, 2).
    """
    (weight, space), radius = slices, now.scene.radius
    axes = np.stack([along, left_of(along)], axis=1)
    velocity = np.stack([(now.velocity * way).sum(axis=1) for way in (along, left_of(along))], axis=1)
    moment = axes @ force_moments(now) @ axes.transpose(0, 2, 1)
    total = weight.sum(axis=1)
    with np.errstate(invalid="ignore"):
        share = weight / total[:, np.newaxis]
    mean = share @ velocity
    temperature = 0.5 * (share @ (velocity**2).sum(axis=1) - (mean**2).sum(axis=1))
    with np.errstate(invalid="ignore", divide="ignore"):
        fraction = np.where(space > 0.0, total / space, np.nan)
        inside = weight / (np.pi * radius**2)
        flow = [momentum_flow(own * now.scene.mass, velocity) for own in inside]
        stress = (np.tensordot(inside, moment, 1) + flow) / space[:, np.newaxis, np.newaxis]
    return Profile(edges, fraction, mean, share @ now.spin, np.maximum(temperature, 0.0), stress)
