"""The network of contacts: clusters, states of self-stress, directions and moduli of forces."""

from dataclasses import replace

import networkx
import numpy as np
import pytest
from moments import moment_of
from walled_scenes import on_circle

from warpgrains import analysis

HEXAGON = on_circle(np.pi / 3.0 * np.arange(6))


def touching(position, wall=(), center=(5.0, 3.0), **fields):
    """Discs of radius 1/2 m that touch where centers are 1 m apart; `wall` lists those at the wall."""
    place = np.array(position, float) + center
    start = moment_of(place, 0.5, **{"radius_out": 20.0, "gravity": (0.0, 0.0), **fields})
    apart = np.hypot(*(place[:, np.newaxis] - place).T)
    pair = np.argwhere(np.triu(apart < 1.0 + 1e-9, 1)).astype(np.int32)
    walls = np.array([(grain, 0) for grain in wall], np.int32).reshape(-1, 2)
    none, wall_none = np.zeros(len(pair)), np.zeros(len(walls))
    contacts = {"pair": pair, "force": none + 1.0, "tangential_force": none, "wall": walls}
    walls_force = {"wall_force": wall_none + 1.0, "wall_tangential_force": wall_none}
    return replace(start, **contacts, **walls_force)


ROUGH = {"friction": 0.5}


@pytest.mark.parametrize(
    ("position", "fields", "expected"),
    [
        ([(0, 0)], {}, (0, 2, 0)),
        ([(0, 0), (1, 0), (2, 0)], {}, (2, 6, 2)),  # a straight chain
        ([(0, 0), *HEXAGON[:2]], {}, (3, 6, 3)),  # a triangle: only rigid motions are left
        (HEXAGON, {}, (6, 12, 6)),
        ([(0, 0), *HEXAGON], {}, (12, 14, 11)),  # with a hub: rim and spokes can be stressed by each other
        ([(0, 0), (1, 0)], {"wall": [0, 1]}, (3, 4, 3)),
        ([(0, 0), (1, 0)], ROUGH, (2, 6, 2)),  # the two may roll on each other, and move as one
        ([(0, 0), *HEXAGON[:2]], ROUGH, (6, 9, 6)),  # three gears block one another
        ([(0, 0), (1, 0), (1, 1), (0, 1)], ROUGH, (8, 12, 8)),  # four turn; a square that shears cannot roll
        ([(0, 0), *HEXAGON], ROUGH, (24, 21, 18)),
    ],
)
def test_rank_of_small_networks(position, fields, expected):
    forces, freedoms, rank = expected
    found = analysis.rigidity(touching(position, **fields))
    assert found == (forces, freedoms, rank, forces - rank, freedoms - rank)


@pytest.fixture(scope="module")
def pile(settled):
    return analysis.snapshot(settled)


def test_rank_is_that_of_the_gaps_by_differences(pile):
    """The matrix of the derivatives of all gaps, by finite differences of distances."""
    i, j = pile.pair.T
    grain, h = pile.wall[:, 0], 1e-7

    def gaps(x):
        x = x.reshape(-1, 2)
        return np.append(np.hypot(*(x[j] - x[i]).T), -np.hypot(*x[grain].T))

    start = pile.start.ravel()
    columns = [(gaps(start + h * unit) - gaps(start - h * unit)) / (2.0 * h) for unit in np.eye(len(start))]
    found = analysis.rigidity(pile)
    rank = np.linalg.matrix_rank(np.stack(columns, axis=1), tol=1e-6)
    assert found == (len(pile.force) + len(pile.wall), 2 * pile.n, rank, *(np.array(found[:2]) - rank))
    held = analysis.rigidity(pile, without_rattlers=True)
    kept = int((~analysis.rattlers(pile)).sum())
    assert (held.freedoms, held.forces) == (2 * kept, held.rank + held.self_stresses)
    # a contact that is left out with a rattler carries no self-stress, if no two of a grain are parallel
    assert held.self_stresses == found.self_stresses


def test_rigidity_in_a_region(pile):
    """Contacts across the border count in neither part."""
    halves = [{"x": (-9.0, 0.0)}, {"x": (0.0, 9.0)}]
    right = analysis.grains_in(pile, halves[1])
    crossing = (right[pile.pair[:, 0]] != right[pile.pair[:, 1]]).sum()
    found = [analysis.rigidity(pile, region=half) for half in halves]
    assert sum(half.forces for half in found) == analysis.rigidity(pile).forces - crossing
    assert sum(half.freedoms for half in found) == 2 * pile.n


@pytest.mark.parametrize("least", [0.0, 0.5])
def test_clusters_are_those_of_networkx(pile, least):
    graph = networkx.empty_graph(pile.n)
    graph.add_edges_from(pile.pair[pile.force >= least].tolist())
    expected = {frozenset(one) for one in networkx.connected_components(graph)}
    found = analysis.clusters(pile, least)
    assert {frozenset(np.flatnonzero(found == k).tolist()) for k in range(found.max() + 1)} == expected
    size = np.bincount(found)
    assert (np.diff(size) <= 0).all()
    first = [np.argmax(found == k) for k in range(len(size))]
    assert all(first[k] < first[k + 1] for k in range(len(size) - 1) if size[k] == size[k + 1])


def test_second_moment_of_directions_is_the_fabric(pile):
    """And a contact has two opposite directions."""
    edges, density = analysis.contact_directions(pile, bins=20_000)
    angle = 0.5 * (edges[1:] + edges[:-1])
    normal = np.stack([np.cos(angle), np.sin(angle)])
    moment = (normal * density * np.diff(edges)) @ normal.T
    assert moment == pytest.approx(analysis.fabric_tensor(pile), abs=np.diff(edges)[0])
    assert density[:10_000] == pytest.approx(density[10_000:])


@pytest.mark.parametrize(
    ("part", "moduli"),
    [("normal", [3.0, 1.0, 2.0]), ("tangential", [4.0, 0.0, 0.5]), ("total", [5.0, 1.0, np.hypot(2.0, 0.5)])],
)
def test_moduli_of_forces(part, moduli):
    three = touching([(0, 0), *HEXAGON[:2]], **ROUGH)
    three = replace(three, force=np.array([3.0, 1.0, 2.0]), tangential_force=np.array([-4.0, 0.0, 0.5]))
    edges, density = analysis.force_distribution(three, bins=300, most=3.0, part=part)
    expected = np.histogram(np.array(moduli) / np.mean(moduli), edges)[0] / 3.0
    assert density * np.diff(edges) == pytest.approx(expected)
    assert expected.sum() == pytest.approx(1.0)
    assert not analysis.force_distribution(three, region={"y": (10.0, 12.0)}).density.any()
    assert analysis.force_statistics(three) == (3, 2.0, pytest.approx(np.sqrt(2.0 / 3.0)), 3.0)


def test_two_contacts_with_friction_hold_a_grain():
    """Without gravity: without friction, two contacts are too few."""
    assert analysis.rattlers(touching([(0, 0), *HEXAGON[:2]])).all()
    assert not analysis.rattlers(touching([(0, 0), *HEXAGON[:2]], **ROUGH)).any()
