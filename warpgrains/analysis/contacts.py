"""Contacts: their numbers, rattlers, fabric, forces, and stress after Love and Weber.

Stress is positive in compression,

    sigma = 1 / A sum_c f_c l_c n n^T,

l_c n from the centre of a grain to its contact c, f_c the force there, A an area of the grains [m2]: in the
plane a stress is a force by length [N/m]. Contacts carry no friction, so it is symmetric.
"""

from typing import NamedTuple

import numpy as np

from warpgrains.analysis.packing import cell_areas
from warpgrains.analysis.snapshot import HasState, Snapshot, snapshot
from warpgrains.arrays import BoolArray, FloatArray, IndexArray
from warpgrains.solver.ends import Grains


def contact_numbers(of: Snapshot | HasState, least: float = 0.0) -> IndexArray:
    """Return how many contacts each grain has, walls included, shape (n,).

    Parameters
    ----------
    of : Snapshot or Simulation
    least : float
        Contacts that carry less are left out [N]: a step solved to a tolerance leaves tiny ones.

    Examples
    --------
    >>> analysis.contact_numbers(simulation)
    array([3, 4, 2, 4, 3, 4, 1, 2, 1, 4, 3, 3, 0, 3, 3])
    """
    moment = snapshot(of)
    return np.bincount(moment.loads.grain[moment.loads.force >= least], minlength=moment.n)


def rattlers(of: Snapshot | HasState, least: float = 0.0) -> BoolArray:
    """Return which grains take no part in carrying loads, shape (n,).

    A grain without friction is held by 3 contacts, or by 2 and its weight. Those with fewer are taken away
    with their contacts, until none is left that has fewer: the others are the backbone, a k-core.

    Parameters
    ----------
    of, least
        See `contact_numbers`.

    Examples
    --------
    >>> int(analysis.rattlers(simulation).sum())
    3
    """
    moment = snapshot(of)
    needed = 2 if any(moment.scene.gravity) else 3
    pair = moment.pair[moment.force >= least]
    at_wall = np.bincount(moment.wall[moment.wall_force >= least, 0], minlength=moment.n)
    loose = np.zeros(moment.n, dtype=bool)
    while True:
        kept = pair[~loose[pair].any(axis=1)]
        found = np.bincount(kept.ravel(), minlength=moment.n) + at_wall < needed
        if (found == loose).all():
            return loose
        loose |= found


def coordination_number(of: Snapshot | HasState, least: float = 0.0, without_rattlers: bool = False) -> float:
    """Return Z, the mean number of contacts a grain, walls included; 0 where there is no grain to count.

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
    moment = snapshot(of)
    if not without_rattlers:
        return float(contact_numbers(moment, least).mean())
    loose, loads = rattlers(moment, least), moment.loads
    pair = moment.pair[moment.force >= least]
    between = 2 * np.count_nonzero(~loose[pair].any(axis=1))
    at_wall = np.count_nonzero(~loose[loads.grain[2 * len(moment.pair) :]])
    held = moment.n - np.count_nonzero(loose)
    return (between + at_wall) / held if held else 0.0


def fabric_tensor(of: Snapshot | HasState) -> FloatArray:
    """Return the mean of n n^T over contacts between grains, shape (2, 2): trace 1; NaN without contacts.

    Its eigenvalues are 1/2 each where contacts point anywhere alike; their difference is the anisotropy.

    Examples
    --------
    >>> analysis.fabric_tensor(simulation).round(4)
    array([[0.6569, 0.002 ],
           [0.002 , 0.3431]])
    """
    normal = snapshot(of).normal
    return normal.T @ normal / len(normal) if len(normal) else np.full((2, 2), np.nan)


class ForceStatistics(NamedTuple):
    """Sizes of the forces between grains; NaN without contacts."""

    contacts: int
    """Contacts between grains."""
    mean: float
    """[N]."""
    deviation: float
    """Standard deviation [N]."""
    largest: float
    """[N]."""


def force_statistics(of: Snapshot | HasState) -> ForceStatistics:
    """Return number, mean, deviation and maximum of the forces between grains.

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
    """A probability density by bins."""

    edges: FloatArray
    """Edges of the bins, shape (bins + 1,)."""
    density: FloatArray
    """Probability density in each, shape (bins,); the integral is 1, but for what is beyond the edges."""


def force_distribution(of: Snapshot | HasState, bins: int = 40, most: float = 8.0) -> Distribution:
    """Return P(f / <f>), the probability density of the forces between grains in units of their mean.

    Parameters
    ----------
    of : Snapshot or Simulation
    bins : int
    most : float
        Where the bins end, in means.

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
    """Return how hard the grains push on the outer and inner wall, and on others: sums of normal forces [N].

    Examples
    --------
    >>> outer, inner = analysis.wall_forces(simulation)
    >>> round(outer, 3), inner  # 15 grains of 0.1 kg
    (14.154, 0.0)
    """
    grains = snapshot(of).grains
    return tuple(wall_force_sums(grains, wall).item() for wall in range(grains.wall_force.shape[-1]))


def wall_force_sums(grains: Grains, wall: int) -> FloatArray:
    """Return the sums of the forces on a wall, of many runs [N], shape (m,)."""
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
        What the stress is spread over [m2], shape (n,); by default the cells of `cell_areas`, which needs
        scipy. Weighted by it, stresses add up to `mean_stress`.

    Raises
    ------
    InputError
        scipy is not installed; it comes with the extra ``[report]``.

    Examples
    --------
    >>> analysis.grain_stresses(simulation).shape
    (15, 2, 2)
    """
    moment = snapshot(of)
    area = cell_areas(moment) if area is None else area
    return _moments(moment) / area[:, np.newaxis, np.newaxis]


def mean_stress(of: Snapshot | HasState) -> FloatArray:
    """Return the stress averaged over the space between the walls [N/m], shape (2, 2).

    Examples
    --------
    >>> analysis.mean_stress(simulation).round(4)
    array([[0.2089, 0.0003],
           [0.0003, 0.1808]])
    """
    moment = snapshot(of)
    return _moments(moment).sum(axis=0) / moment.scene.area


def pressure(of: Snapshot | HasState) -> float:
    """Return half the trace of the mean stress [N/m].

    Examples
    --------
    >>> f"{analysis.pressure(simulation):.4f} N/m"
    '0.1948 N/m'
    """
    return float(np.trace(mean_stress(of)) / 2.0)


def _moments(moment: Snapshot) -> FloatArray:
    """Return the sum of f l n n^T over the contacts of each grain [N m], shape (n, 2, 2)."""
    grain, normal, force = moment.loads
    weight = force * moment.scene.radius[grain]
    product = {
        (a, b): np.bincount(grain, weight * normal[:, a] * normal[:, b], moment.n)
        for a, b in ((0, 0), (0, 1), (1, 1))
    }
    rows = [[product[0, 0], product[0, 1]], [product[0, 1], product[1, 1]]]
    return np.array(rows).transpose(2, 0, 1)
