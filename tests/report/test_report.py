"""Speed against error: the report of a small scene, and what is measured for it against closed forms."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from warpgrains import InputError, Scene
from warpgrains.cli.main import main
from warpgrains.reference.reference import find_c_reference
from warpgrains.report import report
from warpgrains.report.report import markdown
from warpgrains.report.rows import SCHEMES, Budget, Findings, PathRow, fitted_order
from warpgrains.report.steps import HistoryStep, follow_history, measure_steps
from warpgrains.report.trajectories import FRACTIONS, measure_frontier, measure_paths
from warpgrains.scene.state import first_state

COLUMN = """
domain = {radius_out = 1.0}
time = {dt = 0.01, duration = 0.3}
grains = {layout = "column", count = 6, radius = 0.05, mass = 0.1, spacing = 2.1}
"""
QUICK = Budget(repeats=1, most_iterations=100, longest=1e9, horizon=8)  # no time decides what is done
FILES = ["report.md", "steps.csv", "trajectories.csv", "frontier.csv", "mine-steps.png", "mine-dt.png"]
STEP_COLUMNS = (
    "scene,moment,time,grains,contacts,code,method,order,threads,iterations,wall_time,error,"
    "error_of_exact,error_of_nothing"
)


@pytest.fixture
def toml(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(COLUMN)
    return path


@pytest.fixture(scope="module")
def column(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "mine.toml"
    path.write_text(COLUMN)
    return Scene.load(path)


@pytest.fixture(scope="module")
def steps(column):
    (hardest,) = (snapshot for snapshot in follow_history(column, 30).snapshots if snapshot.name == "hardest")
    return list(measure_steps(column, hardest, QUICK))


def test_command_writes_every_file(toml, tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(report, "Budget", lambda: replace(QUICK, most_iterations=3, horizon=4))
    folder = tmp_path / "made" / "here"
    assert main(["report", str(toml), "-o", str(folder)]) == 0
    printed, _ = capfd.readouterr()
    assert printed.splitlines() == [str(folder / name) for name in FILES]
    assert sorted(path.name for path in folder.iterdir()) == sorted(FILES)
    text = (folder / "report.md").read_text()
    for name in FILES[1:]:
        assert name in text
    assert (folder / "steps.csv").read_text().splitlines()[0] == STEP_COLUMNS
    for name in FILES[1:4]:
        rows = list(csv.DictReader((folder / name).open()))
        assert {row["scene"] for row in rows} == {"mine"}
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


def path(dt, error):
    return PathRow("power", "text", 1.0, dt, error, 0.0, 1.0)


class TestSteps:
    def test_every_way_is_there(self, steps):
        configurations = {row.configuration for row in steps}
        assert len(configurations) == 10
        assert ("warpgrains", "exact", "color", 1) in configurations
        assert ("C reference", "gauss-seidel", "sequential", 1) in configurations
        assert all(row.wall_time > 0.0 for row in steps)

    def test_error_falls_with_the_iterations(self, steps):
        for configuration in {row.configuration for row in steps}:
            measured = [row for row in steps if row.configuration == configuration]
            iterations, errors = [row.iterations for row in measured], [row.error for row in measured]
            if configuration.method == "exact":
                assert iterations == sorted(iterations)
                assert errors[-1] <= measured[0].error_of_exact
                continue
            assert iterations == sorted(set(iterations))
            assert errors[0] > 1e-2 * measured[0].error_of_nothing
            # Gauss-Seidel on a chain of 6 contacts from a wall on falls by cos(pi / 13)^2 an iteration, by
            # 3e-3 in 99. Momentum may overshoot, so that not every error is below the one before.
            assert errors[-1] <= 3e-3 * errors[0]

    def test_threads_and_c_give_the_same_error(self, steps):
        """The same bits: those of C as far as it goes on where the others stop."""
        errors = {(row.configuration, row.iterations): row.error for row in steps}
        for (configuration, iterations), error in errors.items():
            change = {"threads": 1} if configuration.code == "warpgrains" else {"code": "warpgrains"}
            other = configuration._replace(**change)
            assert errors.get((other, iterations), error) == error

    def test_exact_solution_is_that_of_the_exact_method(self, steps):
        """A residual of 1e-12 m/s at each of 6 contacts adds up over the column as forces do, 6 * 6 times."""
        assert steps[0].error_of_exact <= 2 * 36 * 1e-12

    def test_table_tells_how_far_each_way_came(self, steps, column):
        paths = list(measure_paths(column, first_state(column), 4))
        frontier = list(measure_frontier(column, first_state(column), 4))
        text = markdown(Findings(steps, paths, frontier), QUICK)
        lines = [line for line in text.splitlines() if line.startswith("| warpgrains")]
        assert len(lines) == 9
        assert all(" ms |" in line or " after 100 |" in line for line in lines)


class TestMoments:
    def test_moments_are_in_order(self, column):
        history = follow_history(column, 30)
        names = [snapshot.name for snapshot in history.snapshots]
        at = [snapshot.state.steps for snapshot in history.snapshots]
        assert names[-1] == "end"
        assert "hardest" in names
        assert at == sorted(set(at))
        assert at[-1] == 29
        assert history.first.steps <= at[0]

    def test_scene_without_contacts(self):
        scene = Scene(position=[[0.5, 0.0]], radius=0.1, mass=0.1, radius_out=9.0, name="alone")
        with pytest.raises(InputError, match="scene 'alone' has no contacts in 5 steps"):
            follow_history(scene, 5)


class TestTrajectories:
    def test_free_fall(self):
        """Symplectic Euler falls by g T dt / 2 too far, the leapfrog as far as it should."""
        g = 9.81
        scene = Scene(position=[[0.5, 0.0]], radius=1.0, mass=0.1, radius_out=90.0, dt=0.01)
        rows = list(measure_paths(scene, first_state(scene), 32))
        assert [row.scheme for row in rows] == [scheme for scheme in SCHEMES for _ in FRACTIONS]
        assert [row.dt for row in rows] == [0.01 * fraction for fraction in FRACTIONS] * 2
        # 2048 steps round positions of less than a metre, and as many velocities.
        rounding = 2048 * np.finfo(float).eps
        for row in rows:
            assert row.horizon == pytest.approx(0.32)
            assert row.cpu_time > 0.0
            expected = 0.5 * g * 0.32 * row.dt if row.scheme == "text" else 0.0
            assert row.error == pytest.approx(expected, abs=rounding)
            assert row.finest_error <= rounding
        assert fitted_order(rows[: len(FRACTIONS)]) == pytest.approx(1.0, abs=1e-6)

    @pytest.mark.parametrize("order", [0.5, 1.0, 2.0])
    def test_order_of_a_power(self, order):
        rows = [path(dt, 3.0 * dt**order) for dt in (1e-1, 1e-2, 1e-3)]
        assert fitted_order(rows) == pytest.approx(order, rel=1e-12)
        for unfit in (0.0, np.nan):
            assert fitted_order([*rows, path(1e-4, unfit)]) == pytest.approx(order, rel=1e-12)
        assert fitted_order([rows[0], path(0.2, 0.0)]) is None

    def test_a_step_that_leaves_the_circle(self):
        """It has no error in the table, and the others have."""
        scene = Scene(
            position=[[0.0, -0.9]],
            velocity=[[30.0, 0.0]],
            radius=0.1,
            mass=1.0,
            radius_out=1.0,
            gravity=(0.0, 0.0),
            dt=0.01,
        )
        rows = [row for row in measure_paths(scene, first_state(scene), 4) if row.scheme != "text"]
        assert [np.isnan(row.error) for row in rows] == [fraction == 4.0 for fraction in FRACTIONS]

    def test_drag_limits_the_longest_step(self):
        scene = Scene(position=[[0.5, 0.0]], radius=1.0, mass=0.1, radius_out=9.0, dt=0.01, drag=3.0)
        rows = list(measure_paths(scene, first_state(scene), 4))
        assert [row.dt for row in rows] == [0.01 * fraction for fraction in (*FRACTIONS[1:], *FRACTIONS)]


class TestFrontier:
    def test_work_is_equal(self, column):
        rows = list(measure_frontier(column, follow_history(column, 30).hardest, 8))
        assert len(rows) == 2 * 3 * len(FRACTIONS)
        for row in rows:
            assert row.iterations == pytest.approx(row.cost * row.dt / column.dt)
            assert row.wall_floor == pytest.approx(rows[0].wall_floor * (row.dt / rows[0].dt) ** 2)
        worst, best = (
            max(row.overlap for row in rows if (row.cost, row.method) == kind)
            for kind in ((16, "gauss-seidel"), (1600, "accelerated"))
        )
        assert best < 1e-3 * worst


def test_without_a_compiler_there_is_no_c_reference(column, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    find_c_reference.cache_clear()
    try:
        assert find_c_reference().start is None
        assert "needs a C compiler" in find_c_reference().status
        snapshot = HistoryStep("start", first_state(column), 0)
        rows = list(measure_steps(column, snapshot, Budget(repeats=1, most_iterations=1)))
        assert {row.code for row in rows} == {"warpgrains"}
    finally:
        find_c_reference.cache_clear()
