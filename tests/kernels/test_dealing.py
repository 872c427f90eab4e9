"""Segments of several threads: whoever runs ahead, every pair finds what the common order would show it."""

from itertools import pairwise

import graphs
import numpy as np
import pytest
from stages import grain_total, record_of_graph

from warpgrains.arrays import IntArray
from warpgrains.kernels.coloring import gather, group_pairs, place_pairs, place_walls, tile_pairs
from warpgrains.kernels.dealing import deal_out
from warpgrains.kernels.record import grain_count
from warpgrains.kernels.stages import Each, Serial

GRAPHS = {
    "empty": graphs.empty(),
    "one pair": graphs.path(2),
    "path": graphs.path(3000),
    "star": graphs.star(2000),
    "star around the last grain": graphs.hub_last(2000),
    "sparse": graphs.random_graph(2000, 5000, seed=1),
    "dense": graphs.random_graph(150, 8000, seed=2),
}
TEAMS = [2, 3]


class Dealt:
    """A graph in an order, with none to two walls at each grain, dealt out to the threads of a team."""

    def __init__(self, pairs: IntArray, by_color: bool, tile: int, count: int):
        at_walls = np.arange(grain_total(pairs)) % 3
        record = record_of_graph(pairs, at_walls, team=count)
        record.record["by_color"], record.record["merge"] = by_color, 1
        record.record["tuning"]["tile"] = tile
        record.run(Serial(group_pairs), Serial(place_pairs))
        record.run(Each(grain_count, gather), Serial(tile_pairs), Each(grain_count, gather))
        rows = record["neighbors.start"]
        is_pair = record["neighbors.neighbor"][: rows[-1]] < len(at_walls)
        self.common = record["workspace.sweep_index"][: rows[-1]][is_pair]
        for name in ("first", "cursor", "seen", "last", "begins", "first_segment", "dependencies"):
            record[f"dealt.{name}"][:] = -7
        record.run(Serial(deal_out), Serial(place_walls))
        self.count = record.record["contacts"]["count"]
        segments = self.count["sets"]
        self.place = record["workspace.sweep_index"][: rows[-1]][is_pair]
        self.walls = record["workspace.sweep_index"][: rows[-1]][~is_pair]
        self.wall_start = record["contacts.set_start"][segments : segments + 1 + self.count["wall_sets"]]
        self.start = record["contacts.set_start"][: segments + 1]
        self.first_segment = record["dealt.first_segment"]
        self.after = record["dealt.dependencies"][: segments * count].reshape(segments, count)
        self.segment = np.searchsorted(self.start, self.place, side="right") - 1
        self.first = self.start[self.first_segment]
        self.thread = np.searchsorted(self.first, self.place, side="right") - 1


@pytest.fixture(params=GRAPHS)
def pairs(request: pytest.FixtureRequest) -> IntArray:
    return GRAPHS[request.param]


@pytest.fixture(params=TEAMS)
def count(request: pytest.FixtureRequest) -> int:
    return request.param


@pytest.fixture(params=[20, 1000], ids=["short tiles", "long tiles"])
def tile(request: pytest.FixtureRequest) -> int:
    return request.param


@pytest.fixture(params=[False, True], ids=["levels", "colors"])
def dealt(request: pytest.FixtureRequest, pairs: IntArray, tile: int, count: int) -> Dealt:
    return Dealt(pairs, request.param, tile, count)


def test_every_thread_has_its_pairs_in_the_common_order(pairs: IntArray, count: int, dealt: Dealt) -> None:
    assert np.array_equal(np.sort(dealt.place), np.arange(len(pairs)))
    assert (np.diff(dealt.start) > 0).all()
    assert dealt.first_segment[0] == 0
    assert dealt.first_segment[-1] == len(dealt.start) - 1
    for rank in range(count):
        own = dealt.thread == rank
        assert np.array_equal(np.argsort(dealt.place[own]), np.argsort(dealt.common[own]))


def test_walls_come_after_all_segments(pairs: IntArray, dealt: Dealt) -> None:
    walls = len(dealt.walls)
    assert dealt.count["walls"] == walls
    assert np.array_equal(np.sort(dealt.walls), len(pairs) + np.arange(walls))
    assert (dealt.wall_start[0], dealt.wall_start[-1]) == (len(pairs), len(pairs) + walls)


def test_all_threads_have_about_as_many(pairs: IntArray, count: int, dealt: Dealt) -> None:
    """No thread has more than the others by the longest tile that one may be dealt."""
    longest = 2 * -(-(len(pairs) + len(dealt.walls)) // (8 * count))
    assert np.diff(dealt.first).min() >= np.diff(dealt.first).max() - longest


def test_a_pair_comes_after_all_before_it_on_its_grains(pairs: IntArray, dealt: Dealt) -> None:
    """Follow every grain along the common order: its next pair waits for the last, whoever sweeps it."""
    for grain in range(int(pairs.max(initial=-1)) + 1):
        on_grain = np.flatnonzero((pairs == grain).any(axis=1))
        chain = on_grain[np.argsort(dealt.common[on_grain])]
        for before, after in pairwise(chain):
            rank, other = dealt.thread[after], dealt.thread[before]
            if rank == other:
                assert dealt.place[before] < dealt.place[after]
                continue
            waits = dealt.after[dealt.first_segment[rank] : dealt.segment[after] + 1, other]
            assert waits.max() > dealt.place[before]


def test_what_is_waited_for_is_told(count: int, dealt: Dealt) -> None:
    """A thread tells where it is at the end of a segment: one ends wherever another waits for."""
    for other in range(count):
        ends = dealt.start[dealt.first_segment[other] + 1 : dealt.first_segment[other + 1] + 1]
        awaited = dealt.after[:, other]
        assert np.isin(awaited[awaited > 0], ends).all()


def test_no_thread_waits_for_what_comes_later(count: int, dealt: Dealt) -> None:
    """A segment waits only for pairs before its own first in the common order: nobody waits in a ring."""
    by_place = np.argsort(dealt.place)
    for segment, after in enumerate(dealt.after):
        first = dealt.common[by_place[dealt.start[segment]]]
        for other in range(count):
            waited_for = by_place[dealt.first[other] : after[other]]
            assert (dealt.common[waited_for] < first).all()
