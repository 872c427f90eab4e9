"""`warpgrains batch --resume`: after kill -9, after failures, in a longer sweep, beside other processes."""

import shutil
import signal
import subprocess
import sys
import time

import pytest
from sweeps import LONG, SMALL, batch, results, rows, table, write

from warpgrains import Scene
from warpgrains.simulation.checkpoint import read_checkpoint
from warpgrains.sweep import sweep_folder
from warpgrains.sweep.run_folder import FolderRun
from warpgrains.sweep.sweep_folder import SweepFolder

LONGER = LONG.replace("[axes]", "time.duration = 40.0\n[axes]")
DRIVER = """
import sys
from warpgrains.cli.main import main
from warpgrains.solver import engine, threads
from warpgrains.sweep import runner
engine.BRIEF, threads.GLANCE = 0, 1e-3
runner.LIMIT = 0.1 * (5 if "--usd" in sys.argv else 1)
runner.LEAST_WIDTH = runner.WIDTH = runner.WIDTH_OF_FOLDERS = 4
sys.exit(main(sys.argv[1:]))
"""


def steps_kept(out):
    return sum(read_checkpoint(path).statistics.steps for path in out.glob("runs/*/checkpoint.npz"))


@pytest.mark.parametrize(
    ("options", "moments"),
    [
        ([], [3_000]),
        pytest.param(["--measure", "packing", "--every", "100"], [700, 4_000, 9_000], marks=pytest.mark.slow),
        pytest.param(["--usd"], [50, 3_000, 8_000], marks=pytest.mark.slow),
    ],
)
def test_killed(tmp_path, options, moments):
    sweep, out = write(tmp_path, LONG), tmp_path / "out"
    assert batch(sweep, "-o", tmp_path / "undisturbed") == 0
    command = [sys.executable, "-c", DRIVER, "batch", str(sweep), "-o", str(out), "--resume", *options]
    for moment in moments:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        while process.poll() is None and steps_kept(out) < moment:
            time.sleep(0.001)
        process.send_signal(signal.SIGKILL)
        process.wait(timeout=60)
    assert subprocess.run(command, stdout=subprocess.DEVNULL, timeout=120).returncode == 0
    assert results(out) == results(tmp_path / "undisturbed")
    assert len(table(out / "timing.csv")) == 12
    for series in out.glob("runs/*/series.csv"):
        assert [int(row["step"]) for row in table(series)] == list(range(0, 801, 100))


@pytest.mark.parametrize("options", [[], ["--until", "rest,speed=0.05,time=0.35"]])
def test_run_that_takes_long_gets_a_folder(tmp_path, brief, monkeypatch, options):
    """It goes on from where it is when the time is over, even if the process is killed then."""
    sweep, out = write(tmp_path, LONGER), tmp_path / "out"
    brief.is_killed = True
    assert batch(sweep, "-o", out, *options) == 130
    first = steps_kept(out)
    brief.is_killed = False
    assert batch(sweep, "-o", out, *options, "--resume") == 0
    kept = read_checkpoint(out / "runs" / "00000" / "checkpoint.npz")
    assert str(kept.statistics.steps) == rows(out)[0]["steps"]
    assert 0 < first < steps_kept(out)
    monkeypatch.undo()
    assert batch(sweep, "-o", tmp_path / "short", *options) == 0
    assert not (tmp_path / "short" / "runs").exists()
    assert results(out) == results(tmp_path / "short")


@pytest.mark.parametrize("options", [[], ["--folders"]])
def test_a_run_whose_extra_is_missing_is_left_to_another_machine(tmp_path, monkeypatch, capfd, options):
    sweep = write(tmp_path, SMALL.replace("[axes]", '[axes]\nsolver.method = ["gauss-seidel", "exact"]'))
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "warpgrains.solver.exact.convex", None)
        assert batch(sweep, "-o", tmp_path / "out", *options) == 1
    said = capfd.readouterr().out
    assert "not finished      4 (continue with --resume), first run 6: method 'exact' needs" in said
    assert len(rows(tmp_path / "out")) == 8
    assert batch(sweep, "-o", tmp_path / "out", "--resume", *options) == 1  # two have too much drag
    assert len(rows(tmp_path / "out")) == 12


def test_results_next_to_scenes_are_no_scenes(tmp_path):
    """A folder of scenes may be its own output."""
    for name in "ab":
        (tmp_path / f"{name}.toml").write_text(Scene.load("annulus", ["time.duration=0.1"]).text)
    for again in ([], ["--resume"]):
        assert batch(tmp_path, "-o", tmp_path, *again) == 0
        assert [row["scene"] for row in rows(tmp_path)] == ["a", "b"]


def test_a_folder_that_cannot_be_used_leaves_its_run_alone(tmp_path, brief, monkeypatch, capfd):
    sweep, out = write(tmp_path, LONGER), tmp_path / "out"
    open_folder = FolderRun.open

    def open_others(folder, *given):
        if folder.name == "00000":
            raise OSError("permission denied")
        return open_folder(folder, *given)

    monkeypatch.setattr(FolderRun, "open", open_others)
    assert batch(sweep, "-o", out) == 1
    said = "not finished      1 (continue with --resume), first run 0: permission denied\n"
    assert said in capfd.readouterr().out
    assert [row["run"] for row in rows(out)] == [str(k) for k in range(1, 12)]


def test_a_folder_that_another_process_has_begun_is_left(tmp_path, brief, monkeypatch, capfd):
    """On a file system without locks, after this process has begun the run without a folder."""
    sweep, out = write(tmp_path, LONGER), tmp_path / "out"
    brief.is_killed = True
    assert batch(sweep, "-o", out) == 130
    brief.is_killed = False
    monkeypatch.setattr(SweepFolder, "with_folders", lambda folder: set())
    assert batch(sweep, "-o", out, "--resume") == 1
    assert "another process has begun it\n" in capfd.readouterr().out


def test_warp_is_not_started_if_no_run_is_left(tmp_path):
    sweep, out = write(tmp_path, 'scene = "annulus"\nset.time.duration = 0.1'), tmp_path / "out"
    assert batch(sweep, "-o", out) == 0
    before = results(out)
    script = (
        "import sys\n"
        "from warpgrains.cli.main import main\n"
        "assert main(sys.argv[1:]) == 0\n"
        "assert 'warp' not in sys.modules\n"
    )
    arguments = ["batch", sweep, "-o", out, "--resume"]
    subprocess.run([sys.executable, "-c", script, *arguments], check=True, timeout=60)
    assert results(out) == before


def test_longer_sweep_goes_on(tmp_path, done):
    """Values at the end of the first axis are runs that follow those that are there."""
    shutil.copytree(done, tmp_path / "out")
    longer = write(tmp_path, SMALL.replace("0.5]", "0.5, 0.6]"))
    assert batch(longer, "-o", tmp_path / "out", "--resume") == 1
    assert results(tmp_path / "out").startswith(results(done))
    assert len(rows(tmp_path / "out")) == 8


def test_late_results_are_not_lost(tmp_path, done, monkeypatch):
    """Runs that finish while the tables are written: who writes last has them all."""
    shutil.copytree(done, tmp_path / "out")
    (shard,) = (tmp_path / "out").glob("parts/[0-9]*.csv")
    late, write_atomically = shard.rename(tmp_path / "late.csv"), sweep_folder.write_atomically

    def write_as_another_run_finishes(*arguments):
        write_atomically(*arguments)
        if late.exists():
            late.rename(shard)

    monkeypatch.setattr(sweep_folder, "write_atomically", write_as_another_run_finishes)
    assert batch(write(tmp_path), "-o", tmp_path / "out", "--resume", "--index", 0, "--count", 6) == 0
    assert results(tmp_path / "out") == results(done)


UNRECORDABLE = """
[domain]
radius_out = 2.0
[grains]
position = [[0.1, 0.5]]
radius = 0.1
mass = 0.1
[time]
dt = 1e-40
duration = 4e-39
[solver]
tolerance = 1e30
"""


def test_a_run_whose_frame_cannot_be_recorded_is_resumed_to_the_same_failure(tmp_path):
    """Its velocity exceeds float32 after some frames; a checkpoint must not count the missing one."""
    (tmp_path / "scene.toml").write_text(UNRECORDABLE)
    axes = "[axes]\nphysics.gravity = [[0.0, -2e77], [0.0, 0.0]]\n"
    sweep, out = write(tmp_path, f'scene = "scene.toml"\n{axes}'), tmp_path / "out"
    options = ("-o", out, "--usd", "--fps", "5e38")
    assert batch(sweep, *options) == 1
    first = results(out)
    assert b"a recording holds at most" in first
    assert batch(sweep, *options, "--resume") == 1
    assert results(out) == first
    assert not list(out.rglob("*.frames"))
