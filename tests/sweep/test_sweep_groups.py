"""Which runs of a sweep are executed together: as many as time, memory and threads allow."""

import gc
import weakref
from contextlib import ExitStack
from types import SimpleNamespace
from weakref import WeakSet

import pytest
from sweeps import SMALL, batch, parts, results, rows, write

from warpgrains.batch import loaded_scenes
from warpgrains.solver import memory, sizes, tuning
from warpgrains.solver.memory import OutOfMemoryError
from warpgrains.solver.records import SceneRecords
from warpgrains.sweep import group, runner
from warpgrains.sweep.group import Group
from warpgrains.usd.check import inspect_recording


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
    count = 20_000 if settled == 1000 else 1000
    runs = FakeRunner(grains, range(count))
    monkeypatch.setattr(runner, "perf_counter", lambda: runs.time)
    monkeypatch.setattr(runner, "Runner", lambda *_: runs)
    runner.finish_runs(None, [], None, None)
    later = runs.sizes[6:-1]
    assert len(later) > 3
    assert all(size == pytest.approx(settled, rel=0.01) for size in later)
    assert sum(runs.sizes) == count


def test_a_group_that_does_not_fit_beside_another_stays_whole(tmp_path, monkeypatch):
    sweep = write(tmp_path, SMALL.replace("100.0", "0.3"))
    assert batch(sweep, "-o", tmp_path / "in one") == 0
    load, loaded, found = Group.load, WeakSet(), []

    def load_without_room(group, *where):
        if loaded:
            raise OutOfMemoryError("no room for two")
        load(group, *where)
        loaded.add(group)
        found.append(len(group.members))

    monkeypatch.setattr(Group, "load", load_without_room)
    monkeypatch.setattr(runner, "LEAST_WIDTH", 2)
    assert batch(sweep, "-o", tmp_path / "in three", "--threads", "2") == 0
    assert found == [2, 2, 2]
    assert results(tmp_path / "in three") == results(tmp_path / "in one")


@pytest.mark.parametrize("options", [(), ("--usd",)])
def test_runs_that_do_not_fit_in_memory(tmp_path, done, monkeypatch, options):
    def require_memory(needed, grains, device):
        if grains >= 15:
            raise OutOfMemoryError("15 grains are too many")

    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        patch.setattr(loaded_scenes, "require_memory", require_memory)
        assert batch(write(tmp_path), "-o", out, *options) == 1
    found = rows(out)
    assert [row["error"] for row in found if row["run"] in "15"] == ["15 grains are too many"] * 2
    assert found[::2] == rows(done)[::2]
    assert not list(tmp_path.rglob("*.frames"))
    monkeypatch.setattr(memory, "free_memory", lambda _: 50_000.0)  # for one run, not for two
    assert batch(write(tmp_path), "-o", out, *options, "--resume") == 1
    assert results(out) == results(done)
    for recording in tmp_path.rglob("*.usdc"):
        assert inspect_recording(recording) == []


@pytest.mark.parametrize("options", [(), ("--folders",)])
def test_memory_that_is_lacking_for_a_longer_list(tmp_path, done, monkeypatch, options):
    """The run continues alone, when nothing refers to the scenes of its group any more."""
    resize, refused, groups = SceneRecords._resize, [], []

    def resize_alone(records, *given):
        if len(records.host) > 1 and not refused:
            refused.append(given)
            raise OutOfMemoryError("no room beside others")
        return resize(records, *given)

    class Scenes(loaded_scenes.LoadedScenes):
        def __init__(self, *given):
            assert [scenes() for scenes in groups if scenes() is not None] == []
            groups.append(weakref.ref(self))
            super().__init__(*given)

    monkeypatch.setattr(sizes, "first_pairs", lambda n: n // 4)
    monkeypatch.setattr(SceneRecords, "_resize", resize_alone)
    monkeypatch.setattr(group, "LoadedScenes", Scenes)
    gc.collect()
    gc.disable()
    try:
        assert batch(write(tmp_path), "-o", tmp_path / "out", *options) == 1
    finally:
        gc.enable()
    assert refused
    assert len(groups) > 1
    assert results(tmp_path / "out") == results(done)


@pytest.mark.parametrize(
    ("place", "name", "value", "threads", "sizes"),
    [
        (tuning, "SHARED_SET", 0, 1, [6]),
        (tuning, "SHARED_SET", 0, 2, [1, 1, 1, 1, 2]),  # each run is large, so that threads share it
        (memory, "free_memory", lambda _: 50_000.0, 2, [1, 1, 1, 1, 2]),  # two have failed before
    ],
    ids=["one thread", "large", "no memory for two"],
)
def test_runs_that_have_a_group_of_their_own(tmp_path, done, monkeypatch, place, name, value, threads, sizes):
    monkeypatch.setattr(place, name, value)
    monkeypatch.setattr(tuning, "cores", lambda: 2)
    assert batch(write(tmp_path), "-o", tmp_path / "out", "--threads", threads) == 1
    assert results(tmp_path / "out") == results(done)
    assert sorted(map(len, parts(tmp_path / "out"))) == sizes
