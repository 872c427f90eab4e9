"""`warpgrains batch`: every run as if done alone, and the same tables whatever happens on the way."""

import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import lightusd
import numpy as np
import pytest
from recordings import GRAINS
from same_bits import contents
from sweeps import SMALL, batch, table, write

from warpgrains import Scene, Simulation
from warpgrains.batch.batch import Batch
from warpgrains.simulation.checkpoint import read_checkpoint
from warpgrains.sweep import runner as run_groups
from warpgrains.usd.check import inspect_recording

TABLES = ("results.csv", "timing.csv")


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The small sweep, carried out without any interruption."""
    folder = tmp_path_factory.mktemp("done")
    assert batch(write(folder), "-o", folder / "out") == 1
    return folder / "out"


def results(folder):
    return (folder / "results.csv").read_bytes()


class TestResults:
    def test_one_row_a_run(self, done):
        rows = table(done / "results.csv")
        assert [row["run"] for row in rows] == ["0", "1", "2", "3", "4", "5"]
        assert [row["physics.drag"] for row in rows] == ["0.1", "0.1", "100.0", "100.0", "0.5", "0.5"]
        assert [row["grains.count"] for row in rows] == ["5", "15"] * 3
        assert {row["scene"] for row in rows} == {"annulus"}
        assert [list(row) for row in table(done / "timing.csv")] == [["run", "seconds"]] * 6

    def test_files_of_a_run(self, done):
        assert sorted(path.name for path in done.iterdir()) == ["results.csv", "runs", "timing.csv"]
        names = {
            path.name: sorted(file.name for file in path.iterdir()) for path in (done / "runs").iterdir()
        }
        whole, failed = ["checkpoint.npz", "result.csv", "scene.toml"], ["result.csv", "scene.toml"]
        assert names == {f"{k:05}": failed if k in (2, 3) else whole for k in range(6)}

    @pytest.mark.parametrize("number", [0, 5])
    def test_run_is_as_if_done_alone(self, done, number):
        simulation = Simulation(Scene.load(done / "runs" / f"{number:05}" / "scene.toml"))
        reports = [simulation.step() for _ in range(40)]
        kept = read_checkpoint(done / "runs" / f"{number:05}" / "checkpoint.npz")
        assert contents(kept.state) == contents(simulation.state())
        row = table(done / "results.csv")[number]
        force = simulation.wall_contacts().force
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
            assert "in one step, drag 100.0 kg/s would turn round grain 0" in row["error"]
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
        assert batch(write(tmp_path, text), "-o", tmp_path / "out") == 0
        rows = table(tmp_path / "out" / "results.csv")
        assert [(row["grains.file"], row["grains"]) for row in rows] == [("a.npz", "1"), ("b.npz", "2")]
        (tmp_path / "out").rename(tmp_path / "moved")
        for name in places:
            (tmp_path / f"{name}.npz").unlink()
        assert Scene.load(tmp_path / "moved" / "runs" / "00001" / "scene.toml").n == 2

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


class Interrupted(KeyboardInterrupt):
    """What stands for a killed process."""


class Slices:
    """Interrupts the slice after `left` more, as a killed process would be; keeps the steps of those done."""

    def __init__(self):
        self.left, self.steps = 0, []

    def run(self, batch, steps, run=Batch.run):
        if self.left == 0:
            raise Interrupted
        self.left -= 1
        self.steps.append(steps)
        return run(batch, steps)


@pytest.fixture
def slices(monkeypatch):
    """Slices of equal length, after each of which the runs are kept."""
    slices = Slices()
    monkeypatch.setattr(run_groups, "BETWEEN_CHECKPOINTS", 0.0)
    monkeypatch.setattr(run_groups, "GROWTH", 1)
    monkeypatch.setattr(Batch, "run", lambda batch, steps: slices.run(batch, steps))
    return slices


def test_what_failed_once_stays_failed(tmp_path, slices):
    """Even if it could go on later, such as when there is memory again: it has missed steps."""
    run, slices.left = slices.run, 1_000

    def fail_once(batch, steps):
        first, *others = run(batch, steps)
        return [replace(first, error="no room") if len(slices.steps) == 2 else first, *others]

    slices.run = fail_once
    assert batch(write(tmp_path), "-o", tmp_path / "out") == 1
    errors = [row["error"] for row in table(tmp_path / "out" / "results.csv")]
    assert errors[0] == "no room"
    assert errors[1] == ""


class TestResume:
    @pytest.mark.parametrize("options", [[], ["--usd"]])
    def test_same_results_after_interruptions(self, tmp_path, done, slices, options):
        sweep, out = write(tmp_path), tmp_path / "out"
        for number, left in enumerate((4, 3, 1_000)):
            slices.left = left
            assert batch(sweep, "-o", out, *options, *["--resume"] * (number > 0)) == (
                1 if left == 1_000 else 130
            )
        assert sum(slices.steps) == 40  # none of them twice
        assert results(out) == results(done)
        for number in ("00001", "00004"):
            ends = [read_checkpoint(folder / "runs" / number / "checkpoint.npz") for folder in (done, out)]
            assert contents(ends[0].state) == contents(ends[1].state)
            assert not (out / "runs" / number / "recording.usdc.chunks").exists()
            assert (out / "runs" / number / "recording.usdc").exists() == bool(options)

    def test_finished_runs_are_not_repeated(self, tmp_path, done, monkeypatch, capfd):
        shutil.copytree(done, tmp_path / "out")
        shutil.rmtree(tmp_path / "out" / "runs" / "00004")
        before = {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "runs").rglob("*.*")}
        assert batch(write(tmp_path), "-o", tmp_path / "out", "--resume") == 1
        assert "6, 5 of them finished before" in capfd.readouterr().out
        assert all(path.stat().st_mtime_ns == moment for path, moment in before.items())
        assert results(tmp_path / "out") == results(done)

    def test_begun_sweep_needs_resume(self, tmp_path, done, capfd):
        shutil.copytree(done, tmp_path / "out")
        assert batch(write(tmp_path), "-o", tmp_path / "out") == 2
        assert "--resume continues a sweep" in capfd.readouterr().err
        assert results(tmp_path / "out") == results(done)

    def test_other_sweep_is_refused(self, tmp_path, done, capfd):
        shutil.copytree(done, tmp_path / "out")
        other = write(tmp_path, SMALL.replace("[5, 15]", "[5, 14]"))
        assert batch(other, "-o", tmp_path / "out", "--resume") == 2
        assert "is another scene than this run of the sweep" in capfd.readouterr().err

    def test_longer_sweep_goes_on(self, tmp_path, done):
        """Values at the end of the first axis are runs that follow those that are there."""
        shutil.copytree(done, tmp_path / "out")
        longer = write(tmp_path, SMALL.replace("0.5]", "0.5, 0.6]"))
        assert batch(longer, "-o", tmp_path / "out", "--resume") == 1
        assert results(tmp_path / "out").startswith(results(done))
        assert len(table(tmp_path / "out" / "results.csv")) == 8


class TestShares:
    def test_shares_make_the_whole(self, tmp_path, done):
        sweep, out = write(tmp_path), tmp_path / "out"
        codes = [batch(sweep, "-o", out, "--index", index, "--count", 3) for index in (2, 0, 1)]
        assert codes == [1, 1, 0]  # the failed runs are 2 and 3, of the shares 2 and 0
        assert results(out) == results(done)

    def test_late_results_are_not_lost(self, tmp_path, done, monkeypatch):
        """Runs that finish while the tables are written: who writes last has them all."""
        shutil.copytree(done, tmp_path / "out")
        last = tmp_path / "out" / "runs" / "00005" / "result.csv"
        late = last.rename(tmp_path / "late.csv")
        from warpgrains.sweep import folder as sweep_folder

        write_whole = sweep_folder.write_whole

        def write_as_another_run_finishes(*arguments):
            write_whole(*arguments)
            if late.exists():
                late.rename(last)

        monkeypatch.setattr(sweep_folder, "write_whole", write_as_another_run_finishes)
        assert batch(write(tmp_path), "-o", tmp_path / "out", "--resume", "--index", 0, "--count", 6) == 0
        assert results(tmp_path / "out") == results(done)


class TestBadInput:
    @pytest.mark.parametrize(
        ("arguments", "complaint"),
        [
            ([], "SWEEP is missing"),
            (["no_sweep"], "unknown sweep"),
            (["SWEEP", "--index", "0"], "--index and --count go together"),
            (["SWEEP", "--index", "3", "--count", "3"], "--index is 3: it must be between 0 and 2"),
            (["SWEEP", "--count", "0", "--index", "0"], "--count is 0"),
            (["SWEEP", "--fps", "30"], "--fps needs --usd"),
            (["SWEEP", "--usd", "--fps", "-1"], "--fps is -1.0"),
            (["SWEEP", "--device", "gpu"], "device 'gpu' is unknown here"),
            (["SWEEP", "--threads", "0"], "threads is 0"),
            (["SWEEP", "--scheduler", "tcp://127.0.0.1:1", "--slurm", "2"], "not allowed with"),
            (["SWEEP", "--scheduler", "nowhere"], "no dask scheduler answers at 'nowhere'"),
            (["SWEEP", "--slurm", "0"], "--slurm is 0"),
            (["SWEEP", "--slurm", "1"], "--slurm needs dask-jobqueue's configuration, jobqueue.yaml"),
            (["SWEEP", "--plot", "x=physics.drag"], "it must name x and y"),
            (["SWEEP", "--plot", "x=physics.dragg,y=time"], "unknown column to plot 'physics.dragg'"),
        ],
    )
    def test_is_one_line(self, tmp_path, capfd, arguments, complaint):
        sweep = write(tmp_path)
        arguments = [str(sweep) if word == "SWEEP" else word for word in arguments]
        assert batch(*arguments, "-o", tmp_path / "out") == 2
        printed = capfd.readouterr()
        assert printed.out == ""
        assert printed.err.startswith("warpgrains: error: ")
        assert printed.err.count("\n") == 1
        assert complaint in printed.err
        assert not list((tmp_path / "out").rglob("*.*"))

    def test_output_is_a_file(self, tmp_path, capfd):
        sweep = write(tmp_path)
        assert batch(sweep, "-o", sweep) == 1
        assert capfd.readouterr().err.count("\n") == 1


DRIVER = """
import sys
from warpgrains.cli.main import main
from warpgrains.sweep import runner
runner.WIDTH, runner.SLICE, runner.BETWEEN_CHECKPOINTS = 4, 0.02, 0.05
sys.exit(main(sys.argv[1:]))
"""
LONG = """
scene = "annulus"
[set]
solver.order = "color"
[axes]
physics.drag = {range = [0.1, 0.9], count = 3}
grains.shift = {log_range = [1e-9, 1e-6], count = 4}
"""


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("undisturbed")
    assert batch(write(folder, LONG), "-o", folder / "out") == 0
    return folder / "out"


class TestKilled:
    """kill -9 in the middle, then --resume: the same table as without."""

    def kill_and_resume(self, folder, undisturbed, options, moments):
        sweep, out = write(folder, LONG), folder / "out"
        process = self.start(sweep, "-o", out, *options)
        for steps in moments:
            while process.poll() is None and self.steps_kept(out) < steps:
                time.sleep(0.005)
            process.send_signal(signal.SIGKILL)
            process.wait(timeout=60)
            process = self.start(sweep, "-o", out, "--resume", *options)
        assert process.wait(timeout=120) == 0
        assert results(out) == results(undisturbed)
        assert len(table(out / "timing.csv")) == 12

    def start(self, *arguments):
        command = [sys.executable, "-c", DRIVER, "batch", *map(str, arguments)]
        return subprocess.Popen(command, stdout=subprocess.DEVNULL)

    def steps_kept(self, out: Path) -> int:
        kept = (out / "runs").glob("*/checkpoint.npz")
        return sum(read_checkpoint(path).tally.steps for path in kept)

    def test_resumed(self, tmp_path, undisturbed):
        self.kill_and_resume(tmp_path, undisturbed, [], [1_000, 5_000])

    @pytest.mark.slow
    def test_resumed_from_many_moments(self, tmp_path, undisturbed):
        rng = np.random.default_rng(5)
        for number in range(2):
            folder = tmp_path / str(number)
            folder.mkdir()
            moments = sorted(rng.integers(1, 12 * 800, size=rng.integers(1, 4)).tolist())
            self.kill_and_resume(folder, undisturbed, ["--usd"] * (number % 2), moments)
            shutil.rmtree(folder)
