"""An attempt that goes on with a new list: the bounds of (11b), by which missing contacts stayed silent."""

import numpy as np
import pytest
from checked_list import DT, ROUNDING, STRAIGHT, UNMONITORED, U, W, flag, record_with
from stages import OneRecord

from warpgrains.kernels import contact_list, skins
from warpgrains.kernels.record import grain_count
from warpgrains.kernels.stages import Each, Serial

WALL = 2  # the body after two grains
TOUCHING = {1: [[0.0, 0.0], [3.0, 0.0]], WALL: [[0.0, -63.0], [0.0, 40.0]]}


def may_have_missed(position: list[list[float]], other: int = 1, accelerated: bool = False) -> OneRecord:
    """List a contact of grain 0 newly, in an attempt that goes on, of two grains of peaks 3 and 5 m/s."""
    record = record_with(accelerated)
    record.record["control"]["resuming"] = 1
    record["grains.position"][:], record["grains.radius"][:] = position, (1.0, 2.0)
    record["verlet.peak_square"][:] = (3.0 - UNMONITORED) ** 2, (5.0 - UNMONITORED) ** 2
    record["verlet.reference_velocity"][:] = [[2.0, 7.0], [-1.0, 9.0]]
    record["neighbors.start"][:], record["neighbors.neighbor"][0] = (0, 1, 1), other
    record["workspace.sweep_index"][0], record["workspace.old_place"][0] = 0, -1
    annulus = record.record["walls"]["annulus"]
    annulus["radius_in"], annulus["radius_out"] = 16.0, 64.0
    return record


TRANSFER = Each(grain_count, contact_list.transfer_warm_start)


@pytest.mark.parametrize("reverse", [False, True])
def test_pair_that_stayed_silent(reverse: bool) -> None:
    """gap >= dt ((w_i - w_j) . n + p_i + p_j) (eq. 11b)."""
    enough = DT * ((-3.0 if reverse else 3.0) + 3.0 + 5.0) + ROUNDING
    for gap, missed in ((enough, 0), (enough - 2.0**-40, 1)):
        x = (1.0 + 2.0 + gap) * (-1.0 if reverse else 1.0)
        record = may_have_missed([[0.0, 1.0], [x, 1.0]])
        record.run(TRANSFER)
        assert flag(record, "missed") == missed


@pytest.mark.parametrize("other", TOUCHING)
@pytest.mark.parametrize("how", ["missing", "listed before", "another attempt", "accelerated"])
def test_contact_that_was_not_missing(how: str, other: int) -> None:
    record = may_have_missed(TOUCHING[other], other, accelerated=how == "accelerated")
    record["workspace.old_place"][0] = 0 if how == "listed before" else -1
    record.record["control"]["resuming"] = int(how != "another attempt")
    record.run(TRANSFER)
    assert flag(record, "missed") == int(how == "missing")


@pytest.mark.parametrize("wall", ["outer", "inner"])
def test_walls_that_stayed_off(wall: str) -> None:
    """gap > dt (|w_i| + p_i), at both walls."""
    path = DT * (5.0 + 3.0) + ROUNDING
    for gap, missed in ((path + 2.0**-40, 0), (path, 1)):
        at = 64.0 - 1.0 - gap if wall == "outer" else 16.0 + 1.0 + gap
        record = may_have_missed([[0.0, -at], [0.0, 40.0]], WALL)
        record["verlet.reference_velocity"][0] = -3.0, 4.0
        record.run(TRANSFER)
        assert flag(record, "missed") == missed


@pytest.mark.parametrize("how", ["step begins", "goes on", "goes on, accelerated"])
def test_new_list_keeps_what_11b_needs(how: str) -> None:
    """A Gauss-Seidel step that goes on keeps its w_i, with u in them, and the peaks that belong to these."""
    record = record_with(accelerated=how == "goes on, accelerated", unmonitored_change=UNMONITORED)
    record.record["control"]["resuming"] = int(how != "step begins")
    record["verlet.peak_square"][:] = 4.0, 9.0
    record.run(Each(grain_count, skins.renew_skin), Serial(skins.renew_numbers))
    velocity = W + U if how == "goes on" else W + U + np.array([3.0, 4.0])
    assert (record["verlet.reference_velocity"] == velocity).all()
    assert (record["verlet.reference_position"] == STRAIGHT + np.array([3.0, 4.0]) / 8.0).all()
    assert (record["verlet.skin"] > 0.0).all()
    if how == "goes on":
        assert record["verlet.peak_square"].tolist() == [9.0, 16.0]
    numbers = record.verlet_numbers
    assert numbers["frame_shift"].tolist() == [0.0, 0.0]
    assert (numbers["elapsed"], record.verlet_work["unmonitored_change"]) == (0.0, 0.0)
    assert numbers["lifetime"] >= DT


def test_list_serves_one_step_at_least() -> None:
    """However fast its grains are: one that served none would be built anew for ever."""
    record = record_with()
    record["verlet.reference_velocity"][:] = [[1e6, 0.0], [-1e6, 0.0]]
    record.run(Serial(skins.renew_numbers))
    assert record.verlet_numbers["lifetime"] == DT
