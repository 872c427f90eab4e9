"""The check of a list, stage by stage, at each bound of (11) and (11b) and just beyond it.

All numbers are short sums of powers of two and sides of right triangles: no stage rounds them, and a bound is met
exactly. Every term is far larger than the step beyond the bound, so that none of them can be left out.
"""

from typing import Any

import numpy as np
import pytest
import warp as wp
from stages import OneRecord, grains_apart

from warpgrains.kernels import contact_list, neighbors, skins, verlet
from warpgrains.kernels.record import EXPIRED, NOT_FINITE, SOLVED, Scene, grain_count
from warpgrains.kernels.stages import Each, Serial, Stage

DT, ROUNDING = 0.25, 2.0**-10
BASE_SKIN, RESERVE = 2.0, 2.0**-3
W, X0, U_PATH, U = np.array([4.0, -8.0]), np.array([1.0, 2.0]), np.array([0.5, 0.25]), np.array([1.0, 0.5])
ELAPSED = 0.5
STRAIGHT = X0 + ELAPSED * W + U_PATH
DISPLACEMENT, DEVIATION = 0.625, 5.0  # of (3, 4) / 8 m and (3, 4) m/s
UNMONITORED = 1.0


@wp.func
def check_all(s: Scene):
    verlet.check_all(s, s.tuning.rounding)


@wp.func
def find_outcome(s: Scene):
    s.step.outcome = verlet.outcome_of_check(s)


def record_with(accelerated: bool = False, **numbers: Any) -> OneRecord:
    """Return two grains on their way, the second with more skin than it ever needs."""
    method = "accelerated" if accelerated else "gauss-seidel"
    record = OneRecord(grains_apart(2).replace(dt=DT, method=method), pairs=4)
    record["verlet.reference_velocity"][:], record["verlet.reference_position"][:] = W, X0
    record["grains.position"][:] = STRAIGHT + np.array([3.0, 4.0]) / 8.0
    record["grains.next_velocity"][:] = W + U + np.array([3.0, 4.0])
    for name in ("peak_deviation", "recent_deviation", "peak_limit"):
        record[f"verlet.{name}"][:] = 0.0
    record["verlet.skin"][:] = 1e3
    record.record["tuning"]["rounding"], record.record["tuning"]["reserve"] = ROUNDING, RESERVE
    known = {
        "elapsed": ELAPSED,
        "frame_shift": U_PATH,
        "frame_velocity": U,
        "unmonitored_change": UNMONITORED,
        "base_skin": BASE_SKIN,
        "frame_skin": 1e3,
        "lifetime": 1e3,
    }
    for name, value in (known | numbers).items():
        record.verlet_numbers[name] = value
    set_flags(record, list_expired=0, missed=0, bad_grain=-1)
    return record


def set_flags(record: OneRecord, **flags: int) -> None:
    for name, value in flags.items():
        record.record["verlet"]["flags"][name] = value


def flag(record: OneRecord, name: str) -> int:
    return int(record.record["verlet"]["flags"][name])


EACH: dict[str, Stage] = {
    "verify": Each(grain_count, verlet.verify),
    "begin_check": Each(grain_count, verlet.begin_check),
}
BEFORE = ROUNDING + RESERVE * BASE_SKIN
CHECKS = {
    "the peak of the iteration": ("verify", 0, 6.0, 100.0, 6.0, ROUNDING),
    "the same, for an attempt that went on": ("verify", 1, 6.0, 100.0, 6.0, ROUNDING),
    "the velocity now": ("begin_check", 0, 100.0, 0.0, DEVIATION, BEFORE),
    "the last step's peak": ("begin_check", 0, 0.0, 16.0, 16.0 - UNMONITORED, BEFORE),
    "a peak before the list": ("begin_check", 1, 7.0, 100.0, 7.0, BEFORE),
    "a peak that is surpassed": ("begin_check", 1, 2.0, 100.0, DEVIATION, BEFORE),
}


@pytest.mark.parametrize("grain", [0, 1])
@pytest.mark.parametrize("case", CHECKS)
def test_skin(case: str, grain: int) -> None:
    """s_i + dt p_i <= skin_i, with room for rounding, and for a reserve before the iteration."""
    stage, resuming, seen, last, peak, spare = CHECKS[case]
    enough = DISPLACEMENT + DT * (peak + UNMONITORED) + spare
    for skin, expired in ((enough, 0), (np.nextafter(enough, 0.0), 1), (np.nan, 1)):
        record = record_with()
        record.record["control"]["resuming"] = resuming
        record["verlet.peak_deviation"][grain], record["verlet.recent_deviation"][grain] = seen**2, last
        record["verlet.skin"][grain] = skin
        record.run(EACH[stage])
        assert flag(record, "list_expired") == expired
        assert flag(record, "bad_grain") == -1


@pytest.mark.parametrize(("skin", "limit"), [(2.625, 8.0), (0.625, 0.0), (0.5, 0.0)])
def test_what_a_skin_still_allows(skin: float, limit: float) -> None:
    record = record_with()
    record["verlet.skin"][:] = skin
    record.run(EACH["begin_check"])
    assert record["verlet.peak_limit"].tolist() == [limit, limit]


@pytest.mark.parametrize("name", ["position", "next_velocity"])
@pytest.mark.parametrize("grain", [0, 1])
def test_grain_that_is_no_longer_finite_is_named(name: str, grain: int) -> None:
    record = record_with()
    record[f"grains.{name}"][grain, 1] = np.inf
    record.run(EACH["verify"], Serial(check_all), Serial(find_outcome))
    assert flag(record, "bad_grain") == grain
    set_flags(record, list_expired=1)  # what is not finite is refused, not solved again with another list
    record.run(Serial(find_outcome))
    assert record.record["step"]["outcome"] == NOT_FINITE


def test_frame_skin() -> None:
    """|U| + dt |u| <= frame skin."""
    enough = 5.0 + DT * 8.0 + ROUNDING
    for skin, outcome in ((enough, SOLVED), (np.nextafter(enough, 0.0), EXPIRED), (np.nan, EXPIRED)):
        record = record_with(frame_shift=(3.0, -4.0), frame_velocity=(0.0, 8.0), frame_skin=skin)
        record.run(Serial(check_all), Serial(find_outcome))
        assert record.record["step"]["outcome"] == outcome


@pytest.mark.parametrize("steps", [0, 1, 7])
def test_lifetime(steps: int) -> None:
    """A list of k steps serves k steps, whatever rounding makes of their sum, and no step more."""
    for lifetime, expired in ((steps + 1, 0), (steps + 0.5, 0), (np.nextafter(steps + 0.5, 0), 1), (steps, 1)):
        record = record_with(elapsed=steps * DT, lifetime=lifetime * DT)
        record.run(Serial(check_all))
        assert flag(record, "list_expired") == expired


def test_check_is_cleared() -> None:
    record = record_with()
    set_flags(record, list_expired=1, bad_grain=1)
    record.run(Serial(verlet.clear_check))
    assert (flag(record, "list_expired"), flag(record, "bad_grain")) == (0, -1)
    assert record.verlet_numbers["unmonitored_change"] == 0.0


def test_frame_is_the_mean_and_moves_on() -> None:
    record = record_with(frame_velocity=(np.nan, np.nan))
    record["grains.next_velocity"][:] = W + [[2.0, 8.0], [4.0, -4.0]]
    for resuming, u in ((0, [3.0, 2.0]), (1, [0.0, 0.0])):
        record.record["control"]["resuming"] = resuming
        record.run(Serial(verlet.find_frame))
        assert record.verlet_numbers["frame_velocity"].tolist() == u
    record.verlet_numbers["frame_velocity"] = 3.0, 2.0
    record.run(Serial(verlet.shift_frame))
    assert record.verlet_numbers["frame_shift"].tolist() == [0.5 + DT * 3.0, 0.25 + DT * 2.0]
    assert record.verlet_numbers["elapsed"] == ELAPSED + DT


@pytest.mark.parametrize(("seen", "peak"), [(0.0, 6.5), (6.0, 6.5), (7.0, 7.0)])
def test_sample(seen: float, peak: float) -> None:
    """A grain may have been further from its velocity now by what was not monitored."""
    record = record_with(sampled_change=1.5)
    record["verlet.peak_deviation"][:] = seen**2
    record.run(Each(grain_count, verlet.sample))
    assert record["verlet.peak_deviation"].tolist() == [peak**2, peak**2]


MOST, ROW_SUM = 2.0, 3.0


@pytest.mark.parametrize(
    ("zeta", "change", "sampling"),
    [(0.25, 1.75, 0), (1.0 / 3.0, 2.0, 0), (0.5, 2.5, 1), (MOST / ROW_SUM, 3.0, 1), (9.0, 3.0, 1)],
)
def test_changes_that_are_not_monitored_add_up(zeta: float, change: float, sampling: int) -> None:
    """A sweep adds max_row_sum zeta, or max_row_sum d = MOST if that is less; they are sampled beyond MOST."""
    record = record_with(max_row_sum=ROW_SUM, sampled_change=np.nan)
    record.record["tuning"]["monitor_threshold"] = MOST / BASE_SKIN
    record.record["step"]["zeta"] = zeta
    record.record["control"]["sampling"] = 1 - sampling
    record.run(Serial(verlet.add_unmonitored))
    assert record.record["control"]["sampling"] == sampling
    assert record.verlet_numbers["unmonitored_change"] == (0.0 if sampling else change)
    if sampling:
        assert record.verlet_numbers["sampled_change"] == change


def test_step_leaves_its_peaks_for_the_next_list() -> None:
    record = record_with()
    record["verlet.peak_deviation"][:] = 4.0, 9.0
    record.run(Each(grain_count, verlet.remember))
    assert record["verlet.recent_deviation"].tolist() == [2.0 + UNMONITORED, 3.0 + UNMONITORED]


def amid_sweeps(position: list[list[float]]) -> OneRecord:
    """Two grains of peaks 3 and 5 m/s that a list has newly, in an attempt that goes on."""
    record = record_with()
    record.record["control"]["resuming"] = 1
    record["grains.position"][:], record["grains.radius"][:] = position, (1.0, 2.0)
    record["verlet.peak_deviation"][:] = (3.0 - UNMONITORED) ** 2, (5.0 - UNMONITORED) ** 2
    record["verlet.reference_velocity"][:] = [[2.0, 7.0], [-1.0, 9.0]]
    record["neighbors.start"][:], record["neighbors.neighbor"][0] = (0, 1, 1), 1
    record["workspace.sweep_index"][0], record["workspace.old_place"][0] = 0, -1
    record["workspace.old_wall_dv"][:], record["workspace.was_at_wall"][:] = 0.0, 0
    return record


TRANSFER = Each(grain_count, contact_list.transfer_warm_start)


@pytest.mark.parametrize("reverse", [False, True])
def test_pair_that_stayed_silent(reverse: bool) -> None:
    """gap >= dt ((w_i - w_j) . n + p_i + p_j) (eq. 11b)."""
    enough = DT * ((-3.0 if reverse else 3.0) + 3.0 + 5.0) + ROUNDING
    for gap, missed in ((enough, 0), (enough - 2.0**-40, 1)):
        x = (1.0 + 2.0 + gap) * (-1.0 if reverse else 1.0)
        record = amid_sweeps([[0.0, 1.0], [x, 1.0]])
        record.run(TRANSFER)
        assert flag(record, "missed") == missed


@pytest.mark.parametrize("how", ["listed before", "another attempt", "accelerated"])
def test_pair_that_was_not_missing(how: str) -> None:
    record = amid_sweeps([[0.0, 0.0], [3.0, 0.0]])
    if how == "listed before":
        record["workspace.old_place"][0] = record["workspace.old_index"][0] = 0
    elif how == "another attempt":
        record.record["control"]["resuming"] = 0
    else:
        record = record_with(accelerated=True)
        record.record["control"]["resuming"] = 1
        record["neighbors.start"][:], record["neighbors.neighbor"][0] = (0, 1, 1), 1
        record["workspace.sweep_index"][0], record["workspace.old_place"][0] = 0, -1
    record.run(TRANSFER)
    assert flag(record, "missed") == 0


@pytest.mark.parametrize("wall", ["outer", "inner"])
def test_walls_that_stayed_off(wall: str) -> None:
    """gap > dt (|w_i| + p_i), at both walls; a grain that was listed there needs no such proof."""
    path = DT * (5.0 + 3.0) + ROUNDING
    for gap, missed in ((path + 2.0**-40, 0), (path, 1)):
        at = 64.0 - 1.0 - gap if wall == "outer" else 16.0 + 1.0 + gap
        record = amid_sweeps([[0.0, -at], [0.0, 40.0]])
        record["verlet.reference_velocity"][0] = -3.0, 4.0
        record.record["walls"]["radius_in"], record.record["walls"]["radius_out"] = 16.0, 64.0
        record.run(Serial(neighbors.list_walls))
        assert record.record["contacts"]["count"]["walls"] == 2
        assert flag(record, "missed") == missed
        set_flags(record, missed=0)
        record["workspace.was_at_wall"][0] = 1
        record.run(Serial(neighbors.list_walls))
        assert flag(record, "missed") == 0


@pytest.mark.parametrize("how", ["step begins", "goes on", "goes on, accelerated"])
def test_new_list_keeps_what_11b_needs(how: str) -> None:
    """A Gauss-Seidel step that goes on keeps its w_i, with u in them, and its peaks, which belong to these."""
    record = record_with(accelerated=how == "goes on, accelerated", unmonitored_change=UNMONITORED)
    record.record["control"]["resuming"] = int(how != "step begins")
    record["verlet.peak_deviation"][:] = 4.0, 9.0
    record.run(Each(grain_count, skins.renew_skin), Serial(skins.find_lifetime))
    velocity = W + U if how == "goes on" else W + U + np.array([3.0, 4.0])
    assert (record["verlet.reference_velocity"] == velocity).all()
    assert (record["verlet.reference_position"] == STRAIGHT + np.array([3.0, 4.0]) / 8.0).all()
    assert (record["verlet.skin"] > 0.0).all()
    if how == "goes on":
        assert record["verlet.peak_deviation"].tolist() == [9.0, 16.0]
    numbers = record.verlet_numbers
    assert numbers["frame_shift"].tolist() == [0.0, 0.0]
    assert (numbers["elapsed"], numbers["unmonitored_change"]) == (0.0, 0.0)
    assert numbers["lifetime"] >= DT
