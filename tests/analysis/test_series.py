"""Series: what is measured while a run goes is what is measured by hand, resumed or not."""

import csv

import pytest
from command import exit_code, require_refusal

from warpgrains import Scene, Simulation, analysis
from warpgrains.errors import InputError, OutputError
from warpgrains.simulation.options import RunOptions
from warpgrains.simulation.run import OpenRun
from warpgrains.solver.statistics import RunStatistics


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


def test_a_run_has_one_observer():
    options = RunOptions(steps=1, measure="energy", series="run.csv")
    with pytest.raises(InputError, match="observer and measure cannot be combined"):
        OpenRun(Scene.load("annulus"), options, RunStatistics(), observer=analysis.Series("energy", every=1))


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


def test_what_a_scene_cannot_have_is_refused_before_the_first_step(tmp_path, capfd):
    pressed = ("annulus", "--set", "domain.pressure=10.0")
    series = ("--measure", "walls,energy", "--series", tmp_path / "run.csv")
    assert exit_code("run", *pressed, *series, "-o", tmp_path / "run.usdc") == 2
    require_refusal(capfd, "contact_power cannot be computed where a pressure or a force drives a wall")
    assert not list(tmp_path.iterdir())
    simulation = Simulation(Scene.load("annulus", ["domain.pressure=10.0"]))
    with pytest.raises(InputError, match="the energy balance of a step cannot be computed"):
        simulation.run(observer=analysis.Series("energy"))
    assert simulation.steps == 0


def test_a_series_that_is_gone_is_not_continued(tmp_path, capfd):
    kept, path = tmp_path / "kept.npz", tmp_path / "run.csv"
    begun = ("run", "annulus", "--steps", 40, "--measure", "walls", "--series", path, "--checkpoint", kept)
    assert exit_code(*begun) == 0
    capfd.readouterr()
    path.unlink()
    assert exit_code("run", "--resume", kept, "--steps", 50) == 2
    require_refusal(capfd, "lacks rows before step 40")


def test_nothing_else_is_replaced(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text("x,y\n1,2\n")
    with pytest.raises(OutputError, match="not a series"):
        analysis.Series("energy", path=path)
    assert path.read_text() == "x,y\n1,2\n"
    assert list(tmp_path.iterdir()) == [path]


def test_two_do_not_write_one_file(tmp_path):
    with analysis.Series("energy", path=tmp_path / "run.csv"), pytest.raises(OutputError):
        analysis.Series("energy", path=tmp_path / "run.csv")
    with pytest.raises(InputError, match="every is 0"):
        analysis.Series("energy", every=0)
