"""The check of a list (11), and monitoring, stage by stage: at each bound, and just beyond it.

All numbers are short sums of powers of two and sides of right triangles: no stage rounds them, and a bound is
met exactly. Every term is far larger than the step beyond the bound, so that none of them can be left out.
"""

from typing import Any

import numpy as np
import pytest
import warp as wp
from stages import OneRecord, grains_apart

from warpgrains.kernels import skins, verlet
from warpgrains.kernels.record import EXPIRED, NOT_FINITE, SOLVED, Scene, grain_count
from warpgrains.kernels.stages import Each, If, Serial, Stage

DT, ROUNDING = 0.25, 2.0**-10
BASE_SKIN, RESERVE = 2.0, 2.0**-3
W, X0, U_PATH, U = np.array([[4.0, -8.0], [1.0, 2.0], [0.5, 0.25], [1.0, 0.5]])
ELAPSED = 0.5
POSITION = X0 + ELAPSED * W + U_PATH + np.array([3.0, 4.0]) / 8.0
VELOCITY = W + U + np.array([3.0, 4.0])
DISPLACEMENT, DEVIATION = 0.625, 5.0  # of (3, 4) / 8 m and (3, 4) m/s
UNMONITORED = 1.0


def record_with(accelerated: bool = False, **numbers: Any) -> OneRecord:
    """Return two grains on their way, with more skin than they ever need."""
    method = "accelerated" if accelerated else "gauss-seidel"
    record = OneRecord(grains_apart(2).replace(dt=DT, method=method), contacts=4)
    record["verlet.reference_velocity"][:], record["verlet.reference_position"][:] = W, X0
    record["grains.position"][:], record["grains.next_velocity"][:] = POSITION, VELOCITY
    for name in ("peak_square", "recent_deviation", "peak_limit"):
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
        part = record.verlet_work if name in record.verlet_work.dtype.names else record.verlet_numbers
        part[name] = value
    flags(record)["list_expired"], flags(record)["bad_body"] = 0, -1
    return record


def flags(record: OneRecord) -> Any:
    return record.record["verlet"]["flags"]


@wp.func
def check_all(s: Scene):
    verlet.check_all(s, s.tuning.rounding)


@wp.func
def find_outcome(s: Scene):
    s.step.outcome = verlet.outcome_of_check(s)


EACH: dict[str, Stage] = {
    "verify": Each(grain_count, verlet.verify),
    "begin_check": Each(grain_count, verlet.begin_check),
}
BEFORE = ROUNDING + RESERVE * BASE_SKIN
CHECKS = {
    "the peak of the iteration": ("verify", 0, 6.0, 100.0, 6.0, ROUNDING),
    "the same, for sweeps that resumed": ("verify", 1, 6.0, 100.0, 6.0, ROUNDING),
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
        record["verlet.peak_square"][grain], record["verlet.recent_deviation"][grain] = seen**2, last
        record["verlet.skin"][grain] = skin
        record.run(EACH[stage])
        assert flags(record)["list_expired"] == expired
        assert flags(record)["bad_body"] == -1


def test_what_a_skin_still_allows() -> None:
    for skin, limit in ((2.625, 8.0), (0.625, 0.0), (0.5, 0.0)):
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
    assert flags(record)["bad_body"] == grain
    flags(record)["list_expired"] = 1  # what is not finite is refused, not solved again with another list
    record.run(Serial(find_outcome))
    assert record.record["step"]["outcome"] == NOT_FINITE


FALLING = {"frame_shift": (3.0, -4.0), "frame_velocity": (0.0, 8.0)}
FRAME_SKIN = 5.0 + DT * 8.0 + ROUNDING
SERVES = [
    (FALLING | {"frame_skin": FRAME_SKIN}, SOLVED),
    (FALLING | {"frame_skin": np.nextafter(FRAME_SKIN, 0.0)}, EXPIRED),
    (FALLING | {"frame_skin": np.nan}, EXPIRED),
]
for steps in (0, 1, 7):
    for lifetime, outcome in (
        (steps + 1, SOLVED),
        ((steps + 1) * (1.0 - 0.9e-13), SOLVED),
        ((steps + 1) * (1.0 - 1.1e-13), EXPIRED),
        (steps, EXPIRED),
    ):
        SERVES.append(({"elapsed": steps * DT, "lifetime": lifetime * DT}, outcome))


@pytest.mark.parametrize(("numbers", "outcome"), SERVES)
def test_how_long_a_list_serves(numbers: dict[str, Any], outcome: int) -> None:
    """|U| + dt |u| <= frame skin; k steps, whatever rounding makes of their sum, and no step more."""
    record = record_with(**numbers)
    record.run(Serial(check_all), Serial(find_outcome))
    assert record.record["step"]["outcome"] == outcome


def test_check_is_cleared() -> None:
    record = record_with()
    flags(record)["list_expired"], flags(record)["bad_body"] = 1, 1
    record.run(Serial(verlet.clear_check))
    assert (flags(record)["list_expired"], flags(record)["bad_body"]) == (0, -1)
    assert record.verlet_work["unmonitored_change"] == 0.0


def test_frame_is_the_mean_and_moves_on() -> None:
    record = record_with(frame_velocity=(np.nan, np.nan))
    record["grains.next_velocity"][:] = W + np.array([[2.0, 8.0], [4.0, -4.0]])
    for resuming, u in ((1, [0.0, 0.0]), (0, [3.0, 2.0])):
        record.record["control"]["resuming"] = resuming
        record.run(Serial(verlet.find_frame))
        assert record.verlet_work["frame_velocity"].tolist() == u
    record.run(Serial(verlet.shift_frame))
    assert record.verlet_numbers["frame_shift"].tolist() == [0.5 + DT * 3.0, 0.25 + DT * 2.0]
    assert record.verlet_numbers["elapsed"] == ELAPSED + DT


def test_sample() -> None:
    """A grain may have been further from its velocity now by what was not monitored."""
    for seen, peak in ((0.0, 6.5), (6.0, 6.5), (7.0, 7.0)):
        record = record_with(unmonitored_change=1.5)
        record["verlet.peak_square"][:] = seen**2
        record.run(Each(grain_count, verlet.sample))
        assert record["verlet.peak_square"].tolist() == [peak**2, peak**2]


MOST, ROW_SUM = 2.0, 3.0


@pytest.mark.parametrize(
    ("zeta", "change", "sampling"),
    [(0.25, 1.75, 0), (1.0 / 3.0, 2.0, 0), (0.5, 2.5, 1), (MOST / ROW_SUM, 3.0, 1), (9.0, 3.0, 1)],
)
def test_changes_that_are_not_monitored_add_up(zeta: float, change: float, sampling: int) -> None:
    """A sweep adds max_row_sum zeta, or max_row_sum d = MOST if that is less; beyond MOST all is sampled."""
    record = record_with(max_row_sum=ROW_SUM)
    record.record["tuning"]["monitor_threshold"] = MOST / BASE_SKIN
    record.record["step"]["zeta"] = zeta
    record.run(Serial(verlet.add_unmonitored), If(verlet.is_sampling_due, [Serial(verlet.end_sampling)]))
    assert record.verlet_work["unmonitored_change"] == (0.0 if sampling else change)


@pytest.mark.parametrize("grain", [0, 1])
def test_the_velocity_before_the_step_counts_in_the_proof(grain: int) -> None:
    """A peak of 10 m/s, twice that of the velocity now, and what a skin allows of it."""
    for limit, expired in ((10.0, 0), (np.nextafter(10.0, 0.0), 1)):
        record = record_with()
        record["grains.velocity"][:] = W + U
        record["grains.velocity"][grain] += (6.0, 8.0)
        record["verlet.peak_limit"][:] = limit
        record.run(Each(grain_count, verlet.monitor_start))
        assert record["verlet.peak_square"][grain] == 100.0
        assert flags(record)["list_expired"] == expired


NEW = {  # iterations before, the margin of the skin, the deviations it covers, and the reference velocity
    "step begins": (0, skins.FORESEEN, [0.5, 0.5], VELOCITY),
    "begins again": (1, skins.FOUND_OUT, [2.0 + UNMONITORED, 3.0 + UNMONITORED], W + U),
    "resumes": (1, skins.STILL_TO_COME, [2.0 + UNMONITORED, 3.0 + UNMONITORED], VELOCITY),
}


@pytest.mark.parametrize("how", NEW)
def test_new_list_begins_now(how: str) -> None:
    """Its v0_i are the present velocities, or the old ones with v_f where plain sweeps begin again."""
    iterations, margin, needed, velocity = NEW[how]
    record = record_with(accelerated=how == "resumes")
    record.record["step"]["iterations"] = iterations
    record["verlet.peak_square"][:], record["verlet.recent_deviation"][:] = (4.0, 9.0), 0.5
    record.run(Each(grain_count, skins.renew_skin), Serial(skins.renew_numbers))
    assert (record["verlet.reference_velocity"] == velocity).all()
    assert (record["verlet.reference_position"] == POSITION).all()
    assert (record["verlet.skin"] == BASE_SKIN + float(margin) * DT * np.array(needed)).all()
    numbers = record.verlet_numbers
    assert (numbers["frame_shift"].tolist(), numbers["elapsed"]) == ([0.0, 0.0], 0.0)
    assert numbers["lifetime"] >= DT


def test_a_new_skin_covers_the_velocity_before_the_step() -> None:
    record = record_with()
    record["grains.velocity"][:] = W + np.array([3.0, 4.0])
    record["verlet.skin"][:] = 2.5, 9.0
    record.run(Each(grain_count, skins.widen_for_start))
    assert record["verlet.skin"].tolist() == [2.0 + 1.2 * 0.25 * 5.0, 9.0]


def test_step_leaves_its_peaks_for_the_next_list() -> None:
    record = record_with()
    record["verlet.peak_square"][:] = 4.0, 9.0
    record.run(Each(grain_count, verlet.remember))
    assert record["verlet.recent_deviation"].tolist() == [2.0 + UNMONITORED, 3.0 + UNMONITORED]


def test_list_serves_one_step_at_least() -> None:
    """However fast its grains are: one that served none would be built anew for ever."""
    record = record_with()
    record["verlet.reference_velocity"][:] = [[1e6, 0.0], [-1e6, 0.0]]
    record.run(Serial(skins.renew_numbers))
    assert record.verlet_numbers["lifetime"] == DT
