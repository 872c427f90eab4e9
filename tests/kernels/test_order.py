"""Groups of contacts: no two that share a grain, every contact once, and levels in the sequential order."""

from collections.abc import Callable
from dataclasses import fields

import graphs
import numpy as np
import pytest
import warp as wp

from warpgrains.arrays import IntArray
from warpgrains.kernels import order
from warpgrains.kernels.data import Contacts
from warpgrains.kernels.detect import Rows
from warpgrains.kernels.variant import Variant

KERNELS = order.kernels(Variant(*[False] * len(fields(Variant))))

GRAPHS = {
    "empty": graphs.empty(),
    "one pair": graphs.path(2),
    "path": graphs.path(300),
    "star": graphs.star(5000),
    "star around the last grain": graphs.hub_last(5000),
    "complete": graphs.complete(100),
    "sparse": graphs.random_graph(500, 700, seed=1),
    "dense": graphs.random_graph(150, 8000, seed=2),
}


@pytest.fixture(params=GRAPHS)
def pairs(request: pytest.FixtureRequest) -> IntArray:
    return GRAPHS[request.param]


def rows_of(pairs: IntArray) -> Rows:
    """Bring a graph to the device."""
    n = int(pairs.max(initial=0)) + 1
    rows = Rows()
    starts = np.searchsorted(pairs[:, 0], np.arange(n + 1)).astype(np.int32)
    rows.start = wp.array(starts, dtype=wp.int32, device="cpu")
    rows.neighbor = wp.array(pairs[:, 1].copy(), dtype=wp.int32, device="cpu")
    return rows


def group_by_levels(pairs: IntArray) -> IntArray:
    rows, group = rows_of(pairs), wp.full(len(pairs), -1, dtype=wp.int32, device="cpu")
    next_level = wp.full(len(rows.start), -1, dtype=wp.int32, device="cpu")
    wp.launch(KERNELS.levels, dim=1, inputs=(rows, next_level, group), device="cpu")
    return group.numpy()


def group_by_colors(pairs: IntArray) -> IntArray:
    rows, group = rows_of(pairs), wp.full(len(pairs), -1, dtype=wp.int32, device="cpu")
    used = wp.full(len(rows.start), 2**64 - 1, dtype=wp.uint64, device="cpu")
    wp.launch(KERNELS.colors, dim=1, inputs=(rows, used, group), device="cpu")
    return group.numpy()


def place(pairs: IntArray, group: IntArray, merge: bool) -> tuple[IntArray, IntArray]:
    """Return the slot of every pair, and where the groups start."""
    contacts, slot = Contacts(), wp.full(len(pairs), -1, dtype=wp.int32, device="cpu")
    contacts.group_start = wp.full(len(pairs) + 2, -1, dtype=wp.int32, device="cpu")
    contacts.count = wp.full(3, -1, dtype=wp.int32, device="cpu")
    groups = wp.array(group, dtype=wp.int32, device="cpu")
    wp.launch(KERNELS.place, dim=1, inputs=(rows_of(pairs), groups, int(merge), contacts, slot), device="cpu")
    listed, count, _ = contacts.count.numpy()
    assert listed == len(pairs)
    return slot.numpy(), contacts.group_start.numpy()[: count + 1]


def assert_no_shared_grain(pairs: IntArray, group: IntArray) -> None:
    touched = np.concatenate([np.stack([group, grain], axis=1) for grain in pairs.T])
    assert len(np.unique(touched, axis=0)) == 2 * len(pairs)


def assert_sequential_order(pairs: IntArray, group: IntArray) -> None:
    """Of two pairs that share a grain, the earlier one has the lower group."""
    for grain in range(int(pairs.max(initial=0)) + 1):
        assert (np.diff(group[(pairs == grain).any(axis=1)]) > 0).all()


def test_levels_are_the_lowest_possible(pairs: IntArray) -> None:
    level = group_by_levels(pairs)
    assert level.tolist() == graphs.levels(pairs)
    assert_no_shared_grain(pairs, level)
    assert_sequential_order(pairs, level)


def test_colors_are_first_fit(pairs: IntArray) -> None:
    color = group_by_colors(pairs)
    assert color.tolist() == graphs.first_fit_colors(pairs)
    assert_no_shared_grain(pairs, color)


@pytest.mark.parametrize("group_by", [group_by_levels, group_by_colors])
def test_every_pair_has_its_place(pairs: IntArray, group_by: Callable[[IntArray], IntArray]) -> None:
    group = group_by(pairs)
    slot, start = place(pairs, group, merge=False)
    assert np.array_equal(np.argsort(slot), np.argsort(group, kind="stable"))
    assert np.array_equal(np.sort(slot), np.arange(len(pairs)))
    assert np.array_equal(np.diff(start), np.bincount(group))
    assert start[0] == 0
    merged_slot, merged_start = place(pairs, group, merge=True)
    assert np.array_equal(merged_slot, slot)
    assert merged_start.tolist() == [0, len(pairs)]


@pytest.mark.parametrize("group_by", [group_by_levels, group_by_colors])
@pytest.mark.parametrize("window", [1, 7, 100])
def test_windows(pairs: IntArray, window: int, group_by: Callable[[IntArray], IntArray]) -> None:
    """Of two pairs that share a grain, the one that was swept first still is; windows follow each other."""
    contacts, rows = Contacts(), rows_of(pairs)
    contacts.count = wp.array([len(pairs), -1, -1], dtype=wp.int32, device="cpu")
    before, _ = place(pairs, group_by(pairs), merge=True)
    sequence = wp.full(len(pairs), wp.vec3i(-1), dtype=wp.vec3i, device="cpu")
    slot = wp.array(before, dtype=wp.int32, device="cpu")
    wp.launch(KERNELS.line_up, dim=len(rows.start) - 1, inputs=(rows, slot, sequence), device="cpu")
    assert np.array_equal(sequence.numpy().reshape(-1, 3)[before, :2], pairs.reshape(-1, 2))
    scratch = [wp.full(len(pairs) + 2, -1, dtype=wp.int32, device="cpu") for _ in range(2)]
    wp.launch(KERNELS.windows, dim=1, inputs=(contacts, sequence, window, *scratch, slot), device="cpu")
    after = slot.numpy()
    assert np.array_equal(np.sort(after), np.arange(len(pairs)))
    for grain in range(int(pairs.max(initial=0)) + 1):
        on_grain = (pairs == grain).any(axis=1)
        assert np.array_equal(np.argsort(after[on_grain]), np.argsort(before[on_grain]))
    if group_by is group_by_levels:
        assert (np.diff(np.argsort(after) // window) >= 0).all()
