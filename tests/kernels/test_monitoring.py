"""Grains are monitored after every large correction, whatever another contact does to them right after it."""

import numpy as np
import pytest
from stages import OneRecord, grain_total, path, random_graph, record_of_graph

from warpgrains.base.arrays import FloatArray, IntArray
from warpgrains.kernels.sweeps.sweep import sweeping
from warpgrains.kernels.team.stages import Sets

GRAPHS = {
    "one pair": path(2),
    "a block and a pair": path(66),
    "sparse": random_graph(100, 300, seed=1),
    "dense": random_graph(30, 400, seed=2),
}
LARGE = 0.25  # m/s
PEAK = "verlet.peak_square"
SWEEP = Sets(sweeping(False, False, ahead=False))


def swept(pairs: IntArray) -> OneRecord:
    """Return a record with random contacts, every grain at a wall of two sides, about to be swept."""
    n = grain_total(pairs)
    record, rng = record_of_graph(pairs, np.ones(n, int)), np.random.default_rng(5)
    contacts, angle = record["contacts.contact"][: len(pairs) + n], rng.uniform(0.0, 6.3, len(pairs) + n)
    bodies = np.concatenate([pairs, np.column_stack([np.arange(n), np.full(n, n)])])
    contacts["i"], contacts["j"] = 2 * bodies.T
    contacts["n"] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    contacts["gap_rate"] = rng.uniform(-0.1, 0.3, len(contacts))
    limits = np.stack([rng.uniform(-0.1, 0.3, n), np.full(n, np.inf)], axis=1)
    record.write({"contacts.limits": limits, "contacts.dv.now": 0.0, "contacts.count": (len(pairs), 1, n)})
    record["contacts.set_start"][:3] = 0, len(pairs), len(contacts)
    for name in ("grains.next_velocity", "verlet.reference_velocity"):
        record[name][:] = rng.normal(0.0, 1.0, record[name].shape)
    record.write({PEAK: 0.0, "verlet.peak_limit": np.inf, "verlet.list_expired": 0})
    record.write({"partial.zeta": 0.0, "partial.kept_velocity": np.nan, "verlet.base_skin": 1.0})
    record.write({"verlet.frame_velocity": (0.1, -0.2), "verlet.max_row_sum": 4.0})
    record.write({"tuning.monitor_threshold": 4.0 * LARGE})
    return record


def peaks(record: OneRecord) -> FloatArray:
    """Return every grain's largest squared deviation after a large correction, contact by contact."""
    velocity, w = record["grains.next_velocity"].copy(), record["verlet.reference_velocity"]
    n, pairs = len(velocity), int(record["contacts.count.pairs"][0])
    u, peak = record["verlet.frame_velocity"][0], np.zeros(n)
    for k, c in enumerate(record["contacts.contact"][: pairs + n]):
        i, j = c["i"] // 2, c["j"] // 2
        product = (velocity[i] - (velocity[j] if j < n else 0.0)) * c["n"]
        vn = product[0] + product[1]
        dv = max(0.0, vn - c["gap_rate"])
        if j < n:
            velocity[j] = velocity[j] + dv * c["n"] * 0.5
        else:
            dv -= max(0.0, -vn - record["contacts.limits"][k - pairs, 0])
        velocity[i] = velocity[i] - dv * c["n"] * (0.5 if j < n else 1.0)
        if abs(dv) > LARGE:
            for grain in (i, j) if j < n else (i,):
                deviation = velocity[grain] - w[grain] - u
                peak[grain] = max(peak[grain], deviation[0] * deviation[0] + deviation[1] * deviation[1])
    return peak


@pytest.mark.parametrize("name", GRAPHS)
def test_every_moment_after_a_large_correction_is_seen(name: str) -> None:
    """So is a skin that is too narrow for one."""
    record = swept(GRAPHS[name])
    expected = peaks(record)
    record.run(SWEEP)
    record.assert_holds({PEAK: expected, "verlet.list_expired": 0})
    highest = int(expected.argmax())
    for factor, expired in ((1.01, False), (0.99, True)):
        record = swept(GRAPHS[name])
        record["verlet.peak_limit"][highest] = factor * np.sqrt(expected[highest])
        record.run(SWEEP)
        record.assert_holds({"verlet.list_expired": expired and expected[highest] > 0.0})
