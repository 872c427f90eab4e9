"""The working set of the accelerated method, stage by stage.

Numbers are eighths, normals are along an axis and slides are sides of a right triangle: nothing is rounded,
and many contacts are exactly at a bound.
"""

import numpy as np
import pytest
from stages import OneRecord, grains_apart

from warpgrains.arrays import FloatArray, IntArray
from warpgrains.kernels import attempt, momentum, stopping, working_set
from warpgrains.kernels.contacts import chunk_count
from warpgrains.kernels.record import CANCELLED, SOLVED, Asking, Phase, grain_count
from warpgrains.kernels.stages import Each, Serial, Sets
from warpgrains.kernels.stopping import StopOn

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
NOW, LAST = "contacts.dv", "contacts.last_dv"


def eighths(rng: np.random.Generator, low: int, high: int, shape: object) -> FloatArray:
    return rng.integers(low, high, shape) / 8.0


class Accelerated:
    """A record of random contacts: three sets of pairs, and one of contacts with a wall."""

    def __init__(self, equal: bool = False, inner: bool = True, slides: bool = True):
        rng = np.random.default_rng(3)
        scene = grains_apart(N).replace(method="accelerated", stop="zeta", tolerance=TOLERANCE)
        if inner or slides:
            scene = scene.replace(wall="round")  # whose contacts with the wall have limits
        if not equal:
            scene = scene.replace(mass=rng.choice([0.5, 1.0, 2.0], N))
        self.record = record = OneRecord(scene, CONTACTS)
        record["grains.contact_mass"][:] = scene.mass
        record.records.keep_history(0, 40)
        self.contact = record["contacts.contact"][:CONTACTS]
        self.limits = record["contacts.limits"] if inner or slides else np.empty((N, 2))
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
        record["grains.next_velocity"][:] = eighths(rng, -8, 9, (N, 2))
        if slides:  # along = 3 of reach = 5: the circle leaves 1 less
            record["grains.next_velocity"][walls["i"] // 2] = (
                eighths(rng, -8, 9, N)[:, None] * walls["n"]
                + rng.choice([0.0, 3.0], N)[:, None] * walls["n"][:, ::-1]
            )
        which, sign = rng.integers(0, 12, CONTACTS), rng.choice([-1.0, 1.0], CONTACTS)
        for name, times in ((NOW, (0, 1)), (LAST, (1, 2))):
            carries = np.isin(which, times) * np.where(self.is_wall, sign, 1.0)
            record[name][:CONTACTS] = carries * eighths(rng, 1, 9, CONTACTS)
        record["contacts.set_start"][:5] = STARTS
        whole = record.record
        whole["contacts"]["count"] = PAIRS, 3, N
        whole["tuning"]["nearest"], whole["step"]["zeta"], whole["step"]["iterations"] = 0.125, 9.0, 1
        if not equal:
            record["contacts.weights"][:CONTACTS] = eighths(rng, 1, 8, (CONTACTS, 2))
        for name in ("range", "index"):
            record[f"working.{name}"][:] = -7
        record["partial.zeta"][:] = 0.0

    def select(self) -> IntArray:
        """Select; return where the working set is, each chunk from where its contacts begin."""
        self.record.run(Sets(working_set.select_set))
        places: list[int] = []
        for chunk, (begin, end) in CHUNKS.items():
            first, last = self.record["working.range"][chunk].tolist()
            assert first == begin
            assert last <= end
            places += range(first, last)
        return np.array(places, int)

    def selected(self) -> list[int]:
        return self.record["working.index"][self.select()].tolist()


NEAR = [(0, 9.0, 0.125, 0.0), (1, 9.0, 0.125, 0.125), (5, 1.0, 9.0, 0.25)]


@pytest.mark.parametrize(("iterations", "zeta", "nearest", "h"), NEAR)
@pytest.mark.parametrize("inner", [True, False])
@pytest.mark.parametrize("slides", [True, False])
def test_selection(iterations: int, zeta: float, nearest: float, h: float, inner: bool, slides: bool) -> None:
    """Contacts that carry, or did, or are violated but for h, 2 h where it is a pair, are swept."""
    ahead = Accelerated(inner=inner, slides=slides)
    record, whole, contact, is_wall = ahead.record, ahead.record.record, ahead.contact, ahead.is_wall
    whole["step"]["iterations"], whole["step"]["zeta"], whole["tuning"]["nearest"] = iterations, zeta, nearest
    contact["gap_rate"][[0, PAIRS]], record[NOW][[0, PAIRS]] = (-50.0, -40.0), 1.0  # swept anyway
    v, n = record["grains.next_velocity"], contact["n"]
    own, other = v[contact["i"] // 2], v[np.where(is_wall, 0, contact["j"] // 2)]
    vn = ((own - np.where(is_wall[:, None], 0.0, other)) * n).sum(axis=1)
    slide = is_wall & (np.abs((own * n[:, ::-1]).sum(axis=1)) == 3.0) & slides
    gap = contact["gap_rate"] - np.where(slide, 1.0, 0.0)
    back = np.append(np.full(PAIRS, np.inf), ahead.limits[:, 0])
    carries = (record[NOW][:CONTACTS] != 0.0) | (record[LAST][:CONTACTS] != 0.0)

    def pushed(near: FloatArray | float) -> FloatArray:
        return np.maximum(0.0, vn - gap + near) - np.maximum(0.0, near - vn - back)

    selected = carries | (pushed(np.where(is_wall, h, 2.0 * h)) != 0.0)
    assert ahead.selected() == np.flatnonzero(selected).tolist()
    for kind in (is_wall, ~is_wall):
        assert 0 < (selected & ~carries)[kind].sum() < (~carries)[kind].sum()
    assert record["partial.zeta"][0] == np.abs(pushed(0.0))[~carries].max()


@pytest.mark.parametrize("side", ["front", "back"])
def test_largest_violation_is_found_wherever_it_is(side: str) -> None:
    ahead = Accelerated(slides=False)
    for name in (NOW, LAST, "grains.next_velocity"):
        ahead.record[name][:] = 0.0
    for c in (0, 127, 129, 130, 200, 299, 300, 427, 428, 430, 449):
        ahead.contact["gap_rate"], ahead.limits[:, 0], ahead.record["partial.zeta"][0] = 1.0, 1.0, 0.0
        if side == "front":
            ahead.contact["gap_rate"][c] = -3.0
        elif c >= PAIRS:
            ahead.limits[c - PAIRS, 0] = -3.0
        found = side == "front" or c >= PAIRS
        assert ahead.selected() == ([c] if found else [])
        assert ahead.record["partial.zeta"][0] == (3.0 if found else 0.0)


@pytest.mark.parametrize("equal", [True, False], ids=["equal masses", "masses"])
def test_working_contacts_are_copies_that_are_put_back(equal: bool) -> None:
    ahead = Accelerated(equal)
    record, at = ahead.record, ahead.select()
    k = record["working.index"][at]
    for name in ("contact", "dv", "last_dv"):
        assert np.array_equal(record[f"working.contacts.{name}"][at], record[f"contacts.{name}"][k])
    wall = k >= PAIRS
    limits = record["working.contacts.limits"]
    assert np.array_equal(limits[at[wall] - PAIRS], ahead.limits[k[wall] - PAIRS])
    if not equal:
        share = record["contacts.weights"][k]
        mu = share[:, 0] * record["grains.contact_mass"][ahead.contact["i"][k] // 2]
        assert np.array_equal(record["working.contacts.weights"][at], share)
        assert np.array_equal(record["working.mass"][at], mu)
    rng, expected = np.random.default_rng(0), {}
    for name, all_contacts in (("working.contacts.dv", NOW), ("working.contacts.last_dv", LAST)):
        expected[all_contacts], new = record[all_contacts].copy(), rng.uniform(1.0, 2.0, len(k))
        expected[all_contacts][k] = record[name][at] = new
    record.run(Each(chunk_count, working_set.scatter))
    assert all(np.array_equal(record[name], array) for name, array in expected.items())


def test_rejected_sweep_is_taken_back() -> None:
    ahead = Accelerated()
    record, at = ahead.record, ahead.select()
    expected = record["working.contacts.dv"].copy()
    expected[at] = record["working.contacts.last_dv"][at]
    record["momentum.last_velocity"][:] = np.arange(2 * N).reshape(N, 2)
    record.run(Each(chunk_count, momentum.roll_back), Each(grain_count, momentum.roll_back_velocity))
    assert np.array_equal(record["working.contacts.dv"], expected)
    assert np.array_equal(record["grains.next_velocity"], record["momentum.last_velocity"])


@pytest.mark.parametrize(
    ("limit", "peak", "expired"), [(5.125, 5.0, 0), (5.125, 5.0 + 2**-40, 1), (0.1, 0.0, 1)]
)
@pytest.mark.parametrize("kept", [True, False])
def test_skin_at_a_scan(limit: float, peak: float, expired: int, kept: bool) -> None:
    """p_i + h, with h = 1/8 of what is nearly violated, is what the skin must allow."""
    ahead = Accelerated()
    record, flags = ahead.record, ahead.record.record["verlet"]["flags"]
    for name in ("reference_velocity", "peak_square"):
        record[f"verlet.{name}"][:] = 0.0
    record["verlet.peak_limit"][:] = 1e3
    record["verlet.peak_limit"][7], flags["list_expired"] = limit, 0
    record["grains.next_velocity"][:] = 0.0
    record.verlet_work["frame_velocity"] = 0.0, 0.0
    if kept:
        record["verlet.peak_square"][7] = peak**2
    else:
        record["grains.next_velocity"][7, 1] = peak
    control = record.record["control"]
    control["phase"], control["may_stop"] = Phase.CHECK_LIST, 0
    record.record["step"]["measured"] = record.record["step"]["iterations"]
    record.run(Each(grain_count, working_set.check_peak), Serial(stopping.end_list_check))
    assert flags["list_expired"] == expired
    assert (control["phase"], control["may_stop"]) == (Phase.VERIFY if expired else Phase.SCAN, 0)
    assert record["verlet.peak_square"][7] == peak**2


@pytest.mark.parametrize(
    ("cancelled", "measured", "outcome"), [(0, 4, SOLVED), (1, 4, SOLVED), (1, 3, CANCELLED)]
)
def test_a_canceled_step_is_taken_only_if_it_is_measured(cancelled: int, measured: int, outcome: int) -> None:
    """A cancellation during a scan ends the sweeps with the residual of another iteration."""
    record = Accelerated(inner=False, slides=False).record
    step, whole = record.record["step"], record.record
    step["iterations"], step["measured"], step["residual"] = 4, measured, 0.0
    whole["control"]["cancelled"], whole["stopping"]["on"] = cancelled, StopOn.RESIDUAL
    whole["verlet"]["flags"]["bad_body"] = -1
    whole["verlet"]["numbers"]["frame_skin"] = whole["verlet"]["numbers"]["lifetime"] = 1.0
    record.run(Serial(attempt.judge))
    assert step["outcome"] == outcome


DONE = [
    # iterations, stop, rejected, violation, zeta after the scan, whether it goes on
    (0, StopOn.ZETA, 0, 9.0, 0.03, 1),
    (4, StopOn.ZETA, 0, 0.01, 0.03, 0),
    (4, StopOn.ZETA, 0, 0.5, 0.5, 1),
    (4, StopOn.ZETA, 0, TOLERANCE, TOLERANCE, 0),
    (4, StopOn.ZETA, 1, 0.5, 0.03, 1),
    (4, StopOn.RESIDUAL, 0, 0.5, 0.03, 1),
    (40, StopOn.ZETA, 0, 0.5, 0.5, 0),
]


@pytest.mark.parametrize(("iterations", "on", "rejected", "violation", "zeta", "left"), DONE)
def test_last_scan(iterations: int, on: int, rejected: int, violation: float, zeta: float, left: int) -> None:
    """By zeta, what contacts outside the set are violated by is a change to come."""
    record = Accelerated().record
    whole, control = record.record, record.record["control"]
    whole["step"]["iterations"], whole["step"]["zeta"] = iterations, 0.03
    whole["stopping"]["on"], control["rejected"] = on, rejected
    whole["stopping"]["max_iterations"] = 40
    record["partial.zeta"][0], record["history.zeta"][:] = violation, 0.03
    record.run(Serial(working_set.end_scan))
    assert whole["step"]["zeta"] == zeta
    assert (control["phase"], control["may_stop"]) == (Phase.SWEEP if left else Phase.VERIFY, 1 - left)
    assert record["history.zeta"][iterations - 1] == zeta
    assert record["partial.zeta"][0] == 0.0


MEASURED = [
    # phase, iterations, rejected, whether the trend ends the sweeps
    (Phase.MEASURE, 100, 0, True),
    (Phase.RECORD, 100, 1, False),
    (Phase.MEASURE, 70, 0, False),
    (Phase.RECORD, 70, 0, False),
]


@pytest.mark.parametrize(("phase", "iterations", "rejected", "ends"), MEASURED)
def test_the_history_leaves_the_trend_of_the_residual_alone(
    phase: Phase, iterations: int, rejected: int, ends: bool
) -> None:
    """A plain step does not measure after a rejected sweep, so that nothing may follow from its residual."""
    record = Accelerated().record
    whole, step = record.record, record.record["step"]
    whole["stopping"]["on"], whole["stopping"]["max_iterations"] = StopOn.RESIDUAL, 1000
    whole["stopping"]["patience"], step["asking"] = 750, Asking.EARLY
    step["iterations"], whole["control"]["rejected"], whole["control"]["phase"] = iterations, rejected, phase
    step["trend_residual"], record["partial.residual"][0] = 1.0, 0.99
    record.run(Serial(stopping.end_measurement))
    assert (whole["control"]["phase"] == Phase.VERIFY) == ends
    assert step["trend_residual"] == (0.99 if ends else 1.0)
    assert step["residual"] == 0.99
