"""Stress after Love and Weber, positive in compression: the sum of a contact part and a kinetic part.

The part of the contacts is

    sigma_c = 1 / A sum_c l_c n (f_c n + q_c t)^T,

with l_c n the vector from the center of a grain to its contact c, f_c and q_c the normal and the tangential
force there, t the normal rotated by 90 degrees to the left, and A the area of the grains [m2]. The kinetic
part is the flow of momentum about the mean velocity <v> = sum m v / sum m of the grains,

    sigma_k = 1 / A sum m (v - <v>) (v - <v>)^T.

In two dimensions a stress is a force per length [N/m].

Without friction, q_c = 0 and the stress is symmetric. With friction it has an antisymmetric part,

    (sigma_xy - sigma_yx) / 2 = 1 / (2 A) sum_c l_c q_c,

minus half the torque of the contacts on the grains, per area. It vanishes where moments balance, as for
grains at rest; elsewhere it changes spins. The symmetric part is the stress of a continuum without couples.
Tangential forces do not change the pressure.
"""

import numpy as np

from warpgrains.analysis.packing import cell_areas
from warpgrains.analysis.region_table import Where, region_of
from warpgrains.analysis.snapshot import HasState, snapshot
from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.scene.snapshot import Snapshot
from warpgrains.space.geometry import left_of


def grain_stresses(of: Snapshot | HasState, area: FloatArray | None = None) -> FloatArray:
    """Return the stress of every grain [N/m], shape (n, 2, 2).

    Parameters
    ----------
    area : ndarray, optional
        Area A of each grain [m2], shape (n,); by default the area of its cell, see `cell_areas`, which needs
        scipy. With areas of cells, the mean of these stresses, weighted by area, is the contact part of
        `mean_stress`.

    Raises
    ------
    InputError
        An area is not positive, scipy is not installed, or a cell is unknown, see `cell_areas`.

    Examples
    --------
    >>> analysis.grain_stresses(simulation).shape
    (15, 2, 2)
    """
    now = snapshot(of)
    area = cell_areas(now) if area is None else checks.positive_per_grain("area", area, now.n)
    return force_moments(now) / area[:, np.newaxis, np.newaxis]


PARTS = ("all", "contacts", "kinetic")


def mean_stress(of: Snapshot | HasState, region: Where = None, part: str = "all") -> FloatArray:
    """Return the stress averaged over the container, or over a region [N/m], shape (2, 2).

    With friction, the stress has an antisymmetric part while spins change, see the head of the module.

    Parameters
    ----------
    region : mapping, optional
        See `region_of`. The sums are over the grains in the region and all their contacts, and A is the area
        of the region. So if regions fill a larger region, the mean of their contact parts, weighted by area,
        is the contact part of the larger region.
    part : str
        "contacts"; "kinetic", about the mean velocity of the grains in the region; or "all", the sum of both.
        In a shear flow, the velocity profile adds to the kinetic part, unless the region is a thin slice.

    Raises
    ------
    NoAreaError
        The container is open or unknown, or the region has no area, see `region_of`.

    Examples
    --------
    >>> analysis.mean_stress(simulation).round(4)
    array([[ 0.2092, -0.0007],
           [-0.0007,  0.2087]])
    """
    now = snapshot(of)
    wanted, counted = checks.one_of("part", part, PARTS), region_of(now, region)
    inside = slice(None) if region is None else counted.contains(now.position)
    total = np.zeros((2, 2))
    if wanted != "kinetic":
        total += force_moments(now)[inside].sum(axis=0)
    if wanted != "contacts":
        total += momentum_flow(now.scene.mass[inside], now.velocity[inside])
    return total / counted.area


def momentum_flow(mass: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return the sum of m (v - <v>) (v - <v>)^T over grains [N m], shape (2, 2).

    v are velocities, shape (n, 2), and <v> is their mean weighted by mass.
    """
    whole = mass.sum()
    fluctuation = velocity - mass @ velocity / whole if whole > 0.0 else velocity
    return np.asarray((mass * fluctuation.T) @ fluctuation)


def pressure(of: Snapshot | HasState, region: Where = None) -> float:
    """Return half the trace of the mean stress, contact part plus kinetic part [N/m].

    Examples
    --------
    >>> f"{analysis.pressure(simulation):.4f} N/m"
    '0.2090 N/m'
    """
    return float(np.trace(mean_stress(of, region)) / 2.0)


def force_moments(now: Snapshot) -> FloatArray:
    """Return the sum of l n (f n + q t)^T over the contacts of each grain [N m], shape (n, 2, 2).

    l is the radius of the grain, n the unit vector from its center to the contact, t the tangent, and f and q
    are the normal and the tangential force.
    """
    grain, normal, force, tangential = now.loads
    weight = force * now.scene.radius[grain]
    moments = np.empty((2, 2, now.n))
    for a, b in ((0, 0), (0, 1), (1, 1)):  # symmetric to the last bit
        moments[a, b] = moments[b, a] = np.bincount(grain, weight * normal[:, a] * normal[:, b], now.n)
    if now.scene.has_friction:
        weight, tangent = tangential * now.scene.radius[grain], left_of(normal)
        for a, b in np.ndindex(2, 2):
            moments[a, b] += np.bincount(grain, weight * normal[:, a] * tangent[:, b], now.n)
    return moments.transpose(2, 0, 1)
