"""Independent sets: no two pairs that share a grain, every contact once, levels in the sequential order."""

import graphs
import numpy as np
import pytest
import warp as wp
from stages import OneRecord, grain_total, record_of_graph

from warpgrains.arrays import IntArray
from warpgrains.kernels.access import at, put
from warpgrains.kernels.coloring import choose_sets, place_contacts
from warpgrains.kernels.contacts import contacts_of, set_count
from warpgrains.kernels.record import SceneRecord
from warpgrains.kernels.stages import OPTIONS, Serial
from warpgrains.kernels.threads import TeamRecord

GRAPHS = {
    "empty": graphs.empty(),
    "one pair": graphs.path(2),
    "path": graphs.path(300),
    "star": graphs.star(800),
    "star around the last grain": graphs.hub_last(800),
    "complete": graphs.complete(80),
    "sparse": graphs.random_graph(500, 700, seed=1),
    "dense": graphs.random_graph(100, 3700, seed=2),
}


@pytest.fixture(params=GRAPHS)
def pairs(request: pytest.FixtureRequest) -> IntArray:
    return GRAPHS[request.param]


@pytest.fixture(params=[False, True], ids=["levels", "colors"])
def by_color(request: pytest.FixtureRequest) -> bool:
    return request.param


@pytest.fixture(params=[0, 2], ids=["no walls", "walls"])
def at_walls(request: pytest.FixtureRequest, pairs: IntArray) -> IntArray:
    """Return at how many walls each grain is."""
    return np.random.default_rng(3).integers(0, request.param + 1, grain_total(pairs))


def grouped(
    pairs: IntArray, at_walls: IntArray, by_color: bool, merge: bool = False
) -> tuple[OneRecord, IntArray]:
    """Return the record with every pair at its index, and the set of every pair."""
    record = record_of_graph(pairs, at_walls)
    record.record["by_color"], record.record["merge"] = by_color, merge
    record.run(Serial(choose_sets), Serial(place_contacts))
    assert record.record["contacts"]["count"]["pairs"] == len(pairs)
    group = of_pairs(record, "set_of")
    assert (record["workspace.set_of"][of_walls(record)] == -1).all()
    return record, group


def of_walls(record: OneRecord) -> IntArray:
    """Return the places of contacts with walls in the list."""
    rows = record["neighbors.start"]
    return np.flatnonzero(record["neighbors.neighbor"][: rows[-1]] >= len(rows) - 1)


def of_pairs(record: OneRecord, name: str) -> IntArray:
    """Return an array of the workspace for the pairs alone, in the order of the list."""
    return np.delete(record[f"workspace.{name}"][: record["neighbors.start"][-1]], of_walls(record))


def assert_no_shared_grain(pairs: IntArray, group: IntArray) -> None:
    touched = np.concatenate([np.stack([group, grain], axis=1) for grain in pairs.T])
    assert len(np.unique(touched, axis=0)) == 2 * len(pairs)


def assert_sequential_order(pairs: IntArray, group: IntArray) -> None:
    """Of two pairs that share a grain, the earlier one has the lower set."""
    for grain in range(grain_total(pairs)):
        assert (np.diff(group[(pairs == grain).any(axis=1)]) > 0).all()


def test_levels_are_the_lowest_possible(pairs: IntArray, at_walls: IntArray) -> None:
    _, level = grouped(pairs, at_walls, by_color=False)
    assert level.tolist() == graphs.levels(pairs)
    assert_no_shared_grain(pairs, level)
    assert_sequential_order(pairs, level)


def test_colors_are_first_fit(pairs: IntArray, at_walls: IntArray) -> None:
    _, color = grouped(pairs, at_walls, by_color=True)
    assert color.tolist() == graphs.first_fit_colors(pairs)
    assert_no_shared_grain(pairs, color)


def test_every_pair_has_its_index(pairs: IntArray, at_walls: IntArray, by_color: bool) -> None:
    record, group = grouped(pairs, at_walls, by_color)
    index = of_pairs(record, "sweep_index")
    start = record["contacts.set_start"][: record.record["contacts"]["count"]["sets"] + 1]
    assert np.array_equal(np.argsort(index), np.argsort(group, kind="stable"))
    assert np.array_equal(np.sort(index), np.arange(len(pairs)))
    assert np.array_equal(np.diff(start), np.bincount(group))
    assert start[0] == 0
    merged, _ = grouped(pairs, at_walls, by_color, merge=True)
    assert np.array_equal(of_pairs(merged, "sweep_index"), index)
    assert merged["contacts.set_start"][:2].tolist() == [0, len(pairs)]
    assert merged.record["contacts"]["count"]["sets"] == 1


@pytest.mark.parametrize("merge", [False, True])
@pytest.mark.parametrize("most", [0, 1, 2])
def test_walls_come_last(pairs: IntArray, by_color: bool, merge: bool, most: int) -> None:
    """Contacts with walls are one set, in the order of the list."""
    at_walls = np.random.default_rng(4).integers(0, most + 1, grain_total(pairs))
    record, _ = grouped(pairs, at_walls, by_color, merge)
    count, walls = record.record["contacts"]["count"], at_walls.sum()
    assert count.tolist()[0] == len(pairs)
    assert count.tolist()[2] == walls
    index = record["workspace.sweep_index"][of_walls(record)]
    assert np.array_equal(index, len(pairs) + np.arange(walls))
    assert record["contacts.set_start"][count["sets"] :][:2].tolist() == [len(pairs), len(pairs) + walls]


@wp.kernel(module="unique", module_options=OPTIONS)
def note_threads(records: wp.array(dtype=SceneRecord), size: int) -> None:
    """Append the number of every thread, from 1 on, to those of its contacts."""
    team = TeamRecord()
    team.size = size
    for rank in range(size):
        team.rank = rank
        for k in range(set_count(records[0])):
            c, end = contacts_of(team, records[0], k)
            while c < end:
                numbers = records[0].workspace.old_place
                put(numbers, c, 10 * at(numbers, c) + rank + 1)
                c += 1


@pytest.mark.parametrize("driven", [False, True])
@pytest.mark.parametrize("size", [1, 2, 3])
def test_every_contact_has_one_thread(size: int, driven: bool) -> None:
    """Contacts of one grain with walls are not divided, and none with walls where a force drives one."""
    pairs, rng = GRAPHS["sparse"], np.random.default_rng(6)
    record, _ = grouped(pairs, rng.integers(0, 6, grain_total(pairs)), by_color=True)
    rows, index = record["neighbors.start"], record["workspace.sweep_index"][: record["neighbors.start"][-1]]
    grain = np.empty(len(index), int)
    grain[index] = np.repeat(np.arange(len(rows) - 1), np.diff(rows))
    grain[len(pairs) - 1] = grain[len(pairs)]  # the last pair is of the first grain with a wall
    record["contacts.contact"]["i"][: len(index)] = 2 * grain
    record["workspace.old_place"][:] = 0
    record.record["walls"]["drive"]["shape"][0] = int(driven)
    wp.launch(note_threads, dim=1, inputs=(record.records.device, size), device="cpu")
    thread = record["workspace.old_place"][: len(index)]
    at_wall = np.arange(len(index)) >= len(pairs)
    assert np.isin(thread, np.arange(size) + 1).all()
    assert set(thread[~at_wall]) == set(range(1, size + 1))
    assert set(thread[at_wall]) == ({1} if driven else set(range(1, size + 1)))
    alike = at_wall[1:] & at_wall[:-1] & (grain[1:] == grain[:-1])
    assert (thread[1:] == thread[:-1])[alike].all()
