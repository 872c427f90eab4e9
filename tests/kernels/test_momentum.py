"""Decisions between two accelerated sweeps, at their bounds: momentum (13), the monotone safeguard (14)."""

import numpy as np
import pytest
import warp as wp
from stages import OneRecord, Values, grains_apart

from warpgrains.kernels.record import Phase, Scene, grain_count
from warpgrains.kernels.sweeps import momentum, stopping, sweep
from warpgrains.kernels.team.stages import Each, If, Serial, Shared

N, TOLERANCE, TINY = 150, 2.0**-4, 2.0**-40
T, BETA, RELAXATION = "momentum.t", "momentum.beta", "momentum.relaxation"
FIRST, REJECTED = "momentum.first_zeta", "control.rejected"
SWEPT: Values = {
    "momentum.contact_sums": 0.0,
    "momentum.body_sums": 0.0,
    "contacts.count": (300, 1, N),
    "partial.zeta": 0.0,
    "step.iterations": 5,
    "step.zeta": 1.0,
    **{T: 4.0, BETA: 0.5, RELAXATION: 0.25, FIRST: 1.0, REJECTED: 0},
}
"""After a sweep whose parts of (14) add up to nothing."""


@wp.func
def accept_or_reject(s: Scene):
    momentum.accept_or_reject(s, s.step.zeta)


def record_with(values: Values) -> OneRecord:
    scene = grains_apart(N).replace(method="accelerated", tolerance=TOLERANCE, max_iterations=1000)
    record = OneRecord(scene, contacts=300 + N)
    record.write(SWEPT | values)
    return record


Two = tuple[float, float]
JUDGED = [
    # beta, energy and size, what two chunks add to phi and to its slope; is it rejected, does momentum stop
    (0.5, (4.0, 0.0), ((-0.75, 0.0), (-0.25, 0.0)), 0, 0),
    (0.5, (4.0, 0.0), ((-0.75, 0.0), (-0.25 + TINY, 0.0)), 1, 1),
    (0.5, (4.0, 0.0), ((-0.75 + TINY, 0.0), (-0.25, 0.0)), 1, 1),
    (0.5, (4.0, 1.0), ((0.0, 0.0), (0.0, 0.0)), 1, 1),
    (0.5, (4.0, 1.001e15), ((0.0, 0.0), (0.0, 0.0)), 0, 0),
    (0.5, (4.0, 0.999e15), ((0.0, 0.0), (0.0, 0.0)), 1, 1),
    (0.0, (4.0, 0.0), ((1.0, 0.0), (1.0, 0.0)), 0, 0),
    (0.5, (0.0, 0.0), ((0.0, 0.5), (0.0, -0.5)), 0, 0),
    (0.5, (0.0, 0.0), ((0.0, 0.5), (0.0, -0.5 + TINY)), 0, 1),
    (0.5, (0.0, 0.0), ((0.0, TINY), (0.0, 0.0)), 0, 1),
]


@pytest.mark.parametrize(("beta", "moving", "sums", "rejected", "stops"), JUDGED)
def test_sweep_that_raises_phi_is_rejected(
    beta: float, moving: Two, sums: tuple[Two, Two], rejected: int, stops: int
) -> None:
    """phi(y) - phi(a) <= 0.99 gains + 2e-15 beta sum m v^2 (eq. 14); chunks lie anywhere."""
    for t, chunks, of_grains in ((4.0, [0, 1], 0), (1.5, [5, 3], 1), (4.0, [2, 4], 0)):
        record = record_with({T: t, BETA: beta})
        record["momentum.contact_sums"][chunks] = sums
        record["momentum.body_sums"][of_grains] = moving
        record.run(Serial(accept_or_reject))
        record.assert_holds({REJECTED: rejected, RELAXATION: 0.8 * 0.25 if rejected else 0.25})
        if stops:
            record.assert_holds({T: max(1.0, 0.5 * t), BETA: 0.0})
        else:
            assert record[T][0] > t


HELD = [
    # sweeps before, zeta, first zeta, t, the most that t is after it
    (5, 6.0 * TOLERANCE, 1.0, 99.0, np.inf),
    (5, 6.0 * TOLERANCE - TINY, 1.0, 99.0, 24.0),
    (5, 0.0, 400.0, 99.0, 120.0),
    (5, 0.0, 400.0, 300.0, 120.0),
    (499, 0.0, 400.0, 200.0, 120.0),
    (749, 0.0, 400.0, 200.0, 150.0),
    (5, 0.0, 1.0, 2.0, np.inf),
    (0, 3.0, 7.0, 4.0, np.inf),
]


@pytest.mark.parametrize(("sweeps", "zeta", "first", "t", "most"), HELD)
def test_how_far_momentum_goes_on(sweeps: int, zeta: float, first: float, t: float, most: float) -> None:
    """t' and beta (eq. 13); near the end t is the largest of 24, 1.5 sqrt(zeta_1 / tolerance) and k / 5."""
    record = record_with({T: t, FIRST: first, "step.iterations": sweeps, "step.zeta": zeta})
    record.run(Serial(accept_or_reject))
    following = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * t * t))
    record.assert_holds({BETA: (t - 1.0) / following, T: min(following, most)})
    record.assert_holds({FIRST: first if sweeps else zeta})


MEASURE = If(stopping.is_residual_needed, [Serial(stopping.end_measurement)])


@pytest.mark.parametrize("rejected", [0, 1])
@pytest.mark.parametrize("zeta", [2.0 * TOLERANCE, 3.0 * TOLERANCE])
@pytest.mark.parametrize("ends", [False, True])
def test_when_all_contacts_are_scanned(zeta: float, rejected: int, ends: bool) -> None:
    """After iterations 1, 2, 4, 8, every tenth, and the last; eta is measured after those that are kept."""
    record = record_with({})
    for k in range(1, 205):
        record.write({BETA: 0.5, "stopping.max_iterations": k if ends else 1000, REJECTED: 1 - rejected})
        record.write({"step.iterations": k - 1, "step.measured": 0, "verlet.list_expired": 0})
        record.write({"control.phase": Phase.SWEEP, "partial.residual": 9.0})
        record["partial.zeta"][0], record["momentum.contact_sums"][0, 0] = zeta, rejected
        record.run(Serial(sweep.end_sweep))
        checks = not rejected and (k == 1 or k % 10 == 0) and zeta <= 2.0 * TOLERANCE
        recomputes = checks or (not rejected and k % 100 == 0)
        scans = k in (1, 2, 4, 8) or k % 10 == 0 or ends or recomputes
        phase = Phase.SCAN if scans else Phase.SWEEP
        record.assert_holds({REJECTED: rejected, "control.phase": phase, "control.may_stop": ends})
        if scans:
            record.run(Serial(stopping.end_list_check), MEASURE)
            record.assert_holds({"control.phase": Phase.SCAN, "step.measured": k * (recomputes or ends)})


def test_velocities_go_on_as_they_were_rebuilt() -> None:
    """The last ones are moved by as much, so that momentum stays what it was."""
    rebuilt, last, v = np.random.default_rng(2).integers(-99, 99, (3, N, 2)) / 8.0
    given = {"grains.recomputed_velocity": rebuilt, "momentum.last_velocity": last}
    record = record_with(given | {"grains.next_velocity": v})
    record.run(Each(grain_count, momentum.take_recomputed_velocity))
    record.assert_holds({"grains.next_velocity": rebuilt, "momentum.last_velocity": rebuilt + last - v})


def test_way_to_y() -> None:
    """y = v + beta (v - v_last), and the sums of m (v - v_last) . (v + y) and m v . v, by 128 grains."""
    v, last = np.random.default_rng(2).integers(-99, 99, (2, N, 2)) / 8.0
    given = {"grains.next_velocity": v, "momentum.last_velocity": last, "momentum.body_sums": np.nan}
    record = record_with(given)
    record.run(Shared(momentum.extrapolate))
    y = v + 0.5 * (v - last)
    record.assert_holds({"grains.next_velocity": y, "momentum.last_velocity": v})
    energy, size = ((v - last) * (v + y)).sum(axis=1), (v * v).sum(axis=1)
    for chunk, grains in enumerate((slice(128), slice(128, N))):
        assert record["momentum.body_sums"][chunk].tolist() == [energy[grains].sum(), size[grains].sum()]
