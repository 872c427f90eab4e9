"""Turns of several workers: whoever runs ahead, every pair finds what the common order would show it."""

from dataclasses import fields
from itertools import pairwise

import graphs
import numpy as np
import pytest
import warp as wp
from test_order import KERNELS, group_by_colors, group_by_levels, place, rows_of

from warpgrains.arrays import IntArray
from warpgrains.kernels import lanes
from warpgrains.kernels.data import Contacts
from warpgrains.kernels.variant import Variant
from warpgrains.solver.strips import strips

LANES = lanes.kernels(Variant(*[False] * len(fields(Variant))))
GRAPHS = {
    "empty": graphs.empty(),
    "one pair": graphs.path(2),
    "path": graphs.path(3000),
    "star": graphs.star(2000),
    "sparse": graphs.random_graph(2000, 5000, seed=1),
    "dense": graphs.random_graph(150, 8000, seed=2),
}


class Dealt:
    """A graph in an order, dealt out to lanes at random."""

    def __init__(self, pairs: IntArray, by_color: bool, count: int):
        n = int(pairs.max(initial=0)) + 1
        rows, pairs_total = rows_of(pairs), len(pairs)
        self.common, _ = place(pairs, (group_by_colors if by_color else group_by_levels)(pairs), merge=True)
        self.lane = np.random.default_rng(3).integers(0, count, n).astype(np.int32)
        slot = wp.array(self.common, dtype=wp.int32, device="cpu")
        contacts, dealer = Contacts(), lanes.Lanes()
        contacts.count = wp.array([pairs_total, 1, 0], dtype=wp.int32, device="cpu")
        contacts.group_start, contacts.lane_turn = poisoned(pairs_total + 2), poisoned(count + 1)
        contacts.turn_after = poisoned((pairs_total + 1) * count)
        dealer.lane = wp.array(self.lane, dtype=wp.int32, device="cpu")
        dealer.sequence = wp.full(pairs_total, wp.vec3i(-1), dtype=wp.vec3i, device="cpu")
        dealer.turn, dealer.cursor, dealer.late_cursor = (
            poisoned(pairs_total),
            poisoned(count),
            poisoned(count),
        )
        dealer.seen = poisoned(count * count)
        dealer.last = wp.full(n, wp.vec2i(7), dtype=wp.vec2i, device="cpu")
        wp.launch(KERNELS.line_up, dim=n, inputs=(rows, slot, dealer.sequence), device="cpu")
        wp.launch(LANES.deal, dim=1, inputs=(contacts, slot, dealer), device="cpu")
        wp.launch(LANES.hold_back, dim=1, inputs=(contacts, dealer), device="cpu")
        turns = contacts.count.numpy()[1]
        self.slot, self.start = slot.numpy(), contacts.group_start.numpy()[: turns + 1]
        self.lane_turn = contacts.lane_turn.numpy()
        self.after = contacts.turn_after.numpy()[: turns * count].reshape(turns, count)
        self.turn = np.searchsorted(self.start, self.slot, side="right") - 1


def poisoned(count: int) -> wp.array:
    return wp.full(count, -7, dtype=wp.int32, device="cpu")


@pytest.fixture(params=GRAPHS)
def pairs(request: pytest.FixtureRequest) -> IntArray:
    return GRAPHS[request.param]


@pytest.fixture(params=[1, 2, 3])
def count(request: pytest.FixtureRequest) -> int:
    return request.param


@pytest.fixture(params=[False, True], ids=["levels", "colors"])
def dealt(request: pytest.FixtureRequest, pairs: IntArray, count: int) -> Dealt:
    return Dealt(pairs, request.param, count)


def test_every_worker_has_its_pairs_in_the_common_order(pairs: IntArray, count: int, dealt: Dealt) -> None:
    assert np.array_equal(np.sort(dealt.slot), np.arange(len(pairs)))
    assert dealt.lane_turn[0] == 0
    assert dealt.lane_turn[-1] == len(dealt.start) - 1
    for worker in range(count):
        own = dealt.lane[pairs[:, 0]] == worker if len(pairs) else np.zeros(0, dtype=bool)
        turns = dealt.turn[own]
        assert ((turns >= dealt.lane_turn[worker]) & (turns < dealt.lane_turn[worker + 1])).all()
        assert np.array_equal(np.argsort(dealt.slot[own]), np.argsort(dealt.common[own]))


def test_a_pair_comes_after_all_before_it_on_its_grains(pairs: IntArray, dealt: Dealt) -> None:
    """Follow every grain along the common order: its next pair waits for the last, whoever sweeps it."""
    for grain in range(int(pairs.max(initial=-1)) + 1):
        on_grain = np.flatnonzero((pairs == grain).any(axis=1))
        chain = on_grain[np.argsort(dealt.common[on_grain])]
        for before, after in pairwise(chain):
            worker, other = dealt.lane[pairs[after, 0]], dealt.lane[pairs[before, 0]]
            if worker == other:
                assert dealt.slot[before] < dealt.slot[after]
                continue
            waits = dealt.after[dealt.lane_turn[worker] : dealt.turn[after] + 1, other]
            assert waits.max() > dealt.turn[before] - dealt.lane_turn[other]


def test_no_worker_waits_for_what_comes_later(pairs: IntArray, count: int, dealt: Dealt) -> None:
    """A turn waits only for pairs before its own first in the common order: nobody waits in a ring."""
    by_slot = np.argsort(dealt.slot)
    for turn, after in enumerate(dealt.after):
        first = dealt.common[by_slot[dealt.start[turn]]]
        for other in range(count):
            ended = dealt.start[dealt.lane_turn[other] + after[other]]
            waited_for = by_slot[dealt.start[dealt.lane_turn[other]] : ended]
            assert (dealt.common[waited_for] < first).all() or after[other] == 0


def test_strips_share_the_pairs_evenly_and_cut_across_the_rows() -> None:
    x, y = np.meshgrid(np.arange(100.0), np.arange(40.0))
    rows = np.column_stack([x.ravel(), y.ravel()])
    lane = strips(rows, np.full(4000, 3), 4)
    assert (np.abs(np.bincount(lane) - 1000) <= 40).all()  # a cut falls between two columns of 40 grains
    assert np.array_equal(lane.reshape(40, 100)[0], lane.reshape(40, 100)[-1])
    assert strips(rows, np.zeros(4000, dtype=int), 4).max() <= 3
    assert strips(np.zeros((1, 2)), np.zeros(1, dtype=int), 2).shape == (1,)
