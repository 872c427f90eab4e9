"""Segments of several threads: whoever runs ahead, every pair finds what the common order would show it."""

from itertools import pairwise

import graphs
import numpy as np
import pytest
from stages import OneRecord, record_of_graph

from warpgrains import Scene
from warpgrains.arrays import FloatArray, IntArray
from warpgrains.kernels.coloring import gather, group_pairs, place_pairs
from warpgrains.kernels.record import grain_count
from warpgrains.kernels.stages import Each, Serial
from warpgrains.kernels.strips import cut_into_strips, deal_pairs, find_dependencies, number_segments

GRAPHS = {
    "empty": graphs.empty(),
    "one pair": graphs.path(2),
    "path": graphs.path(3000),
    "star": graphs.star(2000),
    "sparse": graphs.random_graph(2000, 5000, seed=1),
    "dense": graphs.random_graph(150, 8000, seed=2),
}


class Dealt:
    """A graph in an order, dealt out to strips at random."""

    def __init__(self, pairs: IntArray, by_color: bool, count: int):
        record = record_of_graph(pairs, team=count)
        record.record["by_color"], record.record["merge"] = by_color, 1
        record.run(Serial(group_pairs), Serial(place_pairs), Each(grain_count, gather))
        self.common = record["workspace.sweep_index"][: len(pairs)].copy()
        strip = record["strips.strip"]
        strip[:] = np.random.default_rng(3).integers(0, count, len(strip))
        for name in ("last", "cursor", "late_cursor", "seen", "segment", "first_segment", "dependencies"):
            record[f"strips.{name}"][:] = -7
        record.run(Serial(deal_pairs), Serial(number_segments), Serial(find_dependencies))
        segments = record.record["contacts"]["count"]["sets"]
        self.strip, self.place = strip, record["workspace.sweep_index"][: len(pairs)]
        self.start = record["contacts.set_start"][: segments + 1]
        self.first_segment = record["strips.first_segment"]
        self.after = record["strips.dependencies"][: segments * count].reshape(segments, count)
        self.segment = np.searchsorted(self.start, self.place, side="right") - 1


@pytest.fixture(params=GRAPHS)
def pairs(request: pytest.FixtureRequest) -> IntArray:
    return GRAPHS[request.param]


@pytest.fixture(params=[2, 3])
def count(request: pytest.FixtureRequest) -> int:
    return request.param


@pytest.fixture(params=[False, True], ids=["levels", "colors"])
def dealt(request: pytest.FixtureRequest, pairs: IntArray, count: int) -> Dealt:
    return Dealt(pairs, request.param, count)


def test_every_thread_has_its_pairs_in_the_common_order(pairs: IntArray, count: int, dealt: Dealt) -> None:
    assert np.array_equal(np.sort(dealt.place), np.arange(len(pairs)))
    assert dealt.first_segment[0] == 0
    assert dealt.first_segment[-1] == len(dealt.start) - 1
    for rank in range(count):
        own = dealt.strip[pairs[:, 0]] == rank
        segments = dealt.segment[own]
        first, last = dealt.first_segment[rank : rank + 2]
        assert ((segments >= first) & (segments < last)).all()
        assert np.array_equal(np.argsort(dealt.place[own]), np.argsort(dealt.common[own]))


def test_a_pair_comes_after_all_before_it_on_its_grains(pairs: IntArray, dealt: Dealt) -> None:
    """Follow every grain along the common order: its next pair waits for the last, whoever sweeps it."""
    for grain in range(int(pairs.max(initial=-1)) + 1):
        on_grain = np.flatnonzero((pairs == grain).any(axis=1))
        chain = on_grain[np.argsort(dealt.common[on_grain])]
        for before, after in pairwise(chain):
            rank, other = dealt.strip[pairs[after, 0]], dealt.strip[pairs[before, 0]]
            if rank == other:
                assert dealt.place[before] < dealt.place[after]
                continue
            waits = dealt.after[dealt.first_segment[rank] : dealt.segment[after] + 1, other]
            assert waits.max() > dealt.segment[before] - dealt.first_segment[other]


def test_no_thread_waits_for_what_comes_later(count: int, dealt: Dealt) -> None:
    """A segment waits only for pairs before its own first in the common order: nobody waits in a ring."""
    by_place = np.argsort(dealt.place)
    for segment, after in enumerate(dealt.after):
        first = dealt.common[by_place[dealt.start[segment]]]
        for other in range(count):
            begin = dealt.first_segment[other]
            waited_for = by_place[dealt.start[begin] : dealt.start[begin + after[other]]]
            assert (dealt.common[waited_for] < first).all() or after[other] == 0


def strips(position: FloatArray, pairs_a_grain: int, count: int) -> IntArray:
    """Cut grains at these positions into strips, each the first of so many pairs."""
    n = len(position)
    scene = Scene(position=position, radius=1e-3, mass=1.0, radius_out=100.0)
    record = OneRecord(scene, pairs_a_grain * n + 1, team=count)
    record["grains.position"][:] = position
    record["neighbors.start"][:] = pairs_a_grain * np.arange(n + 1)
    record.record["contacts"]["count"]["pairs"] = pairs_a_grain * n
    record["strips.strip"][:] = -7
    record.run(Serial(cut_into_strips))
    return record["strips.strip"]


def test_strips_share_the_pairs_evenly_and_cut_across_the_rows() -> None:
    x, y = np.meshgrid(np.arange(100.0) - 49.5, np.arange(40.0))
    rows = np.column_stack([x.ravel(), y.ravel()])
    strip = strips(rows, 3, 4)
    assert (np.abs(np.bincount(strip) - 1000) <= 40).all()  # a cut falls between two columns of 40 grains
    assert np.array_equal(strip.reshape(40, 100)[0], strip.reshape(40, 100)[-1])
    assert strips(rows, 0, 4).max() <= 3
    assert strips(np.array([[0.5, 0.0]]), 0, 2).shape == (1,)
