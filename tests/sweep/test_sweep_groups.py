"""How many runs of a sweep are executed together."""

import pytest

from warpgrains.sweep import runner


class FakeRunner:
    """Runs that take one millisecond each, on a clock of their own."""

    narrowest, widest = 2, 4096

    def __init__(self, grains):
        self.grains, self.time, self.sizes = grains, 0.0, []

    def prepare(self, points):
        return len(points)

    def carry_out(self, size):
        self.sizes.append(size)
        self.time += 1e-3 * size
        return self.grains * size


@pytest.mark.parametrize(
    ("grains", "settled"), [(15, 1000), (2000, 100), (10**6, 1)], ids=["by time", "by grains", "large"]
)
def test_sizes_settle(monkeypatch, grains, settled):
    runs = FakeRunner(grains)
    monkeypatch.setattr(runner, "perf_counter", lambda: runs.time)
    runner._in_groups(runs, range(20_000 if settled == 1000 else 1000))
    later = runs.sizes[6:-1]
    assert len(later) > 3
    assert all(size == pytest.approx(settled, rel=0.01) for size in later)
    assert sum(runs.sizes) == (20_000 if settled == 1000 else 1000)
