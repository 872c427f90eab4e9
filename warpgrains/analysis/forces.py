"""Contacts between grains: fabric, directions and forces."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from warpgrains.analysis.region_table import Where, region_of
from warpgrains.analysis.snapshot import HasState, snapshot
from warpgrains.base import checks
from warpgrains.base.arrays import BoolArray, FloatArray
from warpgrains.scene.snapshot import Snapshot


def fabric_tensor(of: Snapshot | HasState, region: Where = None) -> FloatArray:
    """Return the mean of n n^T over contacts between grains, shape (2, 2); its trace is 1.

    NaN without contacts.

    Both eigenvalues are 1/2 if the contacts are isotropic; their difference measures the anisotropy.

    Parameters
    ----------
    region : mapping, optional
        Region of the contact points, see `region_of`.

    Examples
    --------
    >>> analysis.fabric_tensor(simulation).round(4)
    array([[0.6569, 0.002 ],
           [0.002 , 0.3431]])
    """
    now = snapshot(of)
    normal = now.normal[_counted(now, region)]
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


def force_statistics(of: Snapshot | HasState, region: Where = None) -> ForceStatistics:
    """Return number, mean, standard deviation and maximum of the normal forces between grains.

    Contacts count if their contact points are in the region, see `region_of`.

    Examples
    --------
    >>> force = analysis.force_statistics(simulation)
    >>> force.contacts, round(force.mean, 4)
    (15, 1.0585)
    """
    now = snapshot(of)
    force = now.force[_counted(now, region)]
    if len(force) == 0:
        return ForceStatistics(0, np.nan, np.nan, np.nan)
    return ForceStatistics(len(force), float(force.mean()), float(force.std()), float(force.max()))


PARTS: dict[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
    "normal": lambda normal, _: normal,
    "tangential": lambda _, tangential: np.abs(tangential),
    "total": np.hypot,
}
"""Values of `part` in `force_distribution`, each with its function.

A function returns the modulus of each force [N] from its normal and its tangential component.
"""


class Distribution(NamedTuple):
    """A probability density as a histogram."""

    edges: FloatArray
    """Edges of the bins, shape (bins + 1,): multiples of the mean force, or angles [rad]."""
    density: FloatArray
    """Probability density in each bin, shape (bins,); the integral is 1 minus the share beyond the edges."""


def force_distribution(
    of: Snapshot | HasState,
    bins: int = 40,
    most: float = 8.0,
    region: Where = None,
    part: str = "normal",
) -> Distribution:
    """Return P(f / <f>), the probability density of the forces between grains in units of their mean.

    Parameters
    ----------
    bins : int
    most : float
        Upper end of the bins, in mean forces.
    part : str
        ``"normal"`` for normal forces f, ``"tangential"`` for the moduli of tangential forces q, or
        ``"total"`` for the moduli of the total forces, sqrt(f^2 + q^2).

    Raises
    ------
    InputError
        The part is unknown, `bins` or `most` is not positive, or the region is invalid.

    Examples
    --------
    >>> edges, density = analysis.force_distribution(simulation, bins=4, most=4.0)
    >>> edges, round(float((density * np.diff(edges)).sum()), 12)
    (array([0., 1., 2., 3., 4.]), 1.0)
    """
    now = snapshot(of)
    force = PARTS[checks.one_of("part", part, PARTS)](now.force, now.tangential_force)[_counted(now, region)]
    most = checks.positive("most", most)
    relative = force / force.mean() if len(force) and force.any() else force
    count, edges = np.histogram(relative, checks.whole_number("bins", bins), (0.0, most))
    return Distribution(edges, count / (max(1, len(force)) * np.diff(edges)))


def contact_directions(of: Snapshot | HasState, bins: int = 36, region: Where = None) -> Distribution:
    """Return the probability density of the directions of contacts between grains [1/rad].

    The direction of a contact is the angle of its normal from the x axis. Both normals of a contact count,
    that from grain i to grain j and the opposite one, so that the density has the period pi. It is 1 / (2 pi)
    if the contacts are isotropic, and 0 without contacts.

    Parameters
    ----------
    bins : int
        Number of bins between -pi and pi.
    region
        See `fabric_tensor`, the second moment of this distribution.

    Examples
    --------
    >>> edges, density = analysis.contact_directions(simulation, bins=4)
    >>> (density * np.diff(edges)).round(3)
    array([0.233, 0.267, 0.233, 0.267])
    """
    now = snapshot(of)
    x, y = now.normal[_counted(now, region)].T
    count, edges = np.histogram(
        np.arctan2([y, -y], [x, -x]), checks.whole_number("bins", bins), (-np.pi, np.pi)
    )
    return Distribution(edges, count / (max(1, 2 * len(x)) * np.diff(edges)))


def _counted(now: Snapshot, region: Where) -> BoolArray | slice:
    """Return an index for `now.pair` that selects the contacts whose contact points are in a region."""
    if region is None:
        return slice(None)
    grain = now.pair[:, 0]
    contact = now.position[grain] + now.scene.radius[grain, np.newaxis] * now.normal
    return region_of(now, region).contains(contact)
