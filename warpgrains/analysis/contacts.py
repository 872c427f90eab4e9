"""Forces on walls, and stress after Love and Weber.

Stress is positive in compression,

    sigma = 1 / A sum_c l_c n (f_c n + q_c t)^T,

with l_c n the vector from the center of a grain to its contact c, f_c and q_c the normal and the tangential
force there, t the normal rotated by 90 degrees to the left, and A the area of the grains [m2]. In two
dimensions a stress is a force per length [N/m].

Without friction, q_c = 0 and the stress is symmetric. With friction it has an antisymmetric part,

    (sigma_xy - sigma_yx) / 2 = 1 / (2 A) sum_c l_c q_c,

minus half the torque of the contacts on the grains, per area. It vanishes where moments balance, as for
grains at rest, and else spins grains up. The symmetric part is the stress of a continuum without couples.
Tangential forces do not change the pressure.
"""

import numpy as np

from warpgrains.analysis.packing import cell_areas
from warpgrains.analysis.region_table import Where, region_of
from warpgrains.analysis.snapshot import HasState, snapshot
from warpgrains.arrays import FloatArray
from warpgrains.scene.geometry import left_of
from warpgrains.scene.snapshot import Snapshot, Snapshots


def wall_forces(of: Snapshot | HasState) -> tuple[float, ...]:
    """Return the sums of the normal forces on each of `Scene.walls` [N].

    Walls of one name, such as the segments of a polyline, count as one wall (`Scene.wall_names`).

    Examples
    --------
    >>> outer, inner = analysis.wall_forces(simulation)
    >>> round(outer, 3), inner  # 15 grains of 0.1 kg
    (14.154, 0.0)
    """
    now = snapshot(of)
    grains, names = now.grains, now.scene.wall_names
    total = dict.fromkeys(names, 0.0)
    for wall, name in enumerate(names):
        total[name] += wall_force_sums(grains, wall).item()
    return tuple(total.values())


def circle_forces(grains: Snapshots, which: int) -> FloatArray:
    """Return the sum of the forces on the inner circle, 0, or the outer one, 1, for many runs [N], (m,).

    It is 0 without an inner circle, and NaN without an outer one.
    """
    own, found = grains.circle_walls[:, which], np.where(which, np.nan, 0.0) * np.ones(len(grains.mass))
    for wall in np.unique(own[own >= 0]):
        found = np.where(own == wall, wall_force_sums(grains, wall), found)
    return np.where(grains.circle_walls[:, 1] >= 0, found, np.nan)


def wall_force_sums(grains: Snapshots, wall: int) -> FloatArray:
    """Return the sum of the forces on a wall for many runs [N], shape (m,)."""
    force = grains.wall_force[..., wall]
    sums, is_positive = np.zeros(len(force)), force > 0.0
    for k in np.flatnonzero(is_positive.any(axis=-1)):
        sums[k] = force[k][is_positive[k]].sum()
    return sums


def grain_stresses(of: Snapshot | HasState, area: FloatArray | None = None) -> FloatArray:
    """Return the stress of every grain [N/m], shape (n, 2, 2).

    Parameters
    ----------
    area : ndarray, optional
        Area A of each grain [m2], shape (n,); by default that of its cell, see `cell_areas`, which needs
        scipy. The mean of the stresses weighted by the cells is `mean_stress`.

    Raises
    ------
    InputError
        scipy is not installed, or a cell is unknown, see `cell_areas`.

    Examples
    --------
    >>> analysis.grain_stresses(simulation).shape
    (15, 2, 2)
    """
    now = snapshot(of)
    area = cell_areas(now) if area is None else area
    return force_moments(now) / area[:, np.newaxis, np.newaxis]


def mean_stress(of: Snapshot | HasState, region: Where = None) -> FloatArray:
    """Return the stress averaged over the container, or over a region [N/m], shape (2, 2).

    With friction it has an antisymmetric part while grains spin up or slow down, see the head of the module.

    Parameters
    ----------
    region : mapping, optional
        See `region_of`. The sum is over all contacts of the grains in the region, and A is its area. So the
        stresses of regions that fill a larger one, weighted by their areas, add up to that of the larger one.

    Raises
    ------
    NoAreaError
        The container is open or unknown, or the region has no area, see `region_of`.

    Examples
    --------
    >>> analysis.mean_stress(simulation).round(4)
    array([[0.2089, 0.0003],
           [0.0003, 0.1808]])
    """
    now = snapshot(of)
    counted = region_of(now, region)
    inside = slice(None) if region is None else counted.contains(now.position)
    return np.asarray(force_moments(now)[inside].sum(axis=0) / counted.area)


def pressure(of: Snapshot | HasState, region: Where = None) -> float:
    """Return half the trace of the mean stress [N/m].

    Examples
    --------
    >>> f"{analysis.pressure(simulation):.4f} N/m"
    '0.1948 N/m'
    """
    return float(np.trace(mean_stress(of, region)) / 2.0)


def force_moments(now: Snapshot) -> FloatArray:
    """Return the sum of l n (f n + q t)^T over the contacts of each grain [N m], shape (n, 2, 2)."""
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
