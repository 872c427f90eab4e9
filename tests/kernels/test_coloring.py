"""Independent sets: no two pairs that share a grain, every pair once, levels in the sequential order."""

import graphs
import numpy as np
import pytest
from stages import OneRecord, record_of_graph

from warpgrains.arrays import IntArray
from warpgrains.kernels.coloring import gather, group_pairs, place_pairs, tile_pairs
from warpgrains.kernels.record import grain_count
from warpgrains.kernels.stages import Each, Serial

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


@pytest.fixture(params=[False, True], ids=["levels", "colors"])
def by_color(request: pytest.FixtureRequest) -> bool:
    return request.param


def grouped(pairs: IntArray, by_color: bool, merge: bool = False) -> tuple[OneRecord, IntArray]:
    """Return the record with every pair in its place, and the set of every pair."""
    record = record_of_graph(pairs)
    record.record["by_color"], record.record["merge"] = by_color, merge
    record.run(Serial(group_pairs), Serial(place_pairs))
    count = record.record["contacts"]["count"]
    assert count["pairs"] == len(pairs)
    return record, record["workspace.group"][: len(pairs)].copy()


def assert_no_shared_grain(pairs: IntArray, group: IntArray) -> None:
    touched = np.concatenate([np.stack([group, grain], axis=1) for grain in pairs.T])
    assert len(np.unique(touched, axis=0)) == 2 * len(pairs)


def assert_sequential_order(pairs: IntArray, group: IntArray) -> None:
    """Of two pairs that share a grain, the earlier one has the lower set."""
    for grain in range(int(pairs.max(initial=0)) + 1):
        assert (np.diff(group[(pairs == grain).any(axis=1)]) > 0).all()


def test_levels_are_the_lowest_possible(pairs: IntArray) -> None:
    _, level = grouped(pairs, by_color=False)
    assert level.tolist() == graphs.levels(pairs)
    assert_no_shared_grain(pairs, level)
    assert_sequential_order(pairs, level)


def test_colors_are_first_fit(pairs: IntArray) -> None:
    _, color = grouped(pairs, by_color=True)
    assert color.tolist() == graphs.first_fit_colors(pairs)
    assert_no_shared_grain(pairs, color)


def test_every_pair_has_its_place(pairs: IntArray, by_color: bool) -> None:
    record, group = grouped(pairs, by_color)
    place = record["workspace.sweep_index"][: len(pairs)]
    start = record["contacts.set_start"][: record.record["contacts"]["count"]["sets"] + 1]
    assert np.array_equal(np.argsort(place), np.argsort(group, kind="stable"))
    assert np.array_equal(np.sort(place), np.arange(len(pairs)))
    assert np.array_equal(np.diff(start), np.bincount(group))
    assert start[0] == 0
    merged, _ = grouped(pairs, by_color, merge=True)
    assert np.array_equal(merged["workspace.sweep_index"][: len(pairs)], place)
    assert merged["contacts.set_start"][:2].tolist() == [0, len(pairs)]
    assert merged.record["contacts"]["count"]["sets"] == 1


@pytest.mark.parametrize("name", ["star", "complete", "dense"])
def test_kept_colors_stay_within_the_capacity(name: str) -> None:
    """Of lists that follow each other within a step, colors keep their order, and sets stay few."""
    every, rng = GRAPHS[name], np.random.default_rng(0)
    listed = np.ones(len(every), bool)
    record, color = grouped(every, by_color=True)
    record.record["control"]["resuming"] = 1
    for _ in range(60):
        before, old = np.flatnonzero(listed), color
        listed = rng.random(len(every)) < 0.8
        now = np.flatnonzero(listed)
        rows = np.arange(record.record["grains"]["position"]["shape"][0] + 1)
        record["workspace.old.start"][:] = record["neighbors.start"]
        record["workspace.old_color"][: len(old)] = old
        record["neighbors.start"][:] = np.searchsorted(every[now, 0], rows)
        record["neighbors.neighbor"][: len(now)] = every[now, 1]
        place = np.where(np.isin(now, before), np.searchsorted(before, now), -1)
        record["workspace.old_place"][: len(now)] = place
        record.run(Serial(group_pairs), Serial(place_pairs))
        color = record["workspace.group"][: len(now)].copy()
        kept = place >= 0
        first, second = old[place[kept]], color[kept]
        assert np.array_equal(first[first < 64], second[first < 64])
        assert np.array_equal(np.argsort(first, kind="stable"), np.argsort(second, kind="stable"))
        assert_no_shared_grain(every[now], color)
        sets = record.record["contacts"]["count"]["sets"]
        assert sets == color.max() + 1 <= len(every)
        assert np.array_equal(np.unique(color[color >= 64]), np.arange(64, max(sets, 64)))


@pytest.mark.parametrize("tile", [1, 7, 100])
def test_tiles(pairs: IntArray, tile: int, by_color: bool) -> None:
    """Of two pairs that share a grain, the one that was swept first still is; tiles follow each other."""
    record, _ = grouped(pairs, by_color, merge=True)
    before = record["workspace.sweep_index"][: len(pairs)].copy()
    record.record["tuning"]["tile"] = tile
    record.run(Each(grain_count, gather), Serial(tile_pairs))
    assert np.array_equal(record["workspace.sequence"][before, :2], pairs)
    after = record["workspace.sweep_index"][: len(pairs)]
    assert np.array_equal(np.sort(after), np.arange(len(pairs)))
    for grain in range(int(pairs.max(initial=0)) + 1):
        on_grain = (pairs == grain).any(axis=1)
        assert np.array_equal(np.argsort(after[on_grain]), np.argsort(before[on_grain]))
    if not by_color:
        assert (np.diff(np.argsort(after) // tile) >= 0).all()
