"""`warpgrains batch --measure`: columns of results and series of runs are what is measured by hand."""

import pytest
from command import exit_code
from matplotlib.axes import Axes
from sweeps import batch, results, scene_of, table, write

from warpgrains import Scene, Simulation, analysis
from warpgrains.sweep.plot import SweepPlot

MEASURED = ("--measure", "energy,coordination,largest_force")
NEW = ["contact_power", "drag_power", "coordination_number", "rattlers", "largest_force"]


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """The small sweep, with more columns."""
    folder = tmp_path_factory.mktemp("measured")
    assert batch(write(folder), "-o", folder / "out", *MEASURED) == 1
    return folder / "out"


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    """The same, with a series for each run."""
    folder = tmp_path_factory.mktemp("followed")
    assert batch(write(folder), "-o", folder / "out", *MEASURED, "--every", 9) == 1
    return folder / "out"


def test_columns_are_the_ends(measured, done):
    """Beside those that are there without."""
    rows, others = table(measured / "results.csv"), table(done / "results.csv")
    assert list(rows[0]) == [*list(others[0])[:-1], *NEW, "error"]
    assert [{name: row[name] for name in others[0]} for row in rows] == others
    for row in rows:
        if not row["error"]:
            simulation = Simulation(scene_of(measured, row))
            simulation.run()
            found = analysis.quantities(simulation, NEW)
            assert [row[name] for name in NEW] == list(map(repr, found.values()))
    assert not (measured / "runs" / "00000").exists()


def test_same_results_with_folders(measured, followed):
    assert results(measured) == results(followed)


def test_openings_of_a_hopper(tmp_path):
    """Short runs share scenes with the same grains: those of another opening are other ones."""
    text = """scene = "hopper"
        set.walls.0.to = ["-0.5 $opening", -0.1]
        set.walls.1.to = ["0.5 $opening", -0.1]
        set.grains.count = 40
        set.time.duration = 0.6
        axes.opening = [0.05, 0.8]
        axes.contact.friction = [0.2, 0.4]"""
    assert batch(write(tmp_path, text), "-o", tmp_path / "out", "--measure", "energy") == 0
    for row in table(tmp_path / "out" / "results.csv"):
        half = 0.5 * float(row["opening"])
        walls = [f"walls.0.to=[{-half}, -0.1]", f"walls.1.to=[{half}, -0.1]"]
        others = ["grains.count=40", "time.duration=0.6", f"contact.friction={row['contact.friction']}"]
        simulation = Simulation(Scene.load("hopper", [*walls, *others]))
        simulation.run()
        assert row["potential_energy"] == repr(analysis.potential_energy(simulation))


@pytest.mark.parametrize("number", [0, 5])
def test_series_is_that_of_the_run_alone(tmp_path, followed, number):
    folder = followed / "runs" / f"{number:05}"
    alone = ("run", folder / "scene.toml", *MEASURED, "--every", 9, "--series", tmp_path / "alone.csv")
    assert exit_code(*alone) == 0
    assert (folder / "series.csv").read_bytes() == (tmp_path / "alone.csv").read_bytes()
    assert [row["step"] for row in table(folder / "series.csv")] == ["0", "9", "18", "27", "36"]


@pytest.mark.parametrize("options", [(), ("--folders",), ("--every", 9)])
def test_run_that_cannot_have_a_quantity_has_failed(tmp_path, options):
    """It has done no step, and the other runs continue."""
    (tmp_path / "mix").mkdir()
    for name, pressure in (("fixed", ""), ("pressed", "pressure = 10.0\n")):
        text = Scene.load("annulus").text.replace("[domain]\n", f"[domain]\n{pressure}")
        (tmp_path / "mix" / f"{name}.toml").write_text(text)
    out = tmp_path / "out"
    for again in ((), ("--resume",)):
        assert batch(tmp_path / "mix", "-o", out, *MEASURED, *options, *again) == 1
        good, bad = table(out / "results.csv")
        assert (good["error"], good["steps"], bad["steps"]) == ("", "800", "")
        assert bad["error"] == "contact_power cannot be computed where a pressure or a force drives a wall"
    assert not (out / "runs" / "00001").exists()


def test_drawn_with_its_unit(measured, monkeypatch):
    labels = []
    monkeypatch.setattr(Axes, "set_ylabel", lambda axes, label, **options: labels.append(label))
    SweepPlot.parse("x=physics.drag,y=drag_power").draw(measured / "results.csv")
    assert labels == ["drag_power [W]"]
