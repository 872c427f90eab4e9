"""Contacts: coordination numbers, rattlers, fabric, forces, and stress after Love and Weber.

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

from typing import NamedTuple

import numpy as np

from warpgrains.analysis.packing import cell_areas
from warpgrains.analysis.snapshot import HasState, Snapshot, snapshot
from warpgrains.arrays import BoolArray, FloatArray, IndexArray
from warpgrains.scene.geometry import left_of
from warpgrains.solver.final_states import Grains


def contact_numbers(of: Snapshot | HasState, least: float = 0.0) -> IndexArray:
    """Return the number of contacts of each grain, walls included, shape (n,).

    Parameters
    ----------
    of : Snapshot or Simulation
    least : float
        Smallest force of contacts that count [N]; a step solved to a tolerance leaves tiny forces.

    Examples
    --------
    >>> analysis.contact_numbers(simulation)
    array([3, 4, 2, 4, 3, 4, 1, 2, 1, 4, 3, 3, 0, 3, 3])
    """
    now = snapshot(of)
    return np.bincount(now.loads.grain[now.loads.force >= least], minlength=now.n)


def rattlers(of: Snapshot | HasState, least: float = 0.0) -> BoolArray:
    """Return which grains do not carry loads, shape (n,).

    A frictionless grain is held by 3 contacts, or by 2 and its weight; a grain with friction by 2. Grains
    with fewer are removed with their contacts, repeatedly until none has fewer. The removed grains are the
    rattlers; the remaining ones are the backbone, a k-core.

    Parameters
    ----------
    of, least
        See `contact_numbers`.

    Examples
    --------
    >>> int(analysis.rattlers(simulation).sum())
    3
    """
    now = snapshot(of)
    needed = 2 if any(now.scene.gravity) or now.scene.has_friction else 3
    pair = now.pair[now.force >= least]
    at_wall = np.bincount(now.wall[now.wall_force >= least, 0], minlength=now.n)
    loose = np.zeros(now.n, dtype=bool)
    while True:
        kept = pair[~loose[pair].any(axis=1)]
        found = np.bincount(kept.ravel(), minlength=now.n) + at_wall < needed
        if (found == loose).all():
            return loose
        loose |= found


def coordination_number(of: Snapshot | HasState, least: float = 0.0, without_rattlers: bool = False) -> float:
    """Return Z, the mean number of contacts per grain, walls included; 0 without grains to count.

    Parameters
    ----------
    of, least
        See `contact_numbers`.
    without_rattlers : bool
        Whether to leave out rattlers, and their contacts.

    Examples
    --------
    >>> round(analysis.coordination_number(simulation), 3)
    2.667
    """
    now = snapshot(of)
    if not without_rattlers:
        return float(contact_numbers(now, least).mean())
    loose, loads = rattlers(now, least), now.loads
    pair = now.pair[now.force >= least]
    between = 2 * np.count_nonzero(~loose[pair].any(axis=1))
    at_wall = np.count_nonzero(~loose[loads.grain[2 * len(now.pair) :]])
    held = now.n - np.count_nonzero(loose)
    return (between + at_wall) / held if held else 0.0


def fabric_tensor(of: Snapshot | HasState) -> FloatArray:
    """Return the mean of n n^T over contacts between grains, shape (2, 2); its trace is 1.

    NaN without contacts.

    Both eigenvalues are 1/2 if the contacts are isotropic; their difference measures the anisotropy.

    Examples
    --------
    >>> analysis.fabric_tensor(simulation).round(4)
    array([[0.6569, 0.002 ],
           [0.002 , 0.3431]])
    """
    normal = snapshot(of).normal
    return normal.T @ normal / len(normal) if len(normal) else np.full((2, 2), np.nan)


class ForceStatistics(NamedTuple):
    """Statistics of the forces between grains; NaN without contacts."""

    contacts: int
    """Number of contacts between grains."""
    mean: float
    """Mean force [N]."""
    deviation: float
    """Standard deviation [N]."""
    largest: float
    """Largest force [N]."""


def force_statistics(of: Snapshot | HasState) -> ForceStatistics:
    """Return number, mean, standard deviation and maximum of the forces between grains.

    Examples
    --------
    >>> force = analysis.force_statistics(simulation)
    >>> force.contacts, round(force.mean, 4)
    (15, 1.0585)
    """
    force = snapshot(of).force
    if len(force) == 0:
        return ForceStatistics(0, np.nan, np.nan, np.nan)
    return ForceStatistics(len(force), float(force.mean()), float(force.std()), float(force.max()))


class Distribution(NamedTuple):
    """A probability density as a histogram."""

    edges: FloatArray
    """Edges of the bins, shape (bins + 1,)."""
    density: FloatArray
    """Probability density in each bin, shape (bins,); the integral is 1 minus the share beyond the edges."""


def force_distribution(of: Snapshot | HasState, bins: int = 40, most: float = 8.0) -> Distribution:
    """Return P(f / <f>), the probability density of the forces between grains in units of their mean.

    Parameters
    ----------
    of : Snapshot or Simulation
    bins : int
    most : float
        Upper end of the bins, in mean forces.

    Examples
    --------
    >>> edges, density = analysis.force_distribution(simulation, bins=4, most=4.0)
    >>> edges, round(float((density * np.diff(edges)).sum()), 12)
    (array([0., 1., 2., 3., 4.]), 1.0)
    """
    force = snapshot(of).force
    relative = force / force.mean() if len(force) else force
    count, edges = np.histogram(relative, bins, (0.0, most))
    return Distribution(edges, count / (max(1, len(force)) * np.diff(edges)))


def wall_forces(of: Snapshot | HasState) -> tuple[float, ...]:
    """Return the sums of the normal forces on the outer wall, the inner wall and each disc [N].

    Examples
    --------
    >>> outer, inner = analysis.wall_forces(simulation)
    >>> round(outer, 3), inner  # 15 grains of 0.1 kg
    (14.154, 0.0)
    """
    grains = snapshot(of).grains
    return tuple(wall_force_sums(grains, wall).item() for wall in range(grains.wall_force.shape[-1]))


def wall_force_sums(grains: Grains, wall: int) -> FloatArray:
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
    of : Snapshot or Simulation
    area : ndarray, optional
        Area A of each grain [m2], shape (n,); by default that of its cell, see `cell_areas`, which needs
        scipy. The mean of the stresses weighted by the cells is `mean_stress`.

    Raises
    ------
    InputError
        scipy is not installed; the extra ``[report]`` installs it.

    Examples
    --------
    >>> analysis.grain_stresses(simulation).shape
    (15, 2, 2)
    """
    now = snapshot(of)
    area = cell_areas(now) if area is None else area
    return _force_moments(now) / area[:, np.newaxis, np.newaxis]


def mean_stress(of: Snapshot | HasState) -> FloatArray:
    """Return the stress averaged over the area between the walls [N/m], shape (2, 2).

    With friction it has an antisymmetric part while grains spin up or slow down, see the head of the module.

    Examples
    --------
    >>> analysis.mean_stress(simulation).round(4)
    array([[0.2089, 0.0003],
           [0.0003, 0.1808]])
    """
    now = snapshot(of)
    return _force_moments(now).sum(axis=0) / now.scene.area


def pressure(of: Snapshot | HasState) -> float:
    """Return half the trace of the mean stress [N/m].

    Examples
    --------
    >>> f"{analysis.pressure(simulation):.4f} N/m"
    '0.1948 N/m'
    """
    return float(np.trace(mean_stress(of)) / 2.0)


def _force_moments(now: Snapshot) -> FloatArray:
    """Return the sum of l n (f n + q t)^T over the contacts of each grain [N m], shape (n, 2, 2)."""
    grain, normal, force, tangential = now.loads
    weight = force * now.scene.radius[grain]
    product = {
        (a, b): np.bincount(grain, weight * normal[:, a] * normal[:, b], now.n)
        for a, b in ((0, 0), (0, 1), (1, 1))
    }
    moments = np.array([[product[0, 0], product[0, 1]], [product[0, 1], product[1, 1]]])
    if now.scene.has_friction:
        weight, tangent = tangential * now.scene.radius[grain], left_of(normal)
        for a, b in np.ndindex(2, 2):
            moments[a, b] += np.bincount(grain, weight * normal[:, a] * tangent[:, b], now.n)
    return moments.transpose(2, 0, 1)
