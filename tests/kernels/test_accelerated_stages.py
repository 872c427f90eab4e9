"""The working set of the accelerated method, stage by stage.

Numbers are eighths, normals are along an axis and slides are sides of a right triangle: nothing is rounded,
and many contacts are exactly at a bound.
"""

import numpy as np
import pytest
from stages import OneRecord, grains_apart

from warpgrains.arrays import FloatArray
from warpgrains.kernels import restart, working_set
from warpgrains.kernels.chunks import part_count, wall_part_count
from warpgrains.kernels.record import grain_count
from warpgrains.kernels.stages import Each, Serial, Sets, Shared

N, PAIRS, STARTS = 150, 300, [0, 130, 131, 300]
PARTS = [(0, 128), (128, 130), (130, 131), (131, 256), (256, 300)]
TOLERANCE = 2.0**-4


def eighths(rng: np.random.Generator, low: int, high: int, shape: object) -> FloatArray:
    return rng.integers(low, high, shape) / 8.0


class Accelerated:
    """A record of random contacts, in three sets, with two chunks of walls."""

    def __init__(self, equal: bool = False, inner: bool = True, slides: bool = True):
        rng = np.random.default_rng(3)
        scene = grains_apart(N).replace(method="accelerated", stop="zeta", tolerance=TOLERANCE)
        if not equal:
            scene = scene.replace(mass=rng.choice([0.5, 1.0, 2.0], N))
        self.record = record = OneRecord(scene, PAIRS)
        record["grains.mass"][:] = scene.mass
        record._records.keep_history(0, 40)
        record["grains.next_velocity"][:] = eighths(rng, -8, 9, (N, 2))
        self.pairs, self.walls = record["contacts.pairs"][:PAIRS], record["contacts.walls"]
        self.pairs["i"], self.pairs["j"] = np.sort(
            rng.permuted(np.tile(np.arange(N), (PAIRS, 1)), axis=1)[:, :2]
        ).T
        axes = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
        self.pairs["n"], self.pairs["gap_rate"] = axes[rng.integers(0, 4, PAIRS)], eighths(rng, 0, 20, PAIRS)
        self.walls["i"], self.walls["n"] = rng.permutation(N), axes[rng.integers(0, 4, N)]
        self.walls["gap_rate_out"], self.walls["gap_rate_in"] = eighths(rng, 0, 12, N), eighths(rng, 0, 12, N)
        self.walls["reach"] = 5.0
        if slides:  # along = 3 of reach = 5: the circle leaves 1 less
            record["grains.next_velocity"][self.walls["i"]] = (
                eighths(rng, -8, 9, N)[:, None] * self.walls["n"]
                + rng.choice([0.0, 3.0], N)[:, None] * self.walls["n"][:, ::-1]
            )
        self._carry(rng)
        record["contacts.set_start"][:4] = STARTS
        whole = record.record
        whole["contacts"]["count"] = PAIRS, 3, N
        whole["walls"]["radius_in"], whole["walls"]["round"] = float(inner), int(slides)
        whole["tuning"]["nearest"], whole["step"]["zeta"], whole["step"]["iterations"] = 0.125, 9.0, 1
        if not equal:
            record["contacts.weights"][:PAIRS] = eighths(rng, 1, 8, (PAIRS, 2))
        for name in ("pair_range", "wall_range", "pair", "wall"):
            record[f"working.{name}"][:] = -7
        record["partial.zeta"][:] = 0.0

    def _carry(self, rng: np.random.Generator) -> None:
        record = self.record
        for now, last, count in (
            (record["contacts.pair_dv"], record["momentum.pair_last"], PAIRS),
            (self.walls["dv"], record["momentum.wall_last"], N),
        ):
            which, sign = rng.integers(0, 12, count), rng.choice([-1.0, 1.0], count) if count == N else 1.0
            now[:count] = sign * np.where(which < 2, eighths(rng, 1, 9, count), 0.0)
            last[:count] = sign * np.where((which == 1) | (which == 2), eighths(rng, 1, 9, count), 0.0)

    def select(self) -> None:
        self.record.run(Sets(working_set.select_pairs), Shared(working_set.select_walls))

    def chosen(self, walls: bool) -> list[int]:
        """Return the contacts of the working set, and check that each part begins where its contacts do."""
        name, parts = ("wall", [(0, 128), (128, N)]) if walls else ("pair", PARTS)
        chosen = []
        for part, (begin, end) in enumerate(parts):
            first, last = self.record[f"working.{name}_range"][part].tolist()
            assert first == begin
            assert last <= end
            chosen += self.record[f"working.{name}"][first:last].tolist()
        return chosen

    def indices(self, walls: bool) -> list[int]:
        kind, count = ("wall", 2) if walls else ("pair", len(PARTS))
        ranges = self.record[f"working.{kind}_range"][:count].tolist()
        return [index for first, last in ranges for index in range(first, last)]


NEAR = [(0, 9.0, 0.125, 0.0), (1, 9.0, 0.125, 0.125), (5, 1.0, 9.0, 0.25)]


@pytest.mark.parametrize(("iterations", "zeta", "nearest", "h"), NEAR)
@pytest.mark.parametrize("inner", [True, False])
@pytest.mark.parametrize("slides", [True, False])
def test_selection(iterations: int, zeta: float, nearest: float, h: float, inner: bool, slides: bool) -> None:
    """Contacts that carry, or did, or are violated but for h, 2 h where it is a pair, are swept."""
    ahead = Accelerated(inner=inner, slides=slides)
    record, whole = ahead.record, ahead.record.record
    whole["step"]["iterations"], whole["step"]["zeta"], whole["tuning"]["nearest"] = iterations, zeta, nearest
    v, pairs, walls = record["grains.next_velocity"], ahead.pairs, ahead.walls
    pairs["gap_rate"][0], record["contacts.pair_dv"][0] = -50.0, 1.0  # what they are violated by is swept
    walls["gap_rate_out"][0], walls["dv"][0] = -40.0, 1.0
    dv, last = record["contacts.pair_dv"][:PAIRS], record["momentum.pair_last"][:PAIRS]
    excess = ((v[pairs["i"]] - v[pairs["j"]]) * pairs["n"]).sum(axis=1) - pairs["gap_rate"]
    carries = (dv != 0.0) | (last != 0.0)
    selected = np.flatnonzero(carries | (excess > -2.0 * h))
    own = v[walls["i"]]
    vn, along = (own * walls["n"]).sum(axis=1), np.abs((own * walls["n"][:, ::-1]).sum(axis=1))
    out = walls["gap_rate_out"] - (np.where(along == 3.0, 1.0, 0.0) if slides else 0.0)
    held = (walls["dv"] != 0.0) | (record["momentum.wall_last"] != 0.0)
    back = walls["gap_rate_in"] if inner else np.inf

    def pushed(near: float) -> FloatArray:
        return np.maximum(0.0, vn - out + near) - np.maximum(0.0, near - vn - back)

    near = np.flatnonzero(held | (pushed(h) != 0.0))
    ahead.select()
    assert ahead.chosen(walls=False) == selected.tolist()
    assert ahead.chosen(walls=True) == near.tolist()
    assert 0 < (~carries[selected]).sum() < PAIRS / 2
    violation = max(excess[~carries].max(), np.abs(pushed(0.0))[~held].max())
    assert record["partial.zeta"][0] == violation


@pytest.mark.parametrize("most", ["pair", "wall", "inner wall"])
def test_largest_violation_is_found_wherever_it_is(most: str) -> None:
    for place in (0, 127, 129, 130, 200, 299) if most == "pair" else (0, 127, 149):
        ahead = Accelerated(slides=False)
        record = ahead.record
        record["grains.next_velocity"][:] = 0.0
        ahead.pairs["gap_rate"], ahead.walls["gap_rate_out"], ahead.walls["gap_rate_in"] = 1.0, 1.0, 1.0
        for carried in (record["contacts.pair_dv"], record["momentum.pair_last"], ahead.walls["dv"]):
            carried[:] = 0.0
        record["momentum.wall_last"][:] = 0.0
        name = {"pair": "gap_rate", "wall": "gap_rate_out", "inner wall": "gap_rate_in"}[most]
        (ahead.pairs if most == "pair" else ahead.walls)[name][place] = -3.0
        ahead.select()
        assert record["partial.zeta"][0] == 3.0
        assert ahead.chosen(walls=most != "pair") == [place]


@pytest.mark.parametrize("equal", [True, False], ids=["equal masses", "masses"])
def test_working_contacts_are_copies_that_are_put_back(equal: bool) -> None:
    ahead = Accelerated(equal)
    record = ahead.record
    ahead.select()
    k, at = ahead.chosen(walls=False), ahead.indices(walls=False)
    copies, pairs = record["working.pairs"][at], ahead.pairs[k]
    assert np.array_equal(copies["n"], pairs["n"])
    assert np.array_equal(copies["i"], 2 * pairs["i"])
    assert np.array_equal(copies["j"], 2 * pairs["j"])
    assert np.array_equal(record["working.gap_rate"][at], pairs["gap_rate"])
    assert np.array_equal(record["working.pair_dv"][at], record["contacts.pair_dv"][k])
    assert np.array_equal(record["working.pair_last"][at], record["momentum.pair_last"][k])
    if not equal:
        share = record["contacts.weights"][k]
        mu = share[:, 0] * record["grains.mass"][pairs["i"]]
        assert np.array_equal(record["working.weights"][at], np.column_stack([share, mu]))
    c, there = ahead.chosen(walls=True), ahead.indices(walls=True)
    assert np.array_equal(record["working.walls"][there], ahead.walls[c])
    assert np.array_equal(record["working.wall_last"][there], record["momentum.wall_last"][c])
    rng = np.random.default_rng(0)
    new = {name: rng.uniform(1.0, 2.0, PAIRS) for name in ("pair_dv", "pair_last", "dv", "wall_last")}
    record["working.pair_dv"][at], record["working.pair_last"][at] = new["pair_dv"][k], new["pair_last"][k]
    record["working.walls"]["dv"][there], record["working.wall_last"][there] = (
        new["dv"][c],
        new["wall_last"][c],
    )
    expected = [array.copy() for array in carried(record)]
    for array, name, which in zip(expected, new, (k, k, c, c), strict=True):
        array[which] = new[name][which]
    put_back = Each(part_count, working_set.put_back_pairs), Each(wall_part_count, working_set.put_back_walls)
    record.run(*put_back)
    assert all(map(np.array_equal, carried(record), expected))


def carried(record: OneRecord) -> list[FloatArray]:
    walls = record["contacts.walls"]["dv"]
    return [record["contacts.pair_dv"], record["momentum.pair_last"], walls, record["momentum.wall_last"]]


def test_rejected_sweep_is_taken_back() -> None:
    ahead = Accelerated()
    record = ahead.record
    ahead.select()
    at, there = ahead.indices(walls=False), ahead.indices(walls=True)
    others = np.setdiff1d(np.arange(PAIRS), at)
    before = record["working.pair_dv"][others].copy()
    record["momentum.last_velocity"][:] = np.arange(2 * N).reshape(N, 2)
    record.run(
        Each(part_count, restart.roll_back_pairs),
        Each(wall_part_count, restart.roll_back_walls),
        Each(grain_count, restart.roll_back_velocity),
    )
    assert np.array_equal(record["working.pair_dv"][at], record["working.pair_last"][at])
    assert np.array_equal(record["working.pair_dv"][others], before)
    assert np.array_equal(record["working.walls"]["dv"][there], record["working.wall_last"][there])
    assert np.array_equal(record["grains.next_velocity"], record["momentum.last_velocity"])


@pytest.mark.parametrize(
    ("limit", "peak", "expired"), [(5.125, 5.0, 0), (5.125, 5.0 + 2**-40, 1), (0.1, 0.0, 1)]
)
@pytest.mark.parametrize("kept", [True, False])
def test_skin_at_a_scan(limit: float, peak: float, expired: int, kept: bool) -> None:
    """p_i + h, with h = 1/8 of what is nearly violated, is what the skin must allow."""
    ahead = Accelerated()
    record, flags = ahead.record, ahead.record.record["verlet"]["flags"]
    for name in ("reference_velocity", "peak_deviation"):
        record[f"verlet.{name}"][:] = 0.0
    record["verlet.peak_limit"][:] = 1e3
    record["verlet.peak_limit"][7], flags["list_expired"] = limit, 0
    record["grains.next_velocity"][:] = 0.0
    record.verlet_numbers["frame_velocity"] = 0.0, 0.0
    if kept:
        record["verlet.peak_deviation"][7] = peak**2
    else:
        record["grains.next_velocity"][7, 1] = peak
    control = record.record["control"]
    control["iterating"], control["unfinished"] = 1, 0
    record.run(Each(grain_count, working_set.see_skin), Serial(working_set.pause_unless_listed))
    assert flags["list_expired"] == expired
    assert (control["iterating"], control["unfinished"]) == (1 - expired, expired)
    assert record["verlet.peak_deviation"][7] == peak**2


DONE = [
    # iterations, on_residual, rejected, violation, zeta after the scan, whether it goes on
    (0, 0, 0, 9.0, 0.03, 1),
    (4, 0, 0, 0.01, 0.03, 0),
    (4, 0, 0, 0.5, 0.5, 1),
    (4, 0, 0, TOLERANCE, TOLERANCE, 0),
    (4, 0, 1, 0.5, 0.03, 1),
    (4, 1, 0, 0.5, 0.03, 1),
    (40, 0, 0, 0.5, 0.5, 0),
]


@pytest.mark.parametrize(("iterations", "on_residual", "rejected", "violation", "zeta", "left"), DONE)
def test_last_scan(
    iterations: int, on_residual: int, rejected: int, violation: float, zeta: float, left: int
) -> None:
    """By zeta, what contacts outside the set are violated by is a change to come."""
    record = Accelerated().record
    whole, control = record.record, record.record["control"]
    whole["step"]["iterations"], whole["step"]["zeta"] = iterations, 0.03
    whole["stopping"]["on_residual"], control["rejected"] = on_residual, rejected
    whole["stopping"]["max_iterations"] = 40
    record["partial.zeta"][0], record["history.zeta"][:] = violation, 0.03
    record.run(Serial(working_set.see_whether_done))
    assert whole["step"]["zeta"] == zeta
    assert (control["unfinished"], control["iterating"]) == (left, left)
    assert record["history.zeta"][iterations - 1] == zeta
    assert record["partial.zeta"][0] == 0.0
