"""Speed against error: the report of a small scene, and what is measured for it against closed forms."""

import csv
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest

from warpgrains import InputError, Scene, Simulation
from warpgrains.cli.main import main
from warpgrains.reference.reference import find_c_reference
from warpgrains.report import report
from warpgrains.report.rows import SCHEMES, Budget, Findings, PathRow, fitted_order
from warpgrains.report.steps import HistoryStep, follow_history, measure_steps
from warpgrains.report.trajectories import FRACTIONS, measure_paths
from warpgrains.scene.state import first_state

COLUMN = """
domain = {radius_out = 1.0}
time = {dt = 0.01, duration = 0.3}
grains = {layout = "column", count = 6, radius = 0.05, mass = 0.1, spacing = 2.1}
"""
QUICK = Budget(repeats=1, most_iterations=100, longest=1e9, horizon=8)  # no time decides what is done
FILES = ["report.md", "steps.csv", "trajectories.csv", "frontier.csv", "mine-steps.png", "mine-dt.png"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("report") / "made" / "here"


@pytest.fixture(scope="module")
def found(folder):
    """Write the report of a column with the command, and return what it measured."""
    found, printed = Findings(), StringIO()
    scene = folder.parents[1] / "mine.toml"
    scene.write_text(COLUMN)
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(printed):
        patch.setattr(report, "Budget", lambda: QUICK)
        patch.setattr(report, "Findings", lambda: found)
        assert main(["report", str(scene), "-o", str(folder)]) == 0
    assert printed.getvalue().splitlines() == [str(folder / name) for name in FILES]
    return found


def test_every_file_is_written(found, folder):
    assert sorted(path.name for path in folder.iterdir()) == sorted(FILES)
    text = (folder / "report.md").read_text()
    assert all(name in text for name in FILES[1:])
    lines = [line for line in text.splitlines() if line.startswith("| warpgrains")]
    assert len(lines) == 9
    assert all(" ms |" in line or " after 100 |" in line for line in lines)
    for name, rows in zip(FILES[1:4], (found.steps, found.paths, found.frontier), strict=True):
        read = list(csv.DictReader((folder / name).open()))
        assert list(read[0]) == list(vars(rows[0]))
        assert [row["scene"] for row in read] == ["mine"] * len(rows)
    for name in FILES[4:]:
        assert (folder / name).read_bytes().startswith(b"\x89PNG")


def test_default_report_leaves_friction_out(tmp_path, monkeypatch):
    """Steps with friction have no one exact solution."""
    names: list[str] = []
    monkeypatch.setattr(
        report,
        "write_report",
        lambda scenes, folder, progress: names.extend(one.name for one in scenes) or [],
    )
    assert main(["report", "-o", str(tmp_path)]) == 0
    assert "pile" in names
    assert not {"heap", "couette", "rotating_drum"} & set(names)


def test_warnings_of_its_own_trajectories_are_not_shown(tmp_path, monkeypatch, capfd):
    """These begin at converged steps, where grains overlap as far as the tolerance lets them."""

    def write(scenes, *_, **__):
        state = first_state(scenes[0])
        Simulation(scenes[0].replace(position=0.9 * state.position), dt=1e-3)
        return []

    monkeypatch.setattr(report, "write_report", write)
    assert main(["report", "column", "-o", str(tmp_path)]) == 0
    assert "Warning" not in capfd.readouterr().err


def test_steps_of_the_history_in_every_way(found):
    moments = list(dict.fromkeys((row.moment, row.time) for row in found.steps))
    assert [moment for moment, _ in moments][-2:] == ["hardest", "end"]
    assert [time for _, time in moments] == sorted({time for _, time in moments})
    assert moments[-1][1] == pytest.approx(0.29)
    configurations = {row.configuration for row in found.steps}
    assert len(configurations) == 10
    assert ("warpgrains", "exact", "color", 1) in configurations
    assert ("C reference", "gauss-seidel", "sequential", 1) in configurations
    assert all(row.wall_time > 0.0 for row in found.steps)


def test_error_falls_with_the_iterations(found):
    steps = [row for row in found.steps if row.moment == "hardest"]
    for configuration in {row.configuration for row in steps}:
        measured = [row for row in steps if row.configuration == configuration]
        iterations, errors = [row.iterations for row in measured], [row.error for row in measured]
        # a residual of 1e-12 m/s at each of 6 contacts adds up over the column as forces do, 6 * 6 times
        assert measured[0].error_of_exact <= 2 * 36 * 1e-12
        if configuration.method == "exact":
            assert iterations == sorted(iterations)
            assert errors[-1] <= measured[0].error_of_exact
            continue
        assert iterations == sorted(set(iterations))
        assert errors[0] > 1e-2 * measured[0].error_of_nothing
        # Gauss-Seidel on a chain of 6 contacts from a wall on falls by cos(pi / 13)^2 an iteration, by
        # 3e-3 in 99. Momentum may overshoot, so that not every error is below the one before.
        assert errors[-1] <= 3e-3 * errors[0]


def test_threads_and_c_give_the_same_error(found):
    """The same bits: those of C as far as it goes on where the others stop."""
    errors = {(row.moment, row.configuration, row.iterations): row.error for row in found.steps}
    for (moment, configuration, iterations), error in errors.items():
        change = {"threads": 1} if configuration.code == "warpgrains" else {"code": "warpgrains"}
        other = configuration._replace(**change)
        assert errors.get((moment, other, iterations), error) == error


def test_work_is_equal(found):
    rows = found.frontier
    assert len(rows) == 2 * 3 * len(FRACTIONS)
    for row in rows:
        assert row.iterations == pytest.approx(row.cost * row.dt / 0.01)
        assert row.wall_floor == pytest.approx(rows[0].wall_floor * (row.dt / rows[0].dt) ** 2)
    worst, best = (
        max(row.overlap for row in rows if (row.cost, row.method) == kind)
        for kind in ((16, "gauss-seidel"), (1600, "accelerated"))
    )
    assert best < 1e-3 * worst


def alone(**fields):
    """A grain between walls that are far away."""
    return Scene(**{"position": [[0.5, 0.0]], "radius": 1.0, "mass": 0.1, "radius_out": 90.0} | fields)


def test_scene_without_contacts():
    with pytest.raises(InputError, match="scene 'alone' has no contacts in 5 steps"):
        follow_history(alone(name="alone"), 5)


def test_trajectories_of_free_fall():
    """Symplectic Euler falls by g T dt / 2 too far, the leapfrog as far as it should."""
    scene = alone(dt=0.01)
    rows = list(measure_paths(scene, first_state(scene), 8))
    assert [row.scheme for row in rows] == [scheme for scheme in SCHEMES for _ in FRACTIONS]
    assert [row.dt for row in rows] == [0.01 * fraction for fraction in FRACTIONS] * 2
    rounding = 512 * np.finfo(float).eps  # of so many positions of less than a metre, and velocities
    for row in rows:
        assert row.horizon == pytest.approx(0.08)
        assert row.cpu_time > 0.0
        expected = 0.5 * 9.81 * 0.08 * row.dt if row.scheme == "euler" else 0.0
        assert row.error == pytest.approx(expected, abs=rounding)
        assert row.finest_error <= rounding
    assert fitted_order(rows[: len(FRACTIONS)]) == pytest.approx(1.0, abs=1e-6)


def test_steps_that_are_too_long():
    """One that leaves the circle has no error in the table; one in which drag reverses is left out."""
    fields = {"position": [[0.0, -0.9]], "velocity": [[45.0, 0.0]], "radius": 0.1, "gravity": (0.0, 0.0)}
    scene = alone(**fields, radius_out=1.0, drag=3.0, dt=0.01)
    rows = list(measure_paths(scene, first_state(scene), 4))
    assert [row.dt for row in rows] == [0.01 * fraction for fraction in (*FRACTIONS[1:], *FRACTIONS)]
    assert [np.isnan(row.error) for row in rows[-len(FRACTIONS) :]] == [one == 4.0 for one in FRACTIONS]


@pytest.mark.parametrize("order", [0.5, 1.0, 2.0])
def test_order_of_a_power(order):
    def path(dt, error):
        return PathRow("power", "euler", 1.0, dt, error, 0.0, 1.0)

    rows = [path(dt, 3.0 * dt**order) for dt in (1e-1, 1e-2, 1e-3)]
    for unfit in ([], [path(1e-4, 0.0)], [path(1e-4, np.nan)]):
        assert fitted_order([*rows, *unfit]) == pytest.approx(order, rel=1e-12)
    assert fitted_order([rows[0], path(0.2, 0.0)]) is None


def test_without_a_compiler_there_is_no_c_reference(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    find_c_reference.cache_clear()
    try:
        assert find_c_reference().start is None
        assert "needs a C compiler" in find_c_reference().status
        scene = alone()
        moment = HistoryStep("start", first_state(scene), 0)
        rows = list(measure_steps(scene, moment, replace(QUICK, most_iterations=1)))
        assert {row.code for row in rows} == {"warpgrains"}
    finally:
        find_c_reference.cache_clear()
