"""Grains are monitored after every large correction, whatever another pair does to them right after it."""

import graphs
import numpy as np
import pytest
from stages import OneRecord, record_of_graph

from warpgrains.arrays import FloatArray, IntArray
from warpgrains.kernels.gauss_seidel import sweep_pairs
from warpgrains.kernels.stages import Sets

GRAPHS = {
    "one pair": graphs.path(2),
    "a block and a pair": graphs.path(66),
    "sparse": graphs.random_graph(100, 300, seed=1),
    "dense": graphs.random_graph(30, 400, seed=2),
}
LARGE = 0.25  # m/s


@pytest.fixture(params=GRAPHS)
def pairs(request: pytest.FixtureRequest) -> IntArray:
    return GRAPHS[request.param]


def swept(pairs: IntArray) -> OneRecord:
    """Return a record with random contacts, about to be swept."""
    record, rng = record_of_graph(pairs), np.random.default_rng(5)
    contacts, angle = record["contacts.pairs"][: len(pairs)], rng.uniform(0.0, 6.3, len(pairs))
    contacts["i"], contacts["j"] = pairs.T
    contacts["n"] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    contacts["gap_rate"] = rng.uniform(-0.1, 0.3, len(pairs))
    record["contacts.pair_dv"][:] = 0.0
    record["contacts.set_start"][:2] = 0, len(pairs)
    record.record["contacts"]["count"] = len(pairs), 1, 0
    for name in ("grains.next_velocity", "verlet.reference_velocity"):
        record[name][:] = rng.normal(0.0, 1.0, record[name].shape)
    record["verlet.peak_deviation"][:], record["verlet.peak_limit"][:] = 0.0, np.inf
    record["partial.zeta"][:], record["partial.moments"][:] = 0.0, np.nan
    numbers = record.record["verlet"]["numbers"]
    numbers["frame_velocity"], numbers["base_skin"], numbers["max_row_sum"] = (0.1, -0.2), 1.0, 4.0
    record.record["tuning"]["monitor_threshold"] = 4.0 * LARGE
    record.record["verlet"]["flags"]["list_expired"] = 0
    return record


def peaks(record: OneRecord) -> FloatArray:
    """Return every grain's largest squared deviation after a large correction, pair by pair."""
    velocity, w = record["grains.next_velocity"].copy(), record["verlet.reference_velocity"]
    u, peak = record.record["verlet"]["numbers"]["frame_velocity"], np.zeros(len(velocity))
    for c in record["contacts.pairs"][: record.record["contacts"]["count"]["pairs"]]:
        i, j = c["i"], c["j"]
        product = (velocity[i] - velocity[j]) * c["n"]
        dv = max(0.0, product[0] + product[1] - c["gap_rate"])
        velocity[i] = velocity[i] - dv * c["n"] * 0.5
        velocity[j] = velocity[j] + dv * c["n"] * 0.5
        if dv > LARGE:
            for grain in (i, j):
                deviation = velocity[grain] - w[grain] - u
                peak[grain] = max(peak[grain], deviation[0] * deviation[0] + deviation[1] * deviation[1])
    return peak


def test_every_moment_after_a_large_correction_is_seen(pairs: IntArray) -> None:
    record = swept(pairs)
    expected = peaks(record)
    record.run(Sets(sweep_pairs))
    assert np.array_equal(record["verlet.peak_deviation"], expected)
    assert record.record["verlet"]["flags"]["list_expired"] == 0


def test_a_skin_that_is_too_narrow_is_found_out(pairs: IntArray) -> None:
    expected = peaks(swept(pairs))
    highest = int(expected.argmax())
    for factor, expired in ((1.01, 0), (0.99, 1)):
        record = swept(pairs)
        record["verlet.peak_limit"][highest] = factor * np.sqrt(expected[highest])
        record.run(Sets(sweep_pairs))
        assert record.record["verlet"]["flags"]["list_expired"] == (expired if expected[highest] > 0.0 else 0)
