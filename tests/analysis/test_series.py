"""Series: what is measured while a run goes is what is measured by hand, resumed or not."""

import csv

import numpy as np
import pytest
from command import exit_code, require_refusal

from warpgrains import Scene, Simulation, analysis

EPS = np.finfo(np.float64).eps


def rows(path):
    with path.open() as lines:
        return [{name: float(cell) for name, cell in row.items()} for row in csv.DictReader(lines)]


def test_rows_are_what_is_measured_by_hand(tmp_path):
    path, simulation = tmp_path / "run.csv", Simulation(Scene.load("annulus"))
    with analysis.Series("energy,coordination", every=7, path=path) as series:
        simulation.run(steps=50, observer=series)
    other = Simulation(Scene.load("annulus"))
    for row in rows(path):
        other.run(steps=int(row["step"]) - other.steps) if row["step"] else None
        assert row["time"] == other.time
        assert {name: row[name] for name in series.names} == analysis.quantities(other, series.names)
    assert [row["step"] for row in series.rows] == [0, 7, 14, 21, 28, 35, 42, 49]
    assert rows(path) == series.rows


def test_in_memory_over_two_runs():
    simulation, series = Simulation(Scene.load("annulus")), analysis.Series(["largest_speed"], every=10)
    for _ in range(2):
        simulation.run(steps=15, observer=series)
    assert [row["step"] for row in series.rows] == [0, 10, 20, 30]


def test_looking_changes_nothing():
    alone, watched = (Simulation(Scene.load("annulus")) for _ in range(2))
    alone.run(steps=90)
    watched.run(steps=90, observer=analysis.Series("stress,packing", every=3))
    assert (alone.position == watched.position).all()


def test_a_resumed_run_ends_with_the_same_bytes(tmp_path):
    options = ("--measure", "energy,stress", "--every", 20)
    whole, parts = tmp_path / "whole.csv", tmp_path / "parts.csv"
    assert exit_code("run", "annulus", "--steps", 150, "--series", whole, *options) == 0
    kept = tmp_path / "kept.npz"
    parts_options = ("--series", parts, "--checkpoint", kept, *options)
    assert exit_code("run", "annulus", "--steps", 90, *parts_options) == 0
    # rows beyond the checkpoint, as a killed run leaves them
    parts.write_text(parts.read_text() + parts.read_text().splitlines()[-1].replace("80,", "100,", 1) + "\n")
    assert exit_code("run", "--resume", kept, "--steps", 150) == 0
    assert parts.read_bytes() == whole.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kept.npz", "parts.csv", "whole.csv"]


def test_means_are_those_of_all_steps():
    simulation = Simulation(Scene.load("annulus"))
    every_step, means = analysis.Series("walls,energy", 1), analysis.Series("walls,energy", 20, mean=True)
    simulation.run(steps=35, observer=means)
    simulation.run(steps=30, observer=means)
    Simulation(Scene.load("annulus")).run(steps=65, observer=every_step)
    assert [row["step"] for row in means.rows] == [20, 40, 60]
    for row in means.rows:
        of_interval = every_step.rows[row["step"] - 19 : row["step"] + 1]
        for name in means.names:
            samples = np.array([one[name] for one in of_interval])
            # each of 20 updates rounds once
            assert row[name] == pytest.approx(samples.mean(), abs=20 * EPS * np.abs(samples).max())
    assert len(means.means) == len(means.names)  # of steps 61 to 65


@pytest.mark.parametrize("until", [47, 60])
def test_resumed_means_are_those_of_a_whole_run(tmp_path, until):
    whole, parts, kept = (tmp_path / name for name in ("whole.csv", "parts.csv", "kept.npz"))
    options = ("--measure", "stress,packing", "--mean", "--region", "y = [-2.0, 1.0]", "--every", 20)
    assert exit_code("run", "annulus", "--steps", 90, "--series", whole, *options) == 0
    assert (
        exit_code("run", "annulus", "--steps", until, "--series", parts, "--checkpoint", kept, *options) == 0
    )
    assert exit_code("run", "--resume", kept, "--steps", 90) == 0
    assert parts.read_bytes() == whole.read_bytes()
    assert [row["step"] for row in rows(whole)] == [20, 40, 60, 80]
    found = rows(whole)[-1]["packing_fraction"]
    assert 0.0 < found < 1.0


def test_a_sweep_with_means(tmp_path):
    sweep = tmp_path / "sweep.toml"
    sweep.write_text('scene = "annulus"\n[set]\ntime.duration = 0.5\n[axes]\nphysics.drag = [0.1, 0.2]\n')
    options = ("--measure", "walls", "--every", 25, "--mean")
    assert exit_code("batch", sweep, "-o", tmp_path / "out", *options) == 0
    series = analysis.Series("walls", 25, mean=True)
    Simulation(Scene.load("annulus", "physics.drag=0.2")).run(steps=50, observer=series)
    assert rows(tmp_path / "out" / "runs" / "00001" / "series.csv") == series.rows


def test_a_series_that_is_gone_is_not_continued(tmp_path, capfd):
    kept, path = tmp_path / "kept.npz", tmp_path / "run.csv"
    begun = ("run", "annulus", "--steps", 40, "--measure", "walls", "--series", path, "--checkpoint", kept)
    assert exit_code(*begun) == 0
    capfd.readouterr()
    path.unlink()
    assert exit_code("run", "--resume", kept, "--steps", 50) == 2
    require_refusal(capfd, "lacks rows before step 40")
