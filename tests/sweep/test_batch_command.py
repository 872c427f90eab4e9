"""`warpgrains batch`: every run as if done alone."""

import gc
import pickle
import subprocess
import sys
import weakref

import lightusd
import numpy as np
import pytest
from recordings import GRAINS
from same_bits import at_annulus, contents
from sweeps import SMALL, batch, results, table, write

from warpgrains import Recording, Scene, Simulation
from warpgrains.batch import loaded_scenes
from warpgrains.files import read_table
from warpgrains.simulation.checkpoint import read_checkpoint
from warpgrains.solver import memory, sizes, tuning
from warpgrains.solver.records import SceneRecords
from warpgrains.sweep import group
from warpgrains.sweep.execution import ExecutionOptions, RunSettings
from warpgrains.sweep.runner import finish_runs
from warpgrains.sweep.sweep import Sweep
from warpgrains.sweep.sweep_folder import SweepFolder
from warpgrains.usd.check import inspect_recording


class TestResults:
    def test_one_row_a_run(self, done):
        rows = table(done / "results.csv")
        assert [row["run"] for row in rows] == ["0", "1", "2", "3", "4", "5"]
        assert [row["physics.drag"] for row in rows] == ["0.1", "0.1", "100.0", "100.0", "0.5", "0.5"]
        assert [row["grains.count"] for row in rows] == ["5", "15"] * 3
        assert {row["scene"] for row in rows} == {"annulus"}
        assert [list(row) for row in table(done / "timing.csv")] == [["run", "seconds"]] * 6

    def test_short_runs_are_few_files(self, done):
        tables = ["results.csv", "scenes", "settings.json", "timing.csv"]
        assert sorted(path.name for path in done.iterdir()) == ["parts", *tables]
        (part,) = (done / "parts").glob("[0-9]*.csv")
        assert part.name.startswith("0000000-0000005-")
        timing = [{"seconds": row["seconds"]} for row in table(done / "timing.csv")]
        for row, result, seconds in zip(table(part), table(done / "results.csv"), timing, strict=True):
            assert row == result | seconds

    def test_any_run_is_what_the_scene_and_its_row_say(self, done):
        row = table(done / "results.csv")[5]
        overrides = [f"{key}={row[key]}" for key in ("physics.drag", "grains.count")]
        simulation = Simulation(Scene.load(done / "scenes" / "annulus.toml", overrides))
        simulation.run()
        force = at_annulus(simulation).force
        assert float(row["outer_wall_force"]) == force[force > 0].sum()

    def test_files_of_a_run(self, done, kept):
        assert results(kept) == results(done)
        names = {
            path.name: sorted(file.name for file in path.iterdir()) for path in (kept / "runs").iterdir()
        }
        assert names == {f"{k:05}": ["checkpoint.npz", "scene.toml"] for k in (0, 1, 4, 5)}

    @pytest.mark.parametrize("number", [0, 5])
    def test_run_is_as_if_done_alone(self, done, kept, number):
        simulation = Simulation(Scene.load(kept / "runs" / f"{number:05}" / "scene.toml"))
        reports = [simulation.step() for _ in range(40)]
        end = read_checkpoint(kept / "runs" / f"{number:05}" / "checkpoint.npz")
        assert contents(end.state) == contents(simulation.state())
        row = table(done / "results.csv")[number]
        force = at_annulus(simulation).force
        assert {name: float(row[name]) for name in ("grains", "steps", "time")} == {
            "grains": simulation.scene.n,
            "steps": 40,
            "time": simulation.time,
        }
        assert float(row["iterations_mean"]) == sum(report.iterations for report in reports) / 40
        assert int(row["iterations_max"]) == max(report.iterations for report in reports)
        assert int(row["unconverged"]) == sum(not report.converged for report in reports)
        assert float(row["worst_overlap"]) == max(report.overlap for report in reports)
        assert float(row["outer_wall_force"]) == force[force > 0].sum()
        assert float(row["inner_wall_force"]) == -force[force < 0].sum()
        height = (simulation.position[:, 1] + simulation.scene.radius).max() + simulation.scene.radius_out
        assert float(row["pile_height"]) == height

    def test_steps_that_did_not_converge_are_counted(self, done):
        """Fifteen grains need more than 30 iterations in some steps, five never do."""
        rows = table(done / "results.csv")
        assert [row["iterations_max"] for row in rows] == ["2", "30", "", "", "2", "30"]
        assert [int(row["unconverged"] or 0) > 0 for row in rows] == [False, True, False, False, False, True]

    def test_what_fails_says_why(self, done):
        for row in table(done / "results.csv")[2:4]:
            assert "in one step, drag 100.0 kg/s would reverse grain 0" in row["error"]
            assert row["grains"] == row["pile_height"] == ""

    def test_failing_step(self, tmp_path, capfd):
        """A grain as fast as a double can be: its first step is not finite; the others go on."""
        axis = "grains.velocity = [[0.0, 0.0], [1e308, 0.0]]"
        text = f'scene = "annulus"\n[set]\ntime.duration = 0.1\n[axes]\n{axis}'
        assert batch(write(tmp_path, text), "-o", tmp_path / "out") == 1
        good, bad = table(tmp_path / "out" / "results.csv")
        assert good["steps"] == "10"
        assert bad["error"].startswith("step 1, from t = 0.0 s: ")
        assert "first run 1: step 1, from t = 0.0 s: " in capfd.readouterr().out

    def test_failed_run_has_its_seconds_and_its_last_good_state(self, tmp_path):
        text = (
            'scene = "annulus"\n[set]\nsolver.max_iterations = 3\n[axes]\nsolver.on_unconverged = ["raise"]'
        )
        sweep, out = Sweep.load(write(tmp_path, text)), tmp_path / "out"
        folder = SweepFolder(out, sweep.axes, RunSettings())
        folder.create_or_check(sweep, sweep.runs, False)
        folder.write_common_files(sweep)
        assert finish_runs(folder, sweep.runs, ExecutionOptions(folders=True), lambda _: None) == {}
        assert "step 20" in folder.write_tables(sweep).failed[0]
        kept = read_checkpoint(out / "runs" / "00000" / "checkpoint.npz")
        assert kept.statistics.steps == kept.state.steps == 19
        assert kept.statistics.seconds > 0.0
        assert table(out / "timing.csv")[0]["seconds"] == f"{kept.statistics.seconds:.3f}"

    @pytest.mark.parametrize("options", [(), ("--folders",), ("--usd",)])
    def test_runs_that_do_not_fit_in_memory(self, tmp_path, done, monkeypatch, options):
        def require_memory(needed, grains, device):
            if grains >= 15:
                raise memory.OutOfMemoryError("15 grains are too many")

        monkeypatch.setattr(loaded_scenes, "require_memory", require_memory)
        assert batch(write(tmp_path), "-o", tmp_path / "out", *options) == 1
        found, others = table(tmp_path / "out" / "results.csv"), table(done / "results.csv")
        assert [row["error"] for row in found if row["run"] in "15"] == ["15 grains are too many"] * 2
        assert found[::2] == others[::2]
        assert not list(tmp_path.rglob("*.frames"))
        monkeypatch.undo()
        assert batch(write(tmp_path), "-o", tmp_path / "out", *options, "--resume") == 1
        assert results(tmp_path / "out") == results(done)

    @pytest.mark.parametrize("options", [(), ("--folders",), ("--usd",)])
    def test_runs_that_do_not_fit_in_memory_together(self, tmp_path, done, monkeypatch, options):
        monkeypatch.setattr(memory, "free_memory", lambda _: 50_000.0)
        assert batch(write(tmp_path), "-o", tmp_path / "out", *options) == 1
        assert results(tmp_path / "out") == results(done)
        parts = [table(part) for part in (tmp_path / "out").glob("parts/[0-9]*.csv")]
        assert sorted(len(part) for part in parts) == [1, 1, 1, 1, 2]  # two have failed before
        for recording in tmp_path.rglob("*.usdc"):
            assert inspect_recording(recording) == []

    @pytest.mark.parametrize("options", [(), ("--folders",)])
    def test_memory_that_is_lacking_for_a_longer_list(self, tmp_path, done, monkeypatch, options):
        """Runs that lack it beside others continue alone."""
        resize, refused = SceneRecords._resize, []

        def resize_alone(records, *given):
            if len(records.host) > 1 and not refused:
                refused.append(given)
                raise memory.OutOfMemoryError("no room beside others")
            return resize(records, *given)

        monkeypatch.setattr(sizes, "first_pairs", lambda n: n // 4)
        monkeypatch.setattr(SceneRecords, "_resize", resize_alone)
        assert batch(write(tmp_path), "-o", tmp_path / "out", *options) == 1
        assert refused
        assert results(tmp_path / "out") == results(done)

    def test_a_run_continues_alone_when_the_others_are_no_longer_in_memory(self, tmp_path, done, monkeypatch):
        """Nothing refers to the scenes of the group, so that their memory is free at once."""
        resize, refused, groups = SceneRecords._resize, [], []

        def resize_alone(records, *given):
            if len(records.host) > 1 and not refused:
                refused.append(given)
                raise memory.OutOfMemoryError("no room beside others")
            return resize(records, *given)

        class Sets(loaded_scenes.LoadedScenes):
            def __init__(self, *given):
                assert [sets() for sets in groups if sets() is not None] == []
                groups.append(weakref.ref(self))
                super().__init__(*given)

        monkeypatch.setattr(sizes, "first_pairs", lambda n: n // 4)
        monkeypatch.setattr(SceneRecords, "_resize", resize_alone)
        monkeypatch.setattr(group, "LoadedScenes", Sets)
        gc.collect()
        gc.disable()
        try:
            assert batch(write(tmp_path), "-o", tmp_path / "out", "--folders") == 1
        finally:
            gc.enable()
        assert len(groups) > 1
        assert results(tmp_path / "out") == results(done)

    def test_a_run_that_a_recording_cannot_hold_fails_alone(self, tmp_path):
        gravity = "[axes]\nphysics.gravity = [[0.0, -9.81], [0.0, -1e41]]\n"
        text = f'scene = "annulus"\n[set]\ntime.duration = 0.1\n{gravity}'
        for more in ((), ("--resume",)):
            assert batch(write(tmp_path, text), "-o", tmp_path / "out", "--usd", *more) == 1
            good, bad = table(tmp_path / "out" / "results.csv")
            assert (good["error"], good["steps"]) == ("", "10")
            assert bad["error"].startswith("the velocity of a grain is ")
        assert [path.parent.name for path in tmp_path.rglob("recording.usdc")] == ["00000", "00001"]

    def test_a_table_of_something_else_is_not_replaced(self, tmp_path, capfd):
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "results.csv").write_text("precious")
        for more in ((), ("--resume",)):
            assert batch(write(tmp_path), "-o", tmp_path / "out", *more) == 2
            assert "refusing to overwrite" in capfd.readouterr().err
        assert (tmp_path / "out" / "results.csv").read_text() == "precious"

    @pytest.mark.parametrize("options", [(), ("--folders",)])
    def test_cells_may_hold_all_grains(self, tmp_path, options):
        """More than the 131,072 characters that Python's csv reads by itself."""
        x, y = np.divmod(np.arange(3600), 60)
        places = (np.stack([x, y], axis=1) / 50.0 - 0.59 + 1e-9 / 3.0).tolist()
        assert len(str(places)) > 140_000
        fixed = "[set]\ntime.duration = 0.01\ngrains.radius = 0.005\n"
        text = f'scene = "scene.toml"\n{fixed}[axes]\ngrains.position = [{places}]\n'
        (tmp_path / "scene.toml").write_text("domain.radius_out = 1.0\ngrains.mass = 0.1\n")
        assert batch(write(tmp_path, text), "-o", tmp_path / "out", *options) == 0
        (row,) = read_table(tmp_path / "out" / "results.csv")
        assert (row["error"], row["grains"]) == ("", "3600")

    def test_no_picture_where_all_runs_fail(self, tmp_path, capfd):
        sweep = write(tmp_path, 'scene = "annulus"\n[axes]\nphysics.drag = [100.0, 200.0]\n')
        assert batch(sweep, "-o", tmp_path / "out", "--plot", "x=physics.drag,y=steps") == 1
        assert "picture           none: no run has succeeded" in capfd.readouterr().out

    @pytest.mark.parametrize(("threads", "sizes"), [(1, [6]), (2, [1, 1, 1, 1, 2])])
    def test_large_runs_are_alone_if_threads_share_them(self, tmp_path, done, monkeypatch, threads, sizes):
        monkeypatch.setattr(tuning, "SHARED_SET", 0)  # every run is large
        monkeypatch.setattr(tuning, "cores", lambda: 2)
        assert batch(write(tmp_path), "-o", tmp_path / "out", "--threads", threads) == 1
        assert results(tmp_path / "out") == results(done)
        parts = [table(part) for part in (tmp_path / "out").glob("parts/[0-9]*.csv")]
        assert sorted(len(part) for part in parts) == sizes

    def test_summary(self, tmp_path, capfd):
        sweep = write(tmp_path, SMALL.replace("100.0, ", ""))
        assert batch(sweep, "-o", tmp_path / "out") == 0
        printed = capfd.readouterr().out.splitlines()
        summary = {line[:17].strip(): line[18:] for line in printed}
        assert list(summary) == ["runs", "failed", "not finished", "not converged", "time", "results"]
        assert summary["runs"] == "4, 0 of them finished before"
        assert summary["failed"] == "0"
        assert summary["not finished"] == "0"

    def test_grains_from_a_file(self, tmp_path):
        """Each run reads a copy that the folder of the sweep holds, wherever that is moved."""
        (tmp_path / "scene.toml").write_text(
            "domain = {radius_in = 0.1, radius_out = 1.0}\ntime = {duration = 0.1}\nphysics = {drag = 0.1}\n"
            '[grains]\nfile = "a.npz"\nradius = 0.1\nmass = 0.1\n'
        )
        places = {"a": [[0.5, 0.0]], "b": [[0.0, 0.5], [0.5, 0.0]]}
        for name, position in places.items():
            np.savez(tmp_path / f"{name}.npz", position=np.array(position))
        text = 'scene = "scene.toml"\n[axes]\ngrains.file = ["a.npz", "b.npz"]'
        sweep = write(tmp_path, text)
        assert batch(sweep, "-o", tmp_path / "short") == 0
        assert batch(sweep, "-o", tmp_path / "out", "--folders") == 0
        assert results(tmp_path / "out") == results(tmp_path / "short")
        rows = table(tmp_path / "out" / "results.csv")
        assert [(row["grains.file"], row["grains"]) for row in rows] == [("a.npz", "1"), ("b.npz", "2")]
        (tmp_path / "out").rename(tmp_path / "moved")
        for name in places:
            (tmp_path / f"{name}.npz").unlink()
        assert Scene.load(tmp_path / "moved" / "runs" / "00001" / "scene.toml").n == 2

    def test_workers_need_no_source_of_the_grains(self, tmp_path, monkeypatch):
        """Paths are relative to the folder of the process that reads the sweep."""
        (tmp_path / "scene.toml").write_text(
            "domain = {radius_in = 0.1, radius_out = 1.0}\ntime = {duration = 0.1}\nphysics = {drag = 0.1}\n"
            '[grains]\nfile = "a.npz"\nradius = 0.1\nmass = 0.1\n'
        )
        np.savez(tmp_path / "a.npz", position=np.array([[0.5, 0.0]]))
        write(tmp_path, 'scene = "scene.toml"')
        monkeypatch.chdir(tmp_path)
        sweep = Sweep.load("sweep.toml")
        folder = SweepFolder(tmp_path / "out", sweep.axes, RunSettings())
        folder.create_or_check(sweep, sweep.runs, False)
        folder.write_common_files(sweep)
        content = pickle.dumps((folder, sweep.runs))
        (tmp_path / "a.npz").unlink()
        monkeypatch.chdir("/")
        script = (
            "import pickle, sys\n"
            "from warpgrains.warp_start import start_warp\n"
            "start_warp()\n"
            "from warpgrains.sweep.execution import ExecutionOptions\n"
            "from warpgrains.sweep.runner import finish_runs\n"
            "folder, runs = pickle.load(sys.stdin.buffer)\n"
            "assert finish_runs(folder, runs, ExecutionOptions(), lambda _: None) == {}\n"
        )
        subprocess.run([sys.executable, "-c", script], input=content, check=True, timeout=60)
        assert folder.write_tables(sweep).failed == {}

    def test_recordings(self, tmp_path, done):
        sweep = write(tmp_path)
        assert batch(sweep, "-o", tmp_path / "out", "--usd", "--fps", "50") == 1
        assert results(tmp_path / "out") == results(done)
        recording = tmp_path / "out" / "runs" / "00005" / "recording.usdc"
        assert inspect_recording(recording) == []
        points = lightusd.load(str(recording)).prim_at(GRAINS).attribute("points")
        assert points.timesamples.times == tuple(range(21))
        simulation = Simulation(Scene.load(recording.with_name("scene.toml")))
        simulation.run(steps=40)
        assert np.array_equal(np.asarray(points.get(20))[:, :2], simulation.position.astype(np.float32))

    def test_recordings_of_friction_have_the_rotation(self, tmp_path):
        sweep = write(
            tmp_path, 'scene = "annulus"\n[set]\ntime.duration = 0.8\n[axes]\ncontact.friction = [0.0, 0.5]\n'
        )
        assert batch(sweep, "-o", tmp_path / "out", "--usd", "--fps", "50") == 0
        rolling = Simulation(Scene.load("annulus", ["contact.friction=0.5"]))
        rolling.run(duration=0.8)
        expected = np.zeros(15), rolling.angle
        for run, angle in enumerate(expected):
            recording = tmp_path / "out" / "runs" / f"{run:05}" / "recording.usdc"
            assert inspect_recording(recording) == []
            assert np.array_equal(Recording(recording).angle[-1], angle.astype(np.float32))
        assert rolling.angle.any()
