"""Decisions between two accelerated sweeps, at their bounds: momentum (13), the monotone safeguard (14)."""

import numpy as np
import pytest
import warp as wp
from stages import OneRecord, grains_apart

from warpgrains.kernels import momentum, sweep
from warpgrains.kernels.record import Phase, Scene, grain_count
from warpgrains.kernels.stages import Each, Serial, Shared
from warpgrains.kernels.stopping import end_list_check

N, TOLERANCE, TINY = 150, 2.0**-4, 2.0**-40


@wp.func
def accept_or_reject(s: Scene):
    momentum.accept_or_reject(s, s.step.zeta)


def record_with(**state: float) -> OneRecord:
    """Return a record after a sweep whose parts of (14) add up to nothing."""
    scene = grains_apart(N).replace(method="accelerated", tolerance=TOLERANCE, max_iterations=1000)
    record = OneRecord(scene, contacts=300 + N)
    for name in ("contact_sums", "body_sums"):
        record[f"momentum.{name}"][:] = 0.0
    record.record["contacts"]["count"] = 300, 1, N
    known = {"t": 4.0, "beta": 0.5, "relaxation": 0.25, "first_zeta": 1.0}
    for name, value in (known | state).items():
        record.record["momentum"]["state"][name] = value
    record["partial.zeta"][:] = 0.0
    record.record["step"]["iterations"], record.record["step"]["zeta"] = 5, 1.0
    record.record["control"]["rejected"] = 0
    return record


def state(record: OneRecord, name: str) -> float:
    return float(record.record["momentum"]["state"][name])


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
        record = record_with(t=t, beta=beta)
        record["momentum.contact_sums"][chunks] = sums
        record["momentum.body_sums"][of_grains] = moving
        record.run(Serial(accept_or_reject))
        assert record.record["control"]["rejected"] == rejected
        assert state(record, "relaxation") == (0.8 * 0.25 if rejected else 0.25)
        if stops:
            assert (state(record, "t"), state(record, "beta")) == (max(1.0, 0.5 * t), 0.0)
        else:
            assert state(record, "t") > t


HELD = [
    # sweeps before, zeta, first zeta, t, t after it
    (5, 6.0 * TOLERANCE, 1.0, 99.0, None),
    (5, 6.0 * TOLERANCE - TINY, 1.0, 99.0, 24.0),
    (5, 0.0, 400.0, 99.0, 120.0),
    (5, 0.0, 400.0, 300.0, 120.0),
    (499, 0.0, 400.0, 200.0, 120.0),
    (749, 0.0, 400.0, 200.0, 150.0),
    (5, 0.0, 1.0, 2.0, None),
    (0, 3.0, 7.0, 4.0, None),
]


@pytest.mark.parametrize(("sweeps", "zeta", "first", "t", "held"), HELD)
def test_how_far_momentum_goes_on(
    sweeps: int, zeta: float, first: float, t: float, held: float | None
) -> None:
    """t' and beta (eq. 13); near the end t is the largest of 24, 1.5 sqrt(zeta_1 / tolerance) and k / 5."""
    record = record_with(t=t, first_zeta=first)
    record.record["step"]["iterations"], record.record["step"]["zeta"] = sweeps, zeta
    record.run(Serial(accept_or_reject))
    following = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * t * t))
    assert state(record, "beta") == (t - 1.0) / following
    assert state(record, "t") == (following if held is None else min(following, held))
    assert state(record, "first_zeta") == (first if sweeps else zeta)


@pytest.mark.parametrize("rejected", [0, 1])
@pytest.mark.parametrize("zeta", [2.0 * TOLERANCE, 3.0 * TOLERANCE])
@pytest.mark.parametrize("ends", [False, True])
def test_when_all_contacts_are_scanned(zeta: float, rejected: int, ends: bool) -> None:
    """After iterations 1, 2, 4, 8, every tenth, and the last; eta is measured after those that are kept."""
    record = record_with()
    whole, control = record.record, record.record["control"]
    for k in range(1, 205):
        whole["momentum"]["state"]["beta"], whole["stopping"]["max_iterations"] = 0.5, k if ends else 1000
        whole["step"]["iterations"], whole["step"]["measured"] = k - 1, 0
        record["partial.zeta"][0], record["momentum.contact_sums"][0, 0] = zeta, rejected
        control["rejected"] = 1 - rejected
        record.run(Serial(sweep.end_sweep))
        assert control["rejected"] == rejected
        checks = not rejected and (k == 1 or k % 10 == 0) and zeta <= 2.0 * TOLERANCE
        recomputes = checks or (not rejected and k % 100 == 0)
        scans = k in (1, 2, 4, 8) or k % 10 == 0 or ends or recomputes
        assert control["phase"] == (Phase.CHECK_LIST if scans else Phase.SWEEP)
        assert control["may_stop"] == ends
        if scans:
            whole["verlet"]["flags"]["list_expired"] = 0
            record.run(Serial(end_list_check))
            assert control["phase"] == (Phase.MEASURE if recomputes or ends else Phase.SCAN)


def test_velocities_go_on_as_they_were_rebuilt() -> None:
    """The last ones are moved by as much, so that momentum stays what it was."""
    record = record_with()
    rebuilt, last, v = np.random.default_rng(2).integers(-99, 99, (3, N, 2)) / 8.0
    record["grains.recomputed_velocity"][:], record["momentum.last_velocity"][:] = rebuilt, last
    record["grains.next_velocity"][:] = v
    record.run(Each(grain_count, momentum.take_recomputed_velocity))
    assert np.array_equal(record["grains.next_velocity"], rebuilt)
    assert np.array_equal(record["momentum.last_velocity"], rebuilt + last - v)


def test_way_to_y() -> None:
    """y = v + beta (v - v_last), and the sums of m (v - v_last) . (v + y) and m v . v, by 128 grains."""
    record = record_with(beta=0.5)
    v, last = np.random.default_rng(2).integers(-99, 99, (2, N, 2)) / 8.0
    record["grains.next_velocity"][:], record["momentum.last_velocity"][:] = v, last
    record["momentum.body_sums"][:] = np.nan
    record.run(Shared(momentum.extrapolate))
    y = v + 0.5 * (v - last)
    assert np.array_equal(record["grains.next_velocity"], y)
    assert np.array_equal(record["momentum.last_velocity"], v)
    energy, size = ((v - last) * (v + y)).sum(axis=1), (v * v).sum(axis=1)
    for chunk, grains in enumerate((slice(128), slice(128, N))):
        assert record["momentum.body_sums"][chunk].tolist() == [energy[grains].sum(), size[grains].sum()]
