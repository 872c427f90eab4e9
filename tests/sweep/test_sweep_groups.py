"""Which runs of a sweep are executed together: as many as time, memory and threads allow."""

import gc
from collections import deque
from contextlib import ExitStack
from types import SimpleNamespace
from weakref import WeakSet

import pytest
from sweeps import SMALL, batch, parts, results, rows, write

from warpgrains.batch import loaded_scenes
from warpgrains.batch.loaded_scenes import LoadedScenes
from warpgrains.solver import memory, sizes, tuning
from warpgrains.solver.memory import OutOfMemoryError
from warpgrains.solver.records import SceneRecords
from warpgrains.sweep import group, runner
from warpgrains.sweep.group import Group
from warpgrains.usd.check import inspect_recording


@pytest.mark.parametrize(
    ("grains", "settled"), [(15, 1000), (2000, 100), (10**6, 1)], ids=["by time", "by grains", "large"]
)
def test_sizes_settle(monkeypatch, grains, settled):
    """Of runs that take one millisecond each."""
    count = 20_000 if settled == 1000 else 1000
    waiting, found = deque(range(count)), []

    def prepare(chosen):
        return SimpleNamespace(members=[SimpleNamespace(scene=SimpleNamespace(n=grains))] * len(chosen))

    fake = SimpleNamespace(
        narrowest=2,
        widest=4096,
        held=ExitStack(),
        reasons={},
        choose=lambda width: [waiting.popleft() for _ in range(min(width, len(waiting)))],
        prepare=prepare,
        load=lambda group: None,
        carry_out=lambda group: found.append(len(group.members)),
    )
    monkeypatch.setattr(runner, "perf_counter", lambda: 1e-3 * sum(found))
    monkeypatch.setattr(runner, "Runner", lambda *_: fake)
    runner.finish_runs(None, [], None, None)
    later = found[6:-1]
    assert len(later) > 3
    assert all(size == pytest.approx(settled, rel=0.01) for size in later)
    assert sum(found) == count


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
    resize, refused, groups, counts = SceneRecords._resize, [], WeakSet(), []

    def resize_alone(records, *given):
        if len(records.host) > 1 and not refused:
            refused.append(given)
            raise OutOfMemoryError("no room beside others")
        return resize(records, *given)

    def load(*given):
        assert not groups
        scenes = LoadedScenes(*given)
        groups.add(scenes)
        counts.append(len(scenes.scenes))
        return scenes

    monkeypatch.setattr(sizes, "first_pairs", lambda n: n // 4)
    monkeypatch.setattr(SceneRecords, "_resize", resize_alone)
    monkeypatch.setattr(group, "LoadedScenes", load)
    gc.collect()
    gc.disable()
    try:
        assert batch(write(tmp_path), "-o", tmp_path / "out", *options) == 1
    finally:
        gc.enable()
    assert refused
    assert len(counts) > 1
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


LID = """
[domain]
kind = "box"
x = [0.0, 1.0]
y = [0.0, 1.0]
top = {velocity = [0.0, -0.1], start_time = 0.0}

[physics]
drag = 0.0

[time]
dt = 0.01
duration = 0.1

[grains]
position = [[0.5, 0.5]]
radius = 0.05
mass = 1.0
"""


def test_runs_that_start_at_other_times_have_their_walls_there(tmp_path):
    """A lid sinks to the grain in 4.5 s, and pushes it from there on."""
    (tmp_path / "lid.toml").write_text(LID)
    sweep = write(tmp_path, 'scene = "lid.toml"\naxes.time.time = [0.0, 6.0]\n')
    assert batch(sweep, "-o", tmp_path / "both") in (0, 1)
    first, last = rows(tmp_path / "both")
    assert first["error"] == ""
    assert "inside" in last["error"] or "side" in last["error"], last
