"""`warpgrains batch`: every run as if done alone."""

import gc
import pickle
import weakref
from pathlib import Path

import lightusd
import numpy as np
import pytest
from recordings import GRAINS
from same_bits import at_annulus, contents
from sweeps import SMALL, batch, begin, parts, results, rows, scene_of, table, write

from warpgrains import Scene, Simulation
from warpgrains.batch import loaded_scenes
from warpgrains.simulation.checkpoint import read_checkpoint
from warpgrains.solver import memory, sizes, tuning
from warpgrains.solver.records import SceneRecords
from warpgrains.sweep import group
from warpgrains.sweep.execution import ExecutionOptions
from warpgrains.sweep.runner import finish_runs
from warpgrains.usd.check import inspect_recording

FROM_FILE = """
domain = {radius_in = 0.1, radius_out = 1.0}
time = {duration = 0.1}
physics = {drag = 0.1}
[grains]
file = "a.npz"
radius = 0.1
mass = 0.1
"""


def test_one_row_a_run_and_one_part_a_group(done):
    found, (part,) = rows(done), parts(done)
    assert [row["run"] for row in found] == ["0", "1", "2", "3", "4", "5"]
    assert [row["physics.drag"] for row in found] == ["0.1", "0.1", "100.0", "100.0", "0.5", "0.5"]
    assert [row["grains.count"] for row in found] == ["5", "15"] * 3
    assert {row["scene"] for row in found} == {"annulus"}
    assert part == [row | time for row, time in zip(found, table(done / "timing.csv"), strict=True)]
    files = ["parts", "results.csv", "scenes", "settings.json", "timing.csv"]
    assert sorted(path.name for path in done.iterdir()) == files


def test_files_of_a_run(done, kept):
    assert results(kept) == results(done)
    names = {run.name: sorted(file.name for file in run.iterdir()) for run in (kept / "runs").iterdir()}
    assert names == {f"{k:05}": ["checkpoint.npz", "scene.toml"] for k in (0, 1, 4, 5)}


@pytest.mark.parametrize(("number", "is_common"), [(0, False), (5, False), (5, True)])
def test_run_is_as_if_done_alone(done, kept, number, is_common):
    """By its own scene file, or by that of the sweep and its row."""
    row, run = rows(done)[number], kept / "runs" / f"{number:05}"
    simulation = Simulation(scene_of(done, row) if is_common else Scene.load(run / "scene.toml"))
    scene = simulation.scene
    reports = [simulation.step() for _ in range(40)]
    assert contents(read_checkpoint(run / "checkpoint.npz").state) == contents(simulation.state())
    force = at_annulus(simulation).force
    expected = {
        "grains": simulation.scene.n,
        "steps": 40,
        "time": simulation.time,
        "iterations_mean": sum(report.iterations for report in reports) / 40,
        "iterations_max": max(report.iterations for report in reports),
        "unconverged": sum(not report.converged for report in reports),
        "worst_overlap": max(report.overlap for report in reports),
        "outer_wall_force": force[force > 0].sum(),
        "inner_wall_force": -force[force < 0].sum(),
        "pile_height": (simulation.position[:, 1] + scene.radius).max() + scene.radius_out,
    }
    assert {name: float(row[name]) for name in expected} == expected


def test_failed_and_unconverged_runs(done):
    """Fifteen grains need more than 30 iterations in some steps, five never do."""
    found = rows(done)
    assert [row["iterations_max"] for row in found] == ["2", "30", "", "", "2", "30"]
    assert [int(row["unconverged"] or 0) > 0 for row in found] == [False, True, False, False, False, True]
    for row in found[2:4]:
        assert "in one step, drag 100.0 kg/s would reverse grain 0" in row["error"]
        assert row["grains"] == row["pile_height"] == ""


@pytest.mark.parametrize(
    ("axis", "options", "error"),
    [
        ("grains.velocity = [[0.0, 0.0], [1e308, 0.0]]", (), "step 1, from t = 0.0 s: "),
        ("physics.gravity = [[0.0, -9.81], [0.0, -1e41]]", ("--usd",), "the velocity of a grain is "),
    ],
    ids=["not finite", "not recorded"],
)
def test_run_that_fails_leaves_the_others(tmp_path, capfd, axis, options, error):
    text = f'scene = "annulus"\n[set]\ntime.duration = 0.1\n[axes]\n{axis}'
    for more in ((), ("--resume",)):
        assert batch(write(tmp_path, text), "-o", tmp_path / "out", *options, *more) == 1
        good, bad = rows(tmp_path / "out")
        assert (good["error"], good["steps"]) == ("", "10")
        assert bad["error"].startswith(error)
        assert f"first run 1: {error}" in capfd.readouterr().out
    recordings = sorted(path.parent.name for path in tmp_path.rglob("recording.usdc"))
    assert recordings == (["00000", "00001"] if options else [])


def test_failed_run_has_its_seconds_and_its_last_good_state(tmp_path):
    text = 'scene = "annulus"\n[set]\nsolver.max_iterations = 3\n[axes]\nsolver.on_unconverged = ["raise"]'
    folder, sweep = begin(tmp_path, text)
    assert finish_runs(folder, sweep.runs, ExecutionOptions(folders=True), lambda _: None) == {}
    assert "step 20" in folder.write_tables(sweep)["error"][0]
    kept = read_checkpoint(folder.path / "runs" / "00000" / "checkpoint.npz")
    assert kept.statistics.steps == kept.state.steps == 19
    assert kept.statistics.seconds > 0.0
    assert table(folder.timing)[0]["seconds"] == f"{kept.statistics.seconds:.3f}"


@pytest.mark.parametrize("options", [(), ("--folders",), ("--usd",)])
def test_runs_that_do_not_fit_in_memory(tmp_path, done, monkeypatch, options):
    def require_memory(needed, grains, device):
        if grains >= 15:
            raise memory.OutOfMemoryError("15 grains are too many")

    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        patch.setattr(loaded_scenes, "require_memory", require_memory)
        assert batch(write(tmp_path), "-o", out, *options) == 1
    found = rows(out)
    assert [row["error"] for row in found if row["run"] in "15"] == ["15 grains are too many"] * 2
    assert found[::2] == rows(done)[::2]
    assert not list(tmp_path.rglob("*.frames"))
    assert batch(write(tmp_path), "-o", out, *options, "--resume") == 1
    assert results(out) == results(done)


@pytest.mark.parametrize("options", [(), ("--folders",), ("--usd",)])
def test_runs_that_do_not_fit_in_memory_together(tmp_path, done, monkeypatch, options):
    monkeypatch.setattr(memory, "free_memory", lambda _: 50_000.0)
    assert batch(write(tmp_path), "-o", tmp_path / "out", *options) == 1
    assert results(tmp_path / "out") == results(done)
    assert sorted(map(len, parts(tmp_path / "out"))) == [1, 1, 1, 1, 2]  # two have failed before
    for recording in tmp_path.rglob("*.usdc"):
        assert inspect_recording(recording) == []


@pytest.mark.parametrize("options", [(), ("--folders",)])
def test_memory_that_is_lacking_for_a_longer_list(tmp_path, done, monkeypatch, options):
    """The run continues alone, when nothing refers to the scenes of its group any more."""
    resize, refused, groups = SceneRecords._resize, [], []

    def resize_alone(records, *given):
        if len(records.host) > 1 and not refused:
            refused.append(given)
            raise memory.OutOfMemoryError("no room beside others")
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


@pytest.mark.parametrize(("threads", "sizes"), [(1, [6]), (2, [1, 1, 1, 1, 2])])
def test_large_runs_are_alone_if_threads_share_them(tmp_path, done, monkeypatch, threads, sizes):
    monkeypatch.setattr(tuning, "SHARED_SET", 0)  # every run is large
    monkeypatch.setattr(tuning, "cores", lambda: 2)
    assert batch(write(tmp_path), "-o", tmp_path / "out", "--threads", threads) == 1
    assert results(tmp_path / "out") == results(done)
    assert sorted(map(len, parts(tmp_path / "out"))) == sizes


def test_a_table_of_something_else_is_not_replaced(tmp_path, capfd):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "results.csv").write_text("precious")
    for more in ((), ("--resume",)):
        assert batch(write(tmp_path), "-o", tmp_path / "out", *more) == 2
        assert "refusing to overwrite" in capfd.readouterr().err
    assert results(tmp_path / "out") == b"precious"


@pytest.mark.parametrize("options", [(), ("--folders",)])
def test_cells_may_hold_all_grains(tmp_path, options):
    """More than the 131,072 characters that Python's csv reads by itself."""
    x, y = np.divmod(np.arange(3600), 60)
    places = (np.stack([x, y], axis=1) / 50.0 - 0.59 + 1e-9 / 3.0).tolist()
    assert len(str(places)) > 140_000
    fixed = "[set]\ntime.duration = 0.01\ngrains.radius = 0.005\n"
    text = f'scene = "scene.toml"\n{fixed}[axes]\ngrains.position = [{places}]\n'
    (tmp_path / "scene.toml").write_text("domain.radius_out = 1.0\ngrains.mass = 0.1\n")
    assert batch(write(tmp_path, text), "-o", tmp_path / "out", *options) == 0
    assert [(row["error"], row["grains"]) for row in rows(tmp_path / "out")] == [("", "3600")]


def test_no_picture_where_all_runs_fail(tmp_path, capfd):
    sweep = write(tmp_path, 'scene = "annulus"\n[axes]\nphysics.drag = [100.0, 200.0]\n')
    assert batch(sweep, "-o", tmp_path / "out", "--plot", "x=physics.drag,y=steps") == 1
    assert "picture           none: no run has succeeded" in capfd.readouterr().out


def test_summary(tmp_path, capfd):
    assert batch(write(tmp_path, SMALL.replace("100.0, ", "")), "-o", tmp_path / "out") == 0
    summary = {line[:17].strip(): line[18:] for line in capfd.readouterr().out.splitlines()}
    assert list(summary) == ["runs", "failed", "not finished", "not converged", "time", "results"]
    assert list(summary.values())[:3] == ["4, 0 of them finished before", "0", "0"]


def test_grains_from_a_file(tmp_path):
    """Each run reads a copy that the folder of the sweep holds, wherever that is moved."""
    (tmp_path / "scene.toml").write_text(FROM_FILE)
    for name, position in {"a": [[0.5, 0.0]], "b": [[0.0, 0.5], [0.5, 0.0]]}.items():
        np.savez(tmp_path / f"{name}.npz", position=np.array(position))
    sweep = write(tmp_path, 'scene = "scene.toml"\n[axes]\ngrains.file = ["a.npz", "b.npz"]')
    assert batch(sweep, "-o", tmp_path / "short") == 0
    assert batch(sweep, "-o", tmp_path / "out", "--folders") == 0
    assert results(tmp_path / "out") == results(tmp_path / "short")
    found = [(row["grains.file"], row["grains"]) for row in rows(tmp_path / "out")]
    assert found == [("a.npz", "1"), ("b.npz", "2")]
    (tmp_path / "out").rename(tmp_path / "moved")
    for path in tmp_path.glob("*.npz"):
        path.unlink()
    assert Scene.load(tmp_path / "moved" / "runs" / "00001" / "scene.toml").n == 2


def test_workers_need_no_source_of_the_grains(tmp_path, monkeypatch):
    """Paths are relative to the folder of the process that reads the sweep."""
    (tmp_path / "scene.toml").write_text(FROM_FILE)
    np.savez(tmp_path / "a.npz", position=np.array([[0.5, 0.0]]))
    monkeypatch.chdir(tmp_path)
    folder, sweep = begin(Path(), 'scene = "scene.toml"', tmp_path / "out")
    content = pickle.dumps((folder, sweep.runs))
    (tmp_path / "a.npz").unlink()
    monkeypatch.chdir("/")
    assert finish_runs(*pickle.loads(content), ExecutionOptions(), lambda _: None) == {}
    assert folder.write_tables(sweep)["error"] == [""]


def test_recordings(tmp_path, done):
    assert batch(write(tmp_path), "-o", tmp_path / "out", "--usd", "--fps", "50") == 1
    assert results(tmp_path / "out") == results(done)
    recording = tmp_path / "out" / "runs" / "00005" / "recording.usdc"
    assert inspect_recording(recording) == []
    points = lightusd.load(str(recording)).prim_at(GRAINS).attribute("points")
    assert points.timesamples.times == tuple(range(21))
    simulation = Simulation(Scene.load(recording.with_name("scene.toml")))
    simulation.run(steps=40)
    assert np.array_equal(np.asarray(points.get(20))[:, :2], simulation.position.astype(np.float32))
