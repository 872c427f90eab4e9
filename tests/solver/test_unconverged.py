"""What a step that has not converged does and tells: reported or raised, in units that mean something."""

import json

import pytest
from same_bits import contents
from sample_scenes import chain

from warpgrains import Disc, Scene, Simulation, SimulationError
from warpgrains.cli.main import main
from warpgrains.scene.fields import METHODS
from warpgrains.simulation import run as machine
from warpgrains.simulation.run import LEAST_TIME, SEARCHES
from warpgrains.solver.statistics import named

WEDGE = """
domain = {radius_in = 0.5, radius_out = 1.0}
time = {dt = 0.01, duration = 0.05}
solver = {max_iterations = 300}
[grains]
layout = "column"
count = 5
radius = 0.0501
mass = 0.1
spacing = 1.996
"""


@pytest.mark.parametrize("method", METHODS)
def test_raising_changes_no_bit_of_what_converges(method):
    scene = Scene.load("polydisperse").replace(method=method, tolerance=1e-3, max_iterations=100_000)
    reporting, raising = Simulation(scene), Simulation(scene, on_unconverged="raise")
    for _ in range(30):
        assert contents(raising.step()) == contents(reporting.step())
    assert contents(raising.state()) == contents(reporting.state())


def test_raising_names_the_grains_that_cannot_fit():
    simulation = Simulation(chain(5, 1e-3), on_unconverged="raise")
    with pytest.raises(
        SimulationError, match=r"grains 0, 1, 2, 3, 4 cannot fit, no velocities below .* m/s separate them"
    ):
        simulation.step()
    assert contents(simulation.position) == contents(simulation.scene.position)


def test_a_summary_is_that_of_its_steps():
    """The velocities solve a step whose gaps are changed by dt * residual, here in smallest radii."""
    scene = Scene.load("polydisperse").replace(max_iterations=20)
    simulation, reports = Simulation(scene), []
    for _ in range(80):
        reports.append(simulation.step())
        assert reports[-1].gap_error == scene.dt * reports[-1].residual / scene.radius.min()
    summary = Simulation(scene).run(steps=80)
    assert summary.residual == max(report.residual for report in reports) > 0.0
    assert summary.gap_error == max(report.gap_error for report in reports)
    assert summary.unconverged == sum(not report.converged for report in reports) > 0
    for name in ("iterations", "rebuilds", "restarts"):
        assert getattr(summary, name) == sum(getattr(report, name) for report in reports)
    assert summary.iterations_max == max(report.iterations for report in reports)
    assert summary.overlap == max(report.overlap for report in reports)


@pytest.mark.parametrize("kept", ["", "kept.npz"])
def test_a_run_warns_once_and_counts(tmp_path, kept):
    """The grains are free before its end, and it says the same whatever it writes."""
    leaving = Disc((0.0, 0.0), 0.5, velocity=(0.0, 1.0), start_time=0.07)
    wedged = chain(5, 1e-3, max_iterations=300).replace(radius_in=0.0, walls=[leaving])
    with pytest.warns(UserWarning, match="grains overlap"):
        simulation = Simulation(wedged)
    with pytest.warns(UserWarning, match=r"^step 1: grains 0, 1, 2, 3, 4 cannot fit$") as said:
        summary = simulation.run(steps=40, **({"checkpoint": tmp_path / kept, "every": 2} if kept else {}))
    assert len(said) == 1
    assert 7 <= summary.unconverged < 40
    assert summary.steps == 40


def test_searches_take_a_small_part_of_the_life_of_a_simulation(monkeypatch):
    """After the first failed step, and when failed steps have taken 20 times as long as the last search."""
    scene = Scene.load("polydisperse").replace(max_iterations=20, tolerance=0.0)
    simulation, searched = Simulation(scene), []
    simulation.advance(60)
    cost = 1000 * SEARCHES * LEAST_TIME * scene.n * scene.max_iterations  # as 50 failed steps
    monkeypatch.setattr(machine, "perf_counter", lambda: cost * len(searched))
    monkeypatch.setattr(Simulation, "infeasible_grains", lambda one: searched.append(one.steps) or ())
    done = [simulation.run(steps=8) for _ in range(500)]
    assert sum(summary.unconverged for summary in done) == 4000
    assert searched[:2] == [61, pytest.approx(1061, abs=1)]
    assert len(searched) == 4


@pytest.mark.filterwarnings("error")
def test_a_run_that_converges_warns_of_nothing():
    assert Simulation("annulus").run(steps=100).unconverged == 0


def test_command_line(tmp_path, capfd):
    scene = tmp_path / "wedge.toml"
    scene.write_text(WEDGE)
    assert main(["run", str(scene)]) == 0
    printed, said = capfd.readouterr()
    assert "warpgrains: warning: step 1: grains 0, 1, 2, 3, 4 cannot fit\n" in said
    rows = {line[:17].strip(): line[18:] for line in printed.splitlines()}
    assert rows["not converged"] == "5 steps"
    # Five overlaps share 0.5 * 0.004 radii and the walls' share of the last: the residual is their mean / dt.
    assert rows["worst residual"].endswith(" smallest radii a step)")
    assert main(["run", str(scene), "--json"]) == 0
    results = json.loads(capfd.readouterr().out)
    assert results["gap_error"] == pytest.approx(results["residual"] * 0.01 / 0.0501, rel=1e-15)
    assert main(["run", str(scene), "--set", "solver.on_unconverged=raise"]) == 1
    assert "step 1, from t = 0.0 s: not converged after 300 iterations" in capfd.readouterr().err
    assert main(["run", str(scene), "--set", "solver.on_unconverged=shout"]) == 2
    assert "unknown solver.on_unconverged 'shout'" in capfd.readouterr().err


def test_many_grains_are_named_by_the_first():
    assert named(tuple(range(10))) == "grains 0, 1, 2, 3, 4, 5, 6, 7, 8, 9"
    assert named(tuple(range(3, 15))) == "grains 3, 4, 5, 6, 7, 8, 9, 10, 11, 12 and 2 more"
