"""The search for candidate pairs against a loop over all pairs."""

from typing import NamedTuple

import numpy as np
import pytest
from stages import OneRecord, grains_apart

from warpgrains import Scene, SimulationError
from warpgrains.base.arrays import FloatArray, IntArray
from warpgrains.kernels.record import Phase
from warpgrains.kernels.search.neighbors import MOST_CONTACTS
from warpgrains.kernels.step import SEARCH
from warpgrains.solver.exact import listed

TOO_WIDE = 1e-12  # by which the search may reach too far (kernels/search/neighbors.py)


class Cloud(NamedTuple):
    """Grains, and how far they reach: a pair is sought if gap <= reach_i + reach_j + horizon |w_i - w_j|."""

    position: FloatArray
    radius: FloatArray
    reach: FloatArray
    velocity: FloatArray
    horizon: float


def cloud(position: FloatArray, radius: FloatArray | float, seed: int = 0) -> Cloud:
    """Give every grain some reach and velocity of the order of its radius."""
    rng, n = np.random.default_rng(seed), len(position)
    radius = np.broadcast_to(radius, n)
    velocity = np.array([3.0, -1.0]) + rng.normal(0.0, np.median(radius), (n, 2))
    return Cloud(position, radius, radius * rng.uniform(0.0, 0.5, n), velocity, horizon=0.3)


def uniform(n: int, low: float, high: float) -> FloatArray:
    return np.random.default_rng(n).uniform(low, high, (n, 2))


CLOUDS = {
    "even": cloud(uniform(500, -1.0, 1.0), 0.03),
    "radii from 1 to 200": cloud(uniform(400, -1.0, 1.0), 10.0 ** uniform(200, -3.0, -0.7).ravel()),
    "one huge among small": cloud(uniform(300, -2.0, 2.0), np.append(np.full(299, 0.02), 1.5)),
    "clusters": cloud(np.repeat(uniform(6, -5.0, 5.0), 50, axis=0) + uniform(300, -0.2, 0.2), 0.05),
    "nearly at one place": cloud(uniform(100, 0.0, 1e-9) + 0.5, 0.1),
    "negative coordinates": cloud(uniform(500, -9.0, -8.0), 0.02),
    "far from the origin": cloud(uniform(500, -1.0, 1.0) + np.array([1e6, -3e6]), 0.03),
    "beyond the last cell": cloud(uniform(500, -1.0, 1.0) + np.array([1e9, -3e9]), 0.03),
    "two grains": cloud(np.array([[0.1, 0.0], [0.0, 0.1]]), 0.06),
    "one grain": cloud(np.array([[1.0, 1.0]]), 0.1),
}


POISON = {f"grid.{name}": np.nan for name in ("x", "y", "extent", "velocity", "skin")}
POISON |= {f"grid.{name}": -7 for name in ("cell_start", "bucket", "grain")}
POISON |= {"neighbors.start": -7, "neighbors.second": -7}
"""What would be noticed, where a search writes, and behind the last grain."""


def listed_pairs(sought: Cloud, cell_size: float, threads: int = 1) -> IntArray:
    radius_out = min(1e10, 5e11 * sought.radius.min())
    scene = Scene(position=sought.position, radius=sought.radius, mass=1.0, radius_out=radius_out)
    record = OneRecord(scene, contacts=1, threads=threads)
    record.write({"grains.position": sought.position, "grains.radius": sought.radius})
    record.write({"verlet.skin": sought.reach, "verlet.reference_velocity": sought.velocity})
    record.write({"verlet.mean_velocity": sought.velocity.mean(axis=0)})
    record.write({"verlet.lifetime": sought.horizon, "grid.inverse_size": 1.0 / cell_size})
    for _ in range(2):  # the second time with room for what the first has found
        record.write(POISON)
        record.run(*SEARCH)
        total = int(record["neighbors.total"][0])
        record.records.reserve_contacts(0, total)
    record.assert_holds({"control.phase": Phase.START})
    pairs = listed.listed_pairs(record.records, 0)[0]
    assert len(pairs) == total
    return pairs


def pairs_within_reach(sought: Cloud, wider: float = 0.0) -> IntArray:
    i, j = np.triu_indices(len(sought.position), 1)
    distance = np.hypot(*(sought.position[j] - sought.position[i]).T)
    extent, path = sought.radius + sought.reach, np.hypot(*(sought.velocity[j] - sought.velocity[i]).T)
    within = distance <= (extent[i] + extent[j] + sought.horizon * path) * (1.0 + wider)
    return np.stack([i, j], axis=1)[within]


def test_a_search_ends_before_its_count_overflows() -> None:
    """Grains of 1 nm that fall by a millimeter in a step may meet any other: 2e10 pairs of 200,000 grains."""
    record = OneRecord(grains_apart(50), contacts=1)
    record["grains.position"][:] *= 1e-3
    record["verlet.skin"][:] = 1.0
    record.run(*SEARCH[:4])
    record["neighbors.slots"][0] = MOST_CONTACTS - 5
    record.run(*SEARCH[4:6])
    found = int(record["neighbors.total"][0])
    assert found == MOST_CONTACTS + 1
    record.assert_holds({"control.phase": Phase.LIST_FULL})
    told = "in a step of 0.01 s, more than 1073741824 contacts of 50 grains are within reach: dt is too long"
    with pytest.raises(SimulationError, match=told):
        record.records.reserve_contacts(0, found)


@pytest.mark.parametrize("name", CLOUDS)
def test_pairs_within_reach(name: str) -> None:
    sought = CLOUDS[name]
    expected = pairs_within_reach(sought)
    # No pair of these clouds is so near its limit that the search may or may not find it.
    assert np.array_equal(expected, pairs_within_reach(sought, wider=2.0 * TOO_WIDE))
    for relative_cell_size, threads in ((0.1, 1), (0.2, 3), (0.3, 1), (2.3, 3), (40.0, 1)):
        cell_size = relative_cell_size * float(np.median(sought.radius))
        assert np.array_equal(listed_pairs(sought, cell_size, threads), expected)


def test_pair_exactly_at_its_reach() -> None:
    """On a lattice of powers of two every distance is exact."""
    position = np.stack(np.divmod(np.arange(64.0), 8.0), axis=1) - (3.5, 3.0)
    lattice = Cloud(position, np.full(64, 0.375), np.full(64, 0.125), np.zeros((64, 2)), horizon=0.0)
    expected = pairs_within_reach(lattice)
    assert len(expected) == 2 * 8 * 7
    assert np.array_equal(listed_pairs(lattice, cell_size=1.0), expected)
