"""How many runs of a sweep are executed together."""

from contextlib import ExitStack
from types import SimpleNamespace
from weakref import WeakSet

import pytest
from sweeps import SMALL, batch, results, write

from warpgrains.solver.memory import OutOfMemoryError
from warpgrains.sweep import runner
from warpgrains.sweep.group import Group


class FakeRunner:
    """Runs that take one millisecond each, on a clock of their own."""

    narrowest, widest = 2, 4096

    def __init__(self, grains, runs):
        self.scene, self.runs = SimpleNamespace(n=grains), runs
        self.time, self.sizes, self.reasons, self.held = 0.0, [], {}, ExitStack()

    def choose(self, width):
        self.runs, chosen = self.runs[width:], self.runs[:width]
        return chosen

    def prepare(self, chosen):
        return SimpleNamespace(members=[SimpleNamespace(scene=self.scene)] * len(chosen))

    def load(self, group):
        pass

    def carry_out(self, group):
        self.sizes.append(len(group.members))
        self.time += 1e-3 * len(group.members)


@pytest.mark.parametrize(
    ("grains", "settled"), [(15, 1000), (2000, 100), (10**6, 1)], ids=["by time", "by grains", "large"]
)
def test_sizes_settle(monkeypatch, grains, settled):
    runs = FakeRunner(grains, range(20_000 if settled == 1000 else 1000))
    monkeypatch.setattr(runner, "perf_counter", lambda: runs.time)
    monkeypatch.setattr(runner, "Runner", lambda *_: runs)
    count = len(runs.runs)
    runner.finish_runs(None, [], None, None)
    later = runs.sizes[6:-1]
    assert len(later) > 3
    assert all(size == pytest.approx(settled, rel=0.01) for size in later)
    assert sum(runs.sizes) == count


def test_a_group_that_does_not_fit_beside_another_stays_whole(tmp_path, monkeypatch):
    sweep = write(tmp_path, SMALL.replace("100.0", "0.3"))
    assert batch(sweep, "-o", tmp_path / "in one") == 0
    load, loaded, sizes = Group.load, WeakSet(), []

    def load_without_room(group, *where):
        if loaded:
            raise OutOfMemoryError("no room for two")
        load(group, *where)
        loaded.add(group)
        sizes.append(len(group.members))

    monkeypatch.setattr(Group, "load", load_without_room)
    monkeypatch.setattr(runner, "LEAST_WIDTH", 2)
    assert batch(sweep, "-o", tmp_path / "in three", "--threads", "2") == 0
    assert sizes == [2, 2, 2]
    assert results(tmp_path / "in three") == results(tmp_path / "in one")
