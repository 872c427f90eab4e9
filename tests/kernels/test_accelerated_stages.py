"""The working set of the accelerated method, stage by stage.

Numbers are eighths, normals are along an axis and slides are sides of a right triangle: nothing is rounded,
and many contacts are exactly at a bound.
"""

import numpy as np
import pytest
from stages import OneRecord, Values, grains_apart

from warpgrains.base.arrays import FloatArray, IntArray
from warpgrains.kernels.contacts import chunk_count
from warpgrains.kernels.record import HostRequest, Outcome, Phase, grain_count
from warpgrains.kernels.sweeps import attempt, momentum, stopping, working_set
from warpgrains.kernels.sweeps.stopping import StopOn
from warpgrains.kernels.team.stages import Each, Serial, Sets, Stage

N, PAIRS, STARTS = 150, 300, [0, 130, 131, 300, 450]
CONTACTS = PAIRS + N
CHUNKS = {  # first contact and end, by number: 128 contacts by index, apart by sets
    0: (0, 128),
    1: (128, 130),
    2: (130, 131),
    3: (131, 256),
    4: (256, 300),
    5: (300, 385),  # one more than the index says: of the same grain
    6: (385, 450),
}
TOLERANCE = 2.0**-4
NOW, LAST = "contacts.dv.now", "contacts.dv.last"
VELOCITY, VIOLATION, MAY_STOP = "grains.next_velocity", "partial.zeta", "control.may_stop"


def eighths(rng: np.random.Generator, low: int, high: int, shape: object) -> FloatArray:
    return rng.integers(low, high, shape) / 8.0


class Accelerated(OneRecord):
    """A record of random contacts: three sets of pairs, and one of contacts with a wall."""

    def __init__(self, equal: bool = False, inner: bool = True, slides: bool = True, **laws: float):
        rng = np.random.default_rng(3)
        scene = grains_apart(N).replace(method="accelerated", stop="zeta", tolerance=TOLERANCE, **laws)
        if inner or slides:
            scene = scene.replace(wall="round")  # whose contacts with the wall have limits
        if not equal:
            scene = scene.replace(mass=rng.choice([0.5, 1.0, 2.0], N))
        super().__init__(scene, CONTACTS)
        self.records.keep_history(0, 40)
        self.contact = self["contacts.contact"][:CONTACTS]
        self.limits = self["contacts.limits"] if inner or slides else np.empty((N, 2))
        self.is_wall = np.arange(CONTACTS) >= PAIRS
        pairs, walls = self.contact[:PAIRS], self.contact[PAIRS:]
        pairs["i"], pairs["j"] = 2 * np.sort(rng.permuted(np.tile(np.arange(N), (PAIRS, 1)), axis=1)[:, :2]).T
        walls["i"], walls["j"] = 2 * rng.permutation(N), 2 * N
        axes = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
        self.contact["n"] = axes[rng.integers(0, 4, CONTACTS)]
        for name in ("i", "n"):  # one grain at two walls, across the end of a chunk
            self.contact[name][384] = self.contact[name][383]
        pairs["gap_rate"], walls["gap_rate"] = eighths(rng, 0, 20, PAIRS), eighths(rng, 0, 12, N)
        self.limits[:, 0] = eighths(rng, 0, 12, N) if inner else np.inf
        self.limits[:, 1] = 5.0 if slides else np.inf
        v = eighths(rng, -8, 9, (N, 2))
        if slides:  # along = 3 of reach = 5: the circle leaves 1 less
            v[walls["i"] // 2] = (
                eighths(rng, -8, 9, N)[:, None] * walls["n"]
                + rng.choice([0.0, 3.0], N)[:, None] * walls["n"][:, ::-1]
            )
        which, sign = rng.integers(0, 12, CONTACTS), rng.choice([-1.0, 1.0], CONTACTS)
        for name, times in ((NOW, (0, 1)), (LAST, (1, 2))):
            carries = np.isin(which, times) * np.where(self.is_wall, sign, 1.0)
            self[name][:CONTACTS] = carries * eighths(rng, 1, 9, CONTACTS)
        self["contacts.set_start"][:5] = STARTS
        self.write({"grains.contact_mass": scene.mass, VELOCITY: v, "contacts.count": (PAIRS, 3, N)})
        self.write({"tuning.nearest": 0.125, "step.zeta": 9.0, "step.iterations": 1})
        self.write({"working.range": -7, "working.index": -7, VIOLATION: 0.0})
        if not equal:
            self["contacts.weights"][:CONTACTS] = eighths(rng, 1, 8, (CONTACTS, 2))

    def select(self) -> IntArray:
        """Select; return where the working set is, each chunk from where its contacts begin."""
        self.run(Sets(working_set.select_set))
        places: list[int] = []
        for chunk, (begin, end) in CHUNKS.items():
            first, last = self["working.range"][chunk].tolist()
            assert first == begin
            assert last <= end
            places += range(first, last)
        return np.array(places, int)

    def selected(self) -> list[int]:
        return self["working.index"][self.select()].tolist()


NEAR = [(0, 9.0, 0.125, 0.0), (1, 9.0, 0.125, 0.125), (5, 1.0, 9.0, 0.25)]


@pytest.mark.parametrize(("iterations", "zeta", "nearest", "h"), NEAR)
@pytest.mark.parametrize("inner", [True, False])
@pytest.mark.parametrize("slides", [True, False])
def test_selection(iterations: int, zeta: float, nearest: float, h: float, inner: bool, slides: bool) -> None:
    """Contacts that carry, or did, or are violated but for h, 2 h where it is a pair, are swept."""
    record = Accelerated(inner=inner, slides=slides)
    contact, is_wall, v = record.contact, record.is_wall, record[VELOCITY]
    record.write({"step.iterations": iterations, "step.zeta": zeta, "tuning.nearest": nearest})
    contact["gap_rate"][[0, PAIRS]], record[NOW][[0, PAIRS]] = (-50.0, -40.0), 1.0  # swept anyway
    n = contact["n"]
    own, other = v[contact["i"] // 2], v[np.where(is_wall, 0, contact["j"] // 2)]
    vn = ((own - np.where(is_wall[:, None], 0.0, other)) * n).sum(axis=1)
    slide = is_wall & (np.abs((own * n[:, ::-1]).sum(axis=1)) == 3.0) & slides
    gap = contact["gap_rate"] - np.where(slide, 1.0, 0.0)
    back = np.append(np.full(PAIRS, np.inf), record.limits[:, 0])
    carries = (record[NOW][:CONTACTS] != 0.0) | (record[LAST][:CONTACTS] != 0.0)

    def pushed(near: FloatArray | float) -> FloatArray:
        return np.maximum(0.0, vn - gap + near) - np.maximum(0.0, near - vn - back)

    selected = carries | (pushed(np.where(is_wall, h, 2.0 * h)) != 0.0)
    assert record.selected() == np.flatnonzero(selected).tolist()
    for kind in (is_wall, ~is_wall):
        assert 0 < (selected & ~carries)[kind].sum() < (~carries)[kind].sum()
    assert record[VIOLATION][0] == np.abs(pushed(0.0))[~carries].max()


@pytest.mark.parametrize("side", ["front", "back"])
def test_largest_violation_is_found_wherever_it_is(side: str) -> None:
    record = Accelerated(slides=False)
    record.write({NOW: 0.0, LAST: 0.0, VELOCITY: 0.0})
    for c in (0, 127, 129, 130, 200, 299, 300, 427, 428, 430, 449):
        record.contact["gap_rate"], record.limits[:, 0], record[VIOLATION][0] = 1.0, 1.0, 0.0
        if side == "front":
            record.contact["gap_rate"][c] = -3.0
        elif c >= PAIRS:
            record.limits[c - PAIRS, 0] = -3.0
        found = side == "front" or c >= PAIRS
        assert record.selected() == ([c] if found else [])
        assert record[VIOLATION][0] == (3.0 if found else 0.0)


@pytest.mark.parametrize(
    ("equal", "laws", "kept"),
    [
        (True, {}, ["dv"]),
        (False, {}, ["dv"]),
        (False, {"friction": 0.5, "rolling_friction": 0.2}, ["dv", "dvt", "dvr"]),
    ],
    ids=["equal masses", "masses", "rolling"],
)
def test_working_contacts_are_copies_that_are_put_back(
    equal: bool, laws: dict[str, float], kept: list[str]
) -> None:
    record = Accelerated(equal, **laws)
    for times, name in enumerate(kept, start=1):
        record[f"contacts.{name}.now"][:] = times * record[NOW]
        record[f"contacts.{name}.last"][:] = times * record[LAST]
    kept = [f"{name}.{moment}" for name in kept for moment in ("now", "last")]
    at = record.select()
    k = record["working.index"][at]
    for name in ("contact", *kept):
        assert np.array_equal(record[f"working.contacts.{name}"][at], record[f"contacts.{name}"][k])
    wall, limits = k >= PAIRS, record["working.contacts.limits"]
    assert np.array_equal(limits[at[wall] - PAIRS], record.limits[k[wall] - PAIRS])
    if not equal:
        share = record["contacts.weights"][k]
        mu = share[:, 0] * record["grains.contact_mass"][record.contact["i"][k] // 2]
        assert np.array_equal(record["working.contacts.weights"][at], share)
        assert np.array_equal(record["working.mass"][at], mu)
    expected = {name: record[name].copy() for name in (f"contacts.{own}" for own in kept)}
    for seed, (name, array) in enumerate(expected.items()):
        array[k] = record[f"working.{name}"][at] = np.random.default_rng(seed).uniform(1.0, 2.0, len(k))
    record.run(Each(chunk_count, working_set.scatter))
    record.assert_holds(expected)


def test_rejected_sweep_is_taken_back() -> None:
    record, last = Accelerated(), np.arange(2.0 * N).reshape(N, 2)
    at = record.select()
    expected = record["working.contacts.dv.now"].copy()
    expected[at] = record["working.contacts.dv.last"][at]
    record["momentum.last_velocity"][:] = last
    record.run(Each(chunk_count, momentum.roll_back), Each(grain_count, momentum.roll_back_velocity))
    record.assert_holds({"working.contacts.dv.now": expected, VELOCITY: last})


def of_one(value: float, other: float, count: int = N, one: int = 7) -> FloatArray:
    return np.where(np.arange(count) == one, value, other)


EXPIRES, PHASE, HISTORY, PEAK = (
    "verlet.list_expired",
    "control.phase",
    "zeta_history",
    "verlet.peak_square",
)
LOOK: list[Stage] = [Each(grain_count, working_set.check_peak), Serial(stopping.end_list_check)]
JUDGE, END_SCAN, MEASURED = (
    [Serial(stage)] for stage in (attempt.judge, working_set.end_scan, stopping.end_measurement)
)
CASES: dict[str, tuple[list[Stage], Values, Values]] = {}
AT_REST = {"verlet.reference_velocity": 0.0, "verlet.frame_velocity": 0.0, PHASE: Phase.SCAN}
AT_REST |= {EXPIRES: 0, MAY_STOP: 0, "step.measured": 1}
# p_i + h, with h = 1/8 of what is nearly violated, is what the skin must allow; p_i was seen, or is now
for limit, peak, expired in ((5.125, 5.0, 0), (5.125, 5.0 + 2**-40, 1), (0.1, 0.0, 1)):
    for seen, now in ((peak, 0.0), (0.0, peak)):
        velocity = np.stack([np.zeros(N), of_one(now, 0.0)], axis=1)
        peaks = {PEAK: of_one(seen**2, 0.0), "verlet.peak_limit": of_one(limit, 1e3), VELOCITY: velocity}
        found = {EXPIRES: expired, MAY_STOP: 0, PHASE: Phase.VERIFY if expired else Phase.SCAN}
        found[PEAK] = of_one(peak**2, 0.0)
        CASES[f"a skin for {limit}, {seen} seen, {now} now"] = (LOOK, AT_REST | peaks, found)
MET = {
    "step.residual": 0.0,
    "step.iterations": 4,
    "stopping.on": StopOn.RESIDUAL,
    "verlet.bad_body": -1,
}
MET |= {"verlet.frame_skin": 1.0, "verlet.lifetime": 1.0}
# a cancellation during a scan ends the sweeps with the residual of another iteration
for cancelled, measured, outcome in ((0, 4, Outcome.SOLVED), (1, 4, Outcome.SOLVED), (1, 3, Outcome.STOPPED)):
    canceled = {"control.cancelled": cancelled, "step.measured": measured}
    CASES[f"canceled {cancelled}, measured {measured}"] = (JUDGE, MET | canceled, {"step.outcome": outcome})
# threads find grains that are no longer finite in any order
lost = np.where(np.isin(np.arange(N), (2, 7)), np.inf, 0.0)[:, np.newaxis]
found = {"verlet.bad_body": 7, "step.outcome": Outcome.NOT_FINITE}
CASES["the last that is not finite"] = (
    JUDGE,
    MET | {"verlet.bad_body": 2, EXPIRES: 1, VELOCITY: lost},
    found,
)
# by zeta, what contacts outside the set are violated by is a change to come
for iterations, on, rejected, violation, zeta, left in (
    (0, StopOn.ZETA, 0, 9.0, 0.03, 1),
    (4, StopOn.ZETA, 0, 0.01, 0.03, 0),
    (4, StopOn.ZETA, 0, 0.5, 0.5, 1),
    (4, StopOn.ZETA, 0, TOLERANCE, TOLERANCE, 0),
    (4, StopOn.ZETA, 1, 0.5, 0.03, 1),
    (4, StopOn.RESIDUAL, 0, 0.5, 0.03, 1),
    (40, StopOn.ZETA, 0, 0.5, 0.5, 0),
):
    swept = {"step.iterations": iterations, "step.zeta": 0.03, HISTORY: 0.03, VIOLATION: violation}
    swept |= {"stopping.on": on, "stopping.max_iterations": 40, "control.rejected": rejected}
    found = {"step.zeta": zeta, PHASE: Phase.SWEEP if left else Phase.VERIFY, MAY_STOP: 1 - left}
    found |= {HISTORY: of_one(zeta, 0.03, 40, iterations - 1), VIOLATION: 0.0}
    CASES[f"scanned after {iterations}, {on}, {rejected}, {violation}"] = (END_SCAN, swept, found)
# a plain step does not measure after a rejected sweep, so that nothing may follow from its residual
for iterations, rejected, following in ((100, 0, Phase.VERIFY), (100, 1, Phase.SCAN), (70, 0, Phase.SCAN)):
    slow = {"stopping.on": StopOn.RESIDUAL, "stopping.max_iterations": 1000, "stopping.patience": 750}
    slow |= {"step.host_request": HostRequest.EARLY, "step.trend_residual": 1.0, "partial.residual": 0.99}
    slow |= {PHASE: Phase.SCAN, "step.iterations": iterations, "control.rejected": rejected}
    trend = 0.99 if following == Phase.VERIFY else 1.0
    found = {PHASE: following, "step.trend_residual": trend, "step.residual": 0.99}
    CASES[f"the trend after {iterations}, {rejected}"] = (MEASURED, slow, found)


@pytest.mark.parametrize("case", CASES)
def test_end_of_a_stage(case: str) -> None:
    stages, given, found = CASES[case]
    record = Accelerated(inner=False, slides=False)
    record.write(given)
    record.run(*stages)
    record.assert_holds(found)
