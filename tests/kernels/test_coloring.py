"""Independent sets: no two pairs that share a grain, every contact once, and what is swept."""

from collections import defaultdict

import numpy as np
import pytest
import warp as wp
from stages import OneRecord, grain_total, listed, path, random_graph, record_of_graph
from swept_order import swept_pairs

from warpgrains import Scene, Simulation
from warpgrains.base.arrays import IntArray
from warpgrains.kernels.access import at, put
from warpgrains.kernels.contacts import contacts_of, set_count
from warpgrains.kernels.record import SceneRecord
from warpgrains.kernels.search.coloring import choose_sets, order_contacts
from warpgrains.kernels.team.stages import OPTIONS, Serial
from warpgrains.kernels.team.threads import TeamRecord

MASK_COLORS = 64
SPARSE = random_graph(500, 700, seed=1)
GRAPHS = {
    "empty": np.zeros((0, 2), int),
    "one pair": path(2),
    "path": path(300),
    "star": np.stack([np.zeros(800, int), np.arange(1, 801)], axis=1),
    "star around the last grain": np.stack([np.arange(800), np.full(800, 800)], axis=1),
    "complete": random_graph(80, 80 * 79 // 2, seed=0),
    "sparse": SPARSE,
    "dense": random_graph(100, 3700, seed=2),
}


def levels(pairs: IntArray) -> list[int]:
    """Return one above the highest level among earlier pairs that share a grain."""
    top: dict[int, int] = defaultdict(int)
    found = []
    for i, j in pairs.tolist():
        found.append(max(top[i], top[j]))
        top[i] = top[j] = found[-1] + 1
    return found


def first_fit_colors(pairs: IntArray) -> list[int]:
    """Return the lowest color that neither grain has yet; beyond 64, a color of its own."""
    used: dict[int, set[int]] = defaultdict(set)
    found, next_extra = [], MASK_COLORS
    for i, j in pairs.tolist():
        color = min(set(range(MASK_COLORS)) - used[i] - used[j], default=next_extra)
        next_extra += color == next_extra
        used[i].add(color)
        used[j].add(color)
        found.append(color)
    return found


def grouped(pairs: IntArray, at_walls: IntArray, by_color: bool, merge: bool = False) -> OneRecord:
    """Return the record with every contact at its index."""
    record = record_of_graph(pairs, at_walls)
    record.write({"by_color": by_color, "merge": merge})
    record.run(Serial(choose_sets), Serial(order_contacts))
    return record


@pytest.mark.parametrize("merge", [False, True], ids=["apart", "merged"])
@pytest.mark.parametrize("most", [0, 1, 2], ids=["no walls", "a wall", "two walls"])
@pytest.mark.parametrize("by_color", [False, True], ids=["levels", "colors"])
@pytest.mark.parametrize("name", GRAPHS)
def test_sets(name: str, by_color: bool, most: int, merge: bool) -> None:
    """Pairs by set and, last, contacts with walls, each set in the order of the list."""
    pairs = GRAPHS[name]
    at_walls = np.random.default_rng(4).integers(0, most + 1, grain_total(pairs))
    at_wall, walls = listed(pairs, at_walls)[:, 1] >= len(at_walls), at_walls.sum()
    record = grouped(pairs, at_walls, by_color, merge)
    group, index = (record[f"neighbors.{own}"][: len(at_wall)] for own in ("set_of", "sweep_index"))
    assert (group[at_wall] == -1).all()
    group = group[~at_wall]
    assert group.tolist() == (first_fit_colors if by_color else levels)(pairs)
    touched = np.concatenate([np.stack([group, grain], axis=1) for grain in pairs.T])
    assert len(np.unique(touched, axis=0)) == 2 * len(pairs)
    assert np.array_equal(index[~at_wall][np.argsort(group, kind="stable")], np.arange(len(pairs)))
    assert np.array_equal(index[at_wall], len(pairs) + np.arange(walls))
    sizes = [len(pairs)] if merge else np.bincount(group).tolist()
    assert record["contacts.count"].tolist() == [(len(pairs), len(sizes), walls)]
    ends = record["contacts.set_start"][: len(sizes) + 2]
    assert ends.tolist() == [0, *np.cumsum([*sizes, walls])]


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
                numbers = records[0].neighbors.old_index
                put(numbers, c, 10 * at(numbers, c) + rank + 1)
                c += 1


@pytest.mark.parametrize("driven", [False, True])
@pytest.mark.parametrize("size", [1, 2, 3])
def test_every_contact_has_one_thread(size: int, driven: bool) -> None:
    """Contacts of one grain with walls are not divided, and none with walls where a force drives one."""
    at_walls = np.random.default_rng(6).integers(0, 6, grain_total(SPARSE))
    record, contacts, pairs = grouped(SPARSE, at_walls, by_color=True), listed(SPARSE, at_walls), len(SPARSE)
    grain, total = np.empty(len(contacts), int), len(contacts)
    grain[record["neighbors.sweep_index"][:total]] = contacts[:, 0]
    grain[pairs - 1] = grain[pairs]  # the last pair is of the first grain with a wall
    record["contacts.contact"]["i"][:total] = 2 * grain
    record["neighbors.old_index"][:] = 0
    record.records.host["walls"]["drive"]["shape"][0, 0] = int(driven)
    wp.launch(note_threads, dim=1, inputs=(record.records.device, size), device="cpu")
    thread = record["neighbors.old_index"][:total]
    everyone = set(range(1, size + 1))
    assert set(thread[:pairs]) == everyone
    assert set(thread[pairs:]) == ({1} if driven else everyone)
    alike = grain[pairs + 1 :] == grain[pairs:-1]
    assert (thread[pairs + 1 :] == thread[pairs:-1])[alike].all()


def test_pairs_are_swept_by_first_fit_colors() -> None:
    """Those of a new list, and those of a list that is used again."""
    simulation, rebuilds = Simulation(Scene.load("polydisperse"), order="color"), []
    for _ in range(60):
        rebuilds.append(simulation.step().rebuilds)
        swept = swept_pairs(simulation)
        in_order = swept[np.lexsort(swept.T[::-1])]
        assert np.array_equal(swept, in_order[np.argsort(first_fit_colors(in_order), kind="stable")])
    assert 5 <= rebuilds.count(0) < 50
