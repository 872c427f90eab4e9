"""`warpgrains batch --until`: each run ends where it ends alone, also after interruptions."""

import shutil
import warnings

import pytest
from sweeps import batch, scene_of, table, write

from warpgrains import Simulation

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
            simulation = Simulation(scene_of(ended, row))
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # that rest was not met
                summary = simulation.run(until=UNTIL[1])
            assert int(row["met"]) == summary.met
            assert int(row["steps"]) == summary.steps
            assert float(row["time"]) == simulation.time
            assert float(row["iterations_mean"]) == summary.iterations_mean
            assert float(row["worst_overlap"]) == summary.overlap
    # of the failed runs, of some at rest, of those that move still
    assert len({row["steps"] for row in rows}) >= 3


def test_summary_counts_runs_that_move_still(tmp_path, ended, capfd):
    shutil.copytree(ended, tmp_path / "out")
    assert batch(write(tmp_path, SWEEP), "-o", tmp_path / "out", *UNTIL, "--resume") == 1
    unmet = sum(row["met"] == "0" for row in table(ended / "results.csv"))
    assert f"not at rest       {unmet} runs\n" in capfd.readouterr().out
    assert unmet > 0


def test_a_scene_that_the_criterion_does_not_fit_fails(tmp_path):
    axis = "physics.gravity = [[0.0, 0.0], [0.0, -9.81]]"
    text = f'scene = "annulus"\n[set]\ntime.duration = 0.2\n[axes]\n{axis}'
    assert batch(write(tmp_path, text), "-o", tmp_path / "out", "--until", "rest") == 1
    bad, good = table(tmp_path / "out" / "results.csv")
    assert "needs time, and speed or energy, in a scene without gravity" in bad["error"]
    assert (good["error"], good["met"]) == ("", "0")
