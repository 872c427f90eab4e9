"""`warpgrains batch --until`: each run ends where it ends alone, also after interruptions."""

import pickle
import shutil
import warnings

import pytest
from command import exit_code
from same_bits import contents
from sweeps import batch, results, table, write

from warpgrains import Scene, Simulation
from warpgrains.simulation.checkpoint import read_checkpoint
from warpgrains.solver import engine, threads
from warpgrains.sweep import short
from warpgrains.sweep.folder import SweepFolder
from warpgrains.sweep.results import Columns

SWEEP = """
scene = "annulus"
[set]
time.duration = 4.0
[axes]
physics.drag = [0.5, 100.0, 2.0]
grains.count = [1, 5, 15]
"""
"""Nine runs of 400 steps at most; three have too much drag to be a scene."""

UNTIL = ("--until", "rest,speed=0.05,time=0.35")


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    """The sweep, carried out without any interruption."""
    folder = tmp_path_factory.mktemp("ended")
    assert batch(write(folder, SWEEP), "-o", folder / "out", *UNTIL) == 1
    return folder / "out"


def test_columns_are_those_of_runs_alone(ended):
    rows = table(ended / "results.csv")
    assert {row["met"] for row in rows} == {"", "0", "1"}  # that of failed runs is empty
    for row in rows:
        if not row["error"]:
            overrides = [f"{key}={row[key]}" for key in ("physics.drag", "grains.count")]
            simulation = Simulation(Scene.load(ended / "scenes" / "annulus.toml", overrides))
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # that rest was not met
                summary = simulation.run(until=UNTIL[1])
            assert int(row["met"]) == summary.met
            assert int(row["steps"]) == summary.steps
            assert float(row["time"]) == simulation.time
            assert float(row["iterations_mean"]) == summary.iterations_mean
            assert float(row["worst_overlap"]) == summary.overlap
    assert (
        len({row["steps"] for row in rows}) >= 3
    )  # of the failed runs, of some at rest, of those that move still


def test_summary_counts_runs_that_move_still(tmp_path, ended, capfd):
    shutil.copytree(ended, tmp_path / "out")
    assert batch(write(tmp_path, SWEEP), "-o", tmp_path / "out", *UNTIL, "--resume") == 1
    unmet = sum(row["met"] == "0" for row in table(ended / "results.csv"))
    assert f"not at rest       {unmet} runs\n" in capfd.readouterr().out
    assert unmet > 0


@pytest.mark.parametrize("options", [["--folders"], ["--usd"], ["--measure", "packing", "--every", "7"]])
def test_same_results_after_interruptions(tmp_path, ended, slices, options):
    sweep, out = write(tmp_path, SWEEP), tmp_path / "out"
    for number, left in enumerate((4, 9, 1_000)):
        slices.left = left
        resume = ["--resume"] * (number > 0)
        assert batch(sweep, "-o", out, *UNTIL, *options, *resume) == (1 if left == 1_000 else 130)
    assert results(out) == results(ended)
    for row in table(out / "results.csv"):
        if not row["error"]:
            folder = out / "runs" / f"{int(row['run']):05}"
            simulation = Simulation(Scene.load(folder / "scene.toml"))
            simulation.run(steps=int(row["steps"]))
            kept = read_checkpoint(folder / "checkpoint.npz")
            assert contents(kept.state) == contents(simulation.state())
            assert kept.options.until == UNTIL[1]


def test_a_run_that_takes_long_goes_on_in_a_folder(tmp_path, ended, monkeypatch):
    """From where it is when the time is over."""
    monkeypatch.setattr(short, "SHORT", 0.0)
    monkeypatch.setattr(engine, "BRIEF", 0)
    monkeypatch.setattr(threads, "GLANCE", 1e-3)
    out = tmp_path / "out"
    assert batch(write(tmp_path, SWEEP), "-o", out, *UNTIL) == 1
    assert results(out) == results(ended)
    assert (out / "runs" / "00000" / "checkpoint.npz").exists()


def test_a_run_is_resumed_by_hand_to_the_same_end(tmp_path, ended, slices):
    out, slices.left = tmp_path / "out", 9
    assert batch(write(tmp_path, SWEEP), "-o", out, *UNTIL, "--folders") == 130
    checkpoint = out / "runs" / "00007" / "checkpoint.npz"
    assert exit_code("run", "--resume", checkpoint) == 0
    assert read_checkpoint(checkpoint).statistics.steps == int(table(ended / "results.csv")[7]["steps"])
    slices.left = 1_000
    assert batch(write(tmp_path, SWEEP), "-o", out, *UNTIL, "--resume") == 1
    assert results(out) == results(ended)


def test_shares_make_the_whole(tmp_path, ended):
    for index in range(2):
        batch(write(tmp_path, SWEEP), "-o", tmp_path / "out", *UNTIL, "--index", index, "--count", 2)
    assert results(tmp_path / "out") == results(ended)


@pytest.mark.parametrize("options", [[], ["--until", "rest"]])
def test_another_end_is_refused(tmp_path, ended, options, capfd):
    shutil.copytree(ended, tmp_path / "out")
    assert batch(write(tmp_path, SWEEP), "-o", tmp_path / "out", "--resume", *options) == 2
    assert "has another --until: choose another -o" in capfd.readouterr().err
    assert results(tmp_path / "out") == results(ended)


def test_bad_criterion_is_one_line(tmp_path, capfd):
    assert batch(write(tmp_path, SWEEP), "-o", tmp_path / "out", "--until", "rst") == 2
    said = capfd.readouterr().err
    assert "did you mean 'rest'" in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_scene_that_the_criterion_does_not_fit_fails(tmp_path):
    text = (
        'scene = "annulus"\n[set]\ntime.duration = 0.2\n[axes]\nphysics.gravity = [[0.0, 0.0], [0.0, -9.81]]'
    )
    assert batch(write(tmp_path, text), "-o", tmp_path / "out", "--until", "rest") == 1
    bad, good = table(tmp_path / "out" / "results.csv")
    assert "needs time, and speed or energy, where there is no gravity" in bad["error"]
    assert (good["error"], good["met"]) == ("", "0")


def test_other_processes_know_what_ends_runs(tmp_path):
    folder = pickle.loads(
        pickle.dumps(SweepFolder(tmp_path, Columns(("physics.drag",), ("rattlers",), "rest")))
    )
    assert folder.columns.until == "rest"
    assert "met" in folder.columns.all
