"""The check of a list (11), and monitoring, stage by stage: at each bound, and just beyond it.

All numbers are short sums of powers of two and sides of right triangles: no stage rounds them, and a bound is
met exactly. Every term is far larger than the step beyond the bound, so that none of them can be left out.
"""

import numpy as np
import pytest
import warp as wp
from stages import OneRecord, Values, grains_apart

from warpgrains.kernels.record import Scene, grain_count
from warpgrains.kernels.search import skins, verlet
from warpgrains.kernels.team.stages import Each, If, Serial, Stage

DT, ROUNDING = 0.25, 2.0**-10
BASE_SKIN, RESERVE = 2.0, 2.0**-3
W, X0, U_PATH, U = np.array([[4.0, -8.0], [1.0, 2.0], [0.5, 0.25], [1.0, 0.5]])
ELAPSED = 0.5
POSITION = X0 + ELAPSED * W + U_PATH + np.array([3.0, 4.0]) / 8.0
VELOCITY = W + U + np.array([3.0, 4.0])
DISPLACEMENT, DEVIATION = 0.625, 5.0  # of (3, 4) / 8 m and (3, 4) m/s
UNMONITORED = 1.0
PEAK, SEEN, SKIN = "verlet.peak_square", "verlet.recent_deviation", "verlet.skin"
FRAME, CHANGES = "verlet.frame_velocity", "verlet.unmonitored_change"
SHIFT, TIME, LIFETIME = "verlet.frame_shift", "verlet.elapsed", "verlet.lifetime"
EXPIRES, BAD, VALID = "verlet.list_expired", "verlet.bad_body", "step.outcome"
TWO_GRAINS: Values = {
    "grains.position": POSITION,
    "grains.next_velocity": VELOCITY,
    "verlet.reference_position": X0,
    "verlet.reference_velocity": W,
    "verlet.peak_limit": 0.0,
    "verlet.base_skin": BASE_SKIN,
    "verlet.frame_skin": 1e3,
    "tuning.rounding": ROUNDING,
    "tuning.reserve": RESERVE,
    **{PEAK: 0.0, SEEN: 0.0, SKIN: 1e3, EXPIRES: 0, BAD: -1},
    **{FRAME: U, CHANGES: UNMONITORED, SHIFT: U_PATH, TIME: ELAPSED, LIFETIME: 1e3},
}
"""On their way, with more skin than they ever need."""


@wp.func
def check_all(s: Scene):
    verlet.check_all(s, s.tuning.rounding)


@wp.func
def find_validity(s: Scene):
    s.step.outcome = 1 if verlet.is_list_valid(s) else 0


VERIFY, BEGIN = Each(grain_count, verlet.verify), Each(grain_count, verlet.begin_check)
CHECK, IS_VALID = Serial(check_all), Serial(find_validity)
CLEAR, FIND, SHIFTED = Serial(verlet.clear_check), Serial(verlet.find_frame), Serial(verlet.shift_frame)
SAMPLE, REMEMBER = Each(grain_count, verlet.sample), Each(grain_count, verlet.remember)
ADD, SAMPLED = Serial(verlet.add_unmonitored), If(verlet.is_sampling_due, [Serial(verlet.end_sampling)])
RENEW, AGAIN = Each(grain_count, skins.renew_skin), Serial(skins.renew_numbers)
WIDEN, START = Each(grain_count, skins.widen_for_start), Each(grain_count, verlet.monitor_start)


def assert_after(stages: list[Stage], given: Values, found: Values, method: str = "gauss-seidel") -> None:
    """Run stages for two grains, some of whose values are given, and hold what they write."""
    record = OneRecord(grains_apart(2).replace(dt=DT, method=method), contacts=4)
    record.write(TWO_GRAINS | given)
    record.run(*stages)
    record.assert_holds(found)


def of_one(grain: int, value: float, other: float) -> list[float]:
    return [value if k == grain else other for k in range(2)]


BEFORE = ROUNDING + RESERVE * BASE_SKIN
SKINS = {
    "the peak of the iteration": (VERIFY, 0, 6.0, 100.0, 6.0, ROUNDING),
    "the same, for sweeps that resumed": (VERIFY, 1, 6.0, 100.0, 6.0, ROUNDING),
    "the velocity now": (BEGIN, 0, 100.0, 0.0, DEVIATION, BEFORE),
    "the last step's peak": (BEGIN, 0, 0.0, 16.0, 16.0 - UNMONITORED, BEFORE),
    "a peak before the list": (BEGIN, 1, 7.0, 100.0, 7.0, BEFORE),
    "a peak that is surpassed": (BEGIN, 1, 2.0, 100.0, DEVIATION, BEFORE),
}


@pytest.mark.parametrize("grain", [0, 1])
@pytest.mark.parametrize("case", SKINS)
def test_skin(case: str, grain: int) -> None:
    """s_i + dt p_i <= skin_i, with room for rounding, and for a reserve before the iteration."""
    stage, resuming, seen, last, peak, spare = SKINS[case]
    enough = DISPLACEMENT + DT * (peak + UNMONITORED) + spare
    for skin, expired in ((enough, 0), (np.nextafter(enough, 0.0), 1), (np.nan, 1)):
        given = {PEAK: of_one(grain, seen**2, 0.0), SEEN: of_one(grain, last, 0.0)}
        given |= {SKIN: of_one(grain, skin, 1e3), "control.resuming": resuming}
        assert_after([stage], given, {EXPIRES: expired, BAD: -1})


@pytest.mark.parametrize("grain", [0, 1])
def test_the_velocity_before_the_step_counts_in_the_proof(grain: int) -> None:
    """A peak of 10 m/s, twice that of the velocity now, and what a skin allows of it."""
    before = W + U + np.array([[6.0, 8.0], [0.0, 0.0]])[[grain, 1 - grain]]
    for limit, expired in ((10.0, 0), (np.nextafter(10.0, 0.0), 1)):
        given = {"grains.velocity": before, "verlet.peak_limit": limit}
        assert_after([START], given, {PEAK: of_one(grain, 100.0, 0.0), EXPIRES: expired})


@pytest.mark.parametrize("name", ["grains.position", "grains.next_velocity"])
@pytest.mark.parametrize("grain", [0, 1])
def test_grain_that_is_no_longer_finite_is_named(name: str, grain: int) -> None:
    """It is refused, and not solved again with another list."""
    bad = TWO_GRAINS[name] + np.array([[0.0, np.inf], [0.0, 0.0]])[[grain, 1 - grain]]
    assert_after([VERIFY, CHECK], {name: bad}, {BAD: grain})
    assert_after([IS_VALID], {EXPIRES: 0, BAD: grain}, {VALID: 0})


COMING = {"grains.next_velocity": W + np.array([[2.0, 8.0], [4.0, -4.0]]), FRAME: np.nan}
STARTED = {"grains.velocity": W + np.array([3.0, 4.0]), SKIN: (2.5, 9.0)}
FAST = {"verlet.reference_velocity": [[1e6, 0.0], [-1e6, 0.0]]}
ON = {SHIFT: (0.5 + DT * 3.0, 0.25 + DT * 2.0), TIME: ELAPSED + DT}
CASES: dict[str, tuple[list[Stage], Values, Values]] = {
    "what a skin still allows": ([BEGIN], {SKIN: 2.625}, {"verlet.peak_limit": 8.0}),
    "a skin that is used up": ([BEGIN], {SKIN: 0.625}, {"verlet.peak_limit": 0.0}),
    "a skin that was too narrow": ([BEGIN], {SKIN: 0.5}, {"verlet.peak_limit": 0.0}),
    "the check is cleared": ([CLEAR], {EXPIRES: 1, BAD: 1}, {EXPIRES: 0, BAD: -1, CHANGES: 0.0}),
    "the frame is the mean": ([FIND], COMING | {"control.resuming": 0}, {FRAME: (3.0, 2.0)}),
    "references have the frame": ([FIND], COMING | {"control.resuming": 1}, {FRAME: 0.0}),
    "the frame moves on": ([SHIFTED], {FRAME: (3.0, 2.0)}, ON),
    "a step leaves its peaks": (
        [REMEMBER],
        {PEAK: (4.0, 9.0)},
        {SEEN: (2.0 + UNMONITORED, 3.0 + UNMONITORED)},
    ),
    "a new skin covers the velocity before": ([WIDEN], STARTED, {SKIN: (2.0 + 1.2 * 0.25 * 5.0, 9.0)}),
    "a list of fast grains serves a step": ([AGAIN], FAST, {LIFETIME: DT}),
}
for seen, peak in ((0.0, 6.5), (6.0, 6.5), (7.0, 7.0)):  # the velocity now, and what was not monitored
    CASES[f"sample after {seen}"] = ([SAMPLE], {CHANGES: 1.5, PEAK: seen**2}, {PEAK: peak**2})
ROW_SUM, MOST = 3.0, 2.0  # a sweep adds max_row_sum zeta, or what is monitored, if that is less
for zeta, change in ((0.25, 1.75), (1.0 / 3.0, 2.0), (0.5, 2.5), (MOST / ROW_SUM, 3.0), (9.0, 3.0)):
    swept = {
        "verlet.max_row_sum": ROW_SUM,
        "tuning.monitor_threshold": MOST / BASE_SKIN,
        "step.zeta": zeta,
    }
    CASES[f"not monitored, {zeta}"] = ([ADD], swept, {CHANGES: change})
    CASES[f"sampled beyond most, {zeta}"] = (
        [ADD, SAMPLED],
        swept,
        {CHANGES: change if change <= MOST else 0.0},
    )
FRAME_SKIN = 5.0 + DT * 8.0 + ROUNDING  # |U| + dt |u| <= frame skin
for skin, valid in ((FRAME_SKIN, 1), (np.nextafter(FRAME_SKIN, 0.0), 0), (np.nan, 0)):
    falling = {SHIFT: (3.0, -4.0), FRAME: (0.0, 8.0), "verlet.frame_skin": skin}
    CASES[f"frame skin {skin}"] = ([CHECK, IS_VALID], falling, {VALID: valid})
for steps in (0, 1, 7):  # of a list for one step more, whatever rounding makes of their sum
    for lifetime, valid in (
        (steps + 1, 1),
        ((steps + 1) * (1.0 - 0.9e-13), 1),
        ((steps + 1) * (1.0 - 1.1e-13), 0),
        (steps, 0),
    ):
        times = {TIME: steps * DT, LIFETIME: lifetime * DT}
        CASES[f"{steps} steps of {lifetime}"] = ([CHECK, IS_VALID], times, {VALID: valid})


@pytest.mark.parametrize("case", CASES)
def test_stage(case: str) -> None:
    assert_after(*CASES[case])


NEW = {  # iterations before, the margin of the skin, the deviations it covers, and the reference velocity
    "step begins": (0, skins.FORESEEN, [0.5, 0.5], VELOCITY),
    "begins again": (1, skins.FOUND_OUT, [2.0 + UNMONITORED, 3.0 + UNMONITORED], W + U),
    "resumes": (1, skins.STILL_TO_COME, [2.0 + UNMONITORED, 3.0 + UNMONITORED], VELOCITY),
}


@pytest.mark.parametrize("how", NEW)
def test_new_list_begins_now(how: str) -> None:
    """Its v0_i are the present velocities, or the old ones with v_f where plain sweeps begin again."""
    iterations, margin, needed, velocity = NEW[how]
    given = {"step.iterations": iterations, PEAK: (4.0, 9.0), SEEN: 0.5}
    found = {"verlet.reference_velocity": velocity, "verlet.reference_position": POSITION}
    found |= {SKIN: BASE_SKIN + float(margin) * DT * np.array(needed), SHIFT: 0.0, TIME: 0.0}
    assert_after([RENEW, AGAIN], given, found, "accelerated" if how == "resumes" else "gauss-seidel")
