"""The network of contacts: contact numbers, rattlers, clusters, and states of self-stress."""

from typing import NamedTuple

import numpy as np

from warpgrains.analysis.region_table import Where, grains_in
from warpgrains.analysis.snapshot import HasState, snapshot
from warpgrains.base import checks
from warpgrains.base.arrays import BoolArray, FloatArray, IndexArray, IntArray
from warpgrains.base.errors import InputError, requiring
from warpgrains.scene.snapshot import Snapshot
from warpgrains.space.geometry import left_of

MOST_FREEDOMS = 3000  # bound of velocity components in `rigidity`: the SVD of this size takes some 20 s


class _Contacts(NamedTuple):
    """The contacts with at least a given force. `pair` holds the grains i < j of each, shape (m, 2)."""

    pair: IntArray
    wall: IntArray
    """Grain of each contact with a wall, shape (k,)."""

    def numbers(self, without: BoolArray) -> IndexArray:
        """Return the number of contacts of each grain, shape (n,).

        Contacts do not count if one of their grains is marked in `without`, shape (n,).
        """
        kept = self.pair[~without[self.pair].any(axis=1)]
        wall, n = self.wall[~without[self.wall]], len(without)
        return np.bincount(kept.ravel(), minlength=n) + np.bincount(wall, minlength=n)


def _contacts(now: Snapshot, least: float) -> _Contacts:
    least = checks.number("least", least)
    return _Contacts(now.pair[now.force >= least], now.wall[now.wall_force >= least, 0])


def contact_numbers(of: Snapshot | HasState, least: float = 0.0) -> IndexArray:
    """Return the number of contacts of each grain, walls included, shape (n,).

    Parameters
    ----------
    least : float
        Smallest force of contacts that count [N]; a step solved to a tolerance leaves tiny forces.

    Examples
    --------
    >>> analysis.contact_numbers(simulation)
    array([3, 4, 2, 4, 3, 4, 1, 2, 1, 4, 3, 3, 0, 3, 3])
    """
    now = snapshot(of)
    return _contacts(now, least).numbers(np.zeros(now.n, dtype=bool))


def rattlers(of: Snapshot | HasState, least: float = 0.0) -> BoolArray:
    """Return which grains do not carry loads, shape (n,).

    Contacts with forces below `least` [N] do not count.

    A frictionless grain is held by 3 contacts, or in a pile by 2 and its weight; a grain with friction by 2.
    Contacts with walls count. Grains with fewer contacts are removed with their contacts, repeatedly until no
    such grain is left. The removed grains are the rattlers; the remaining grains are the backbone, a k-core.
    A grain of a pile that stands on a single contact is a rattler.

    Examples
    --------
    >>> int(analysis.rattlers(simulation).sum())
    3
    """
    now = snapshot(of)
    needed = 2 if any(now.scene.gravity_at(now.time)) or now.scene.has_friction else 3
    contacts, loose = _contacts(now, least), np.zeros(now.n, dtype=bool)
    while True:
        found = loose | (contacts.numbers(loose) < needed)
        if (found == loose).all():
            return loose
        loose = found


def coordination_number(
    of: Snapshot | HasState, least: float = 0.0, without_rattlers: bool = False, region: Where = None
) -> float:
    """Return Z, the mean number of contacts per grain, walls included; 0 without grains to count.

    Parameters
    ----------
    without_rattlers : bool
        Whether to leave out rattlers and their contacts.
    region : mapping, optional
        Region of the grains that count, with all their contacts, see `region_of`.

    Examples
    --------
    >>> round(analysis.coordination_number(simulation), 3)
    2.667
    """
    now = snapshot(of)
    loose = rattlers(now, least) if without_rattlers else np.zeros(now.n, dtype=bool)
    counted = ~loose if region is None else ~loose & grains_in(now, region)
    number = _contacts(now, least).numbers(loose)[counted]
    return float(number.mean()) if len(number) else 0.0


def clusters(of: Snapshot | HasState, least: float = 0.0) -> IndexArray:
    """Return the number of the cluster of each grain, shape (n,), from 0.

    Grains of a cluster are connected by contacts between grains with forces of at least `least` [N]. Walls
    connect no grains. Cluster 0 has the most grains, and so on. Clusters of equal size are in the order of
    their first grains.

    Raises
    ------
    InputError
        scipy is not installed; the extra ``[report]`` installs it.

    Examples
    --------
    >>> np.bincount(analysis.clusters(simulation))  # sizes of the clusters
    array([14,  1])
    """
    with requiring("clusters"):
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components
    now = snapshot(of)
    i, j = _contacts(now, least).pair.T
    graph = coo_array((np.ones(len(i), bool), (i, j)), shape=(now.n, now.n))
    _, label = connected_components(graph, directed=False)
    _, first, size = np.unique(label, return_index=True, return_counts=True)
    number = np.empty(len(size), np.int64)
    number[np.lexsort((first, -size))] = np.arange(len(size))
    return number[label]


class Rigidity(NamedTuple):
    """Numbers of forces and motions of a network of contacts. Maxwell's count relates these numbers.

    `forces` - `self_stresses` = `freedoms` - `zero_modes` = `rank` (Calladine, 1978).
    """

    forces: int
    """Number of independent components of contact forces: one a contact, or two with friction."""
    freedoms: int
    """Number of velocity components: two a grain, or three with friction."""
    rank: int
    """Rank of the rigidity matrix, which gives relative velocities at contacts from velocities of grains."""
    self_stresses: int
    """Dimension of the space of contact forces, of any sign, that balance on every grain without a load."""
    zero_modes: int
    """Dimension of the space of velocities that, to first order, change no gap of a contact and, with
    friction, make no contact slide."""


def rigidity(
    of: Snapshot | HasState, least: float = 0.0, without_rattlers: bool = False, region: Where = None
) -> Rigidity:
    """Return the number of states of self-stress and of zero modes of the contacts, walls included.

    The rank of the rigidity matrix is the number of its singular values above 1e-9 of the largest one. The
    geometry decides, not the sizes of forces. Contacts of a grain that are parallel up to rounding errors
    count as parallel.

    Parameters
    ----------
    of, least, without_rattlers, region
        See `coordination_number`. Contacts with grains outside the region are left out.

    Raises
    ------
    InputError
        The grains have more than 3,000 velocity components: 1,500 grains, or 1,000 with friction.

    Examples
    --------
    >>> analysis.rigidity(simulation)
    Rigidity(forces=25, freedoms=30, rank=25, self_stresses=0, zero_modes=5)
    """
    now = snapshot(of)
    counted = np.ones(now.n, bool) if region is None else grains_in(now, region)
    if without_rattlers:
        counted &= ~rattlers(now, least)
    matrix = _rigidity_matrix(now, least, counted)
    rank = 0
    if matrix.size:
        values = np.linalg.svd(matrix, compute_uv=False)
        rank = int((values > 1e-9 * values[0]).sum())
    forces, freedoms = matrix.shape
    return Rigidity(forces, freedoms, rank, forces - rank, freedoms - rank)


def _rigidity_matrix(now: Snapshot, least: float, counted: BoolArray) -> FloatArray:
    """Return the matrix that maps velocities of the grains to relative velocities at the contacts.

    Its columns are for the velocity and, with friction, r * spin of each grain in `counted`. Its rows are for
    the normals of all contacts with a force of at least `least` [N] and, with friction, for their tangents.
    """
    least = checks.number("least", least)
    rough, n = now.scene.has_friction, int(counted.sum())
    per_grain = 3 if rough else 2
    if n * per_grain > MOST_FREEDOMS:
        raise InputError(
            f"{n} grains have {n * per_grain} velocity components: rigidity takes at most {MOST_FREEDOMS};"
            " choose a smaller region, or leave out rattlers"
        )
    pairs = (now.force >= least) & counted[now.pair].all(axis=1)
    walls = (now.wall_force >= least) & counted[now.wall[:, 0]]
    number = np.cumsum(counted) - 1
    i = number[np.concatenate([now.pair[pairs, 0], now.wall[walls, 0]])]
    j = number[now.pair[pairs, 1]]
    normal = np.concatenate([now.normal[pairs], now.wall_normal[walls]])
    row, other = np.arange(len(i)), np.arange(len(j))
    blocks = []
    for direction, turn in ((normal, 0.0), (left_of(normal), 1.0))[: 1 + rough]:
        block = np.zeros((len(i), n, per_grain))
        block[row, i, :2] = -direction
        block[other, j, :2] += direction[: len(j)]
        if rough:  # both surfaces move along the tangent by r times spin, in opposite directions
            block[row, i, 2] = -turn
            block[other, j, 2] -= turn
        blocks.append(block.reshape(len(i), n * per_grain))
    return np.concatenate(blocks)
