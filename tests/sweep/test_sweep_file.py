"""Sweep files: which runs they stand for, and that each run's scene file is what it says"""

import tomllib

import numpy as np
import pytest

from warpgrains import Scene
from warpgrains.scene.toml import toml_text
from warpgrains.sweep.axes import axis_values
from warpgrains.sweep.sweep import Sweep

SCENE = """
domain = {radius_in = 0.5, radius_out = 1.0}
[grains]
position = [[0.7, 0.0], [0.0, 0.7]]
radius = 0.1
mass = 0.1
"""

AXES = 'scene = "annulus"\n[axes]\n'
GRID = [(0.1, 5), (0.1, 7), (0.2, 5), (0.2, 7)]


def load(folder, text):
    (folder / "sweep.toml").write_text(text)
    return Sweep.load(folder / "sweep.toml")


def values(sweep):
    return [tuple(run.values.values()) for run in sweep.runs]


class TestAxes:
    @pytest.mark.parametrize(
        ("axis", "expected"),
        [
            ([3, 1, 2], [3, 1, 2]),
            (["color", "sequential"], ["color", "sequential"]),
            ([[0.0, -9.81], [9.81, 0.0]], [[0.0, -9.81], [9.81, 0.0]]),
            ({"range": [0.1, 0.5], "count": 5}, [0.1, 0.2, 0.3, 0.4, 0.5]),
            ({"range": [0.2, -0.1], "count": 4}, [0.2, 0.1, 0.0, -0.1]),
            ({"range": [10, 30], "count": 3}, [10, 20, 30]),
            ({"range": [0, 1], "count": 3}, [0.0, 0.5, 1.0]),
            ({"range": [0.0, 2.0], "count": 3}, [0.0, 1.0, 2.0]),
            ({"log_range": [1e-8, 1e-4], "count": 5}, [1e-8, 1e-7, 1e-6, 1e-5, 1e-4]),
            ({"log_range": [1000, 10], "count": 3}, [1000, 100, 10]),
            ({"log_range": [1, 2], "count": 3}, [1.0, 1.41421356237, 2.0]),
            ({"seeds": 3}, [0, 1, 2]),
        ],
    )
    def test_values(self, axis, expected):
        found = axis_values("a.b", axis)
        assert found == expected
        assert [type(value) for value in found] == [type(value) for value in expected]


class TestRuns:
    @pytest.mark.parametrize(
        ("text", "expected"),
        [
            ("physics.drag = [0.1, 0.2]\ngrains.count = {range = [5, 7], count = 2}", GRID),
            ("physics.drag = [0.1, 0.1]\ngrains.count = [5, 7]\n", [(0.1, 5), (0.1, 7)]),
            ("", [()]),
        ],
    )
    def test_values_of_runs(self, tmp_path, text, expected):
        combine = "grid" if expected is GRID else "zip"
        sweep = load(tmp_path, f'combine = "{combine}"\n{AXES}{text}')
        assert values(sweep) == expected
        assert [run.number for run in sweep.runs] == list(range(len(expected)))

    def test_sides_of_a_box(self, tmp_path):
        axes = "domain.top.pressure = [1.0, 3.0]\ndomain.x = [[0.0, 1.6], [0.0, 2.0]]"
        sweep = load(tmp_path, f'scene = "box"\n[set]\ndomain.top.mass = 2.0\n[axes]\n{axes}')
        assert sweep.axes == ("domain.top.pressure", "domain.x")
        (tmp_path / "scene.toml").write_text(sweep.runs[3].text("grains"))
        found = Scene.load(tmp_path / "scene.toml")
        keys = ["domain.top.mass=2.0", "domain.top.pressure=3.0", "domain.x=[0.0, 2.0]"]
        assert found.walls == Scene.load("box", keys).walls
        lid, floor = found.walls[-1], found.walls[0]
        assert (lid.force, lid.mass, floor.velocity) == (6.0, 2.0, (0.4, 0.0))

    def test_scene_of_a_run(self, tmp_path):
        """The file of a run gives the scene that the same overrides give on the command line."""
        text = 'scene = "polydisperse"\n[set]\ntime.duration = 0.1\n[axes]\ngrains.seed = {seeds = 3}'
        run = load(tmp_path, text).runs[2]
        (tmp_path / "scene.toml").write_text(run.text("grains"))
        found = Scene.load(tmp_path / "scene.toml")
        expected = Scene.load("polydisperse", ["time.duration=0.1", "grains.seed=2"])
        for name in ("position", "velocity", "radius", "mass"):
            assert np.array_equal(getattr(found, name), getattr(expected, name))
        for name in ("radius_in", "gravity", "drag", "dt", "duration", "tolerance", "max_iterations"):
            assert getattr(found, name) == getattr(expected, name)
        assert "run 2 of a sweep over polydisperse: grains.seed = 2" in found.text

    def test_walls_and_named_axes(self, tmp_path):
        """An opening between two walls is one axis, and a wall's friction another."""
        text = """scene = "hopper"
            set.walls.0.to = ["-0.5 $opening", -0.1]
            set.walls.1.to = ["$opening", "-$opening"]
            set.physics.drag = "$opening"
            axes.opening = [0.25, 0.5]
            axes.walls.0.friction = [0.0, 0.9]"""
        sweep = load(tmp_path, text)
        assert sweep.axes == ("opening", "walls.0.friction")
        run = sweep.runs[3]
        assert run.labels() == {"run": "3", "scene": "hopper", "opening": "0.5", "walls.0.friction": "0.9"}
        (tmp_path / "scene.toml").write_text(run.text("grains"))
        found = Scene.load(tmp_path / "scene.toml")
        overrides = ["walls.0.to=[-0.25, -0.1]", "walls.1.to=[0.5, -0.5]", "walls.0.friction=0.9"]
        expected = Scene.load("hopper", [*overrides, "physics.drag=0.5"])
        assert (found.walls, found.drag) == (expected.walls, expected.drag)
        assert found.walls[0].end == (-0.25, -0.1)
        assert np.array_equal(found.position, expected.position)
        assert Scene.load("hopper").walls[1] != found.walls[1]

    def test_keys_of_polylines(self, tmp_path):
        wall = 'kind = "polyline"\npoints = [[-0.5, 0.0], [0.0, -0.5], [0.5, 0.0]]'
        (tmp_path / "cup.toml").write_text(f"{Scene.load('pile').text}\n[[walls]]\n{wall}\n")
        sweep = load(tmp_path, 'scene = "cup.toml"\naxes.walls.0.closed = [false, true]')
        for run, count in zip(sweep.runs, (2, 3), strict=True):
            (tmp_path / "scene.toml").write_text(run.text("grains"))
            assert len(Scene.load(tmp_path / "scene.toml").walls) == count

    def test_folder_of_scenes(self, tmp_path):
        scenes = tmp_path / "scenes"
        scenes.mkdir()
        for name in ("b", "a"):
            (scenes / f"{name}.toml").write_text(SCENE)
        (scenes / "notes.txt").write_text("not a scene")
        assert [run.base.name for run in Sweep.load(scenes).runs] == ["a", "b"]
        sweep = load(tmp_path, 'folder = "scenes"\n[axes]\nphysics.drag = [0.1, 0.2]')
        names = [(run.base.name, *run.values.values()) for run in sweep.runs]
        assert names == [("a", 0.1), ("a", 0.2), ("b", 0.1), ("b", 0.2)]

    def test_scene_beside_the_sweep_wins_over_a_shipped_one(self, tmp_path):
        (tmp_path / "annulus").write_text(SCENE)
        assert load(tmp_path, 'scene = "annulus"').runs[0].base.sections["grains"]["radius"] == 0.1
        (tmp_path / "annulus").unlink()
        assert load(tmp_path, 'scene = "annulus"').runs[0].base.sections["grains"]["layout"] == "rows"

    def test_folders_of_results_hide_no_shipped_name(self, tmp_path, monkeypatch):
        (tmp_path / "annulus").mkdir()
        assert load(tmp_path, 'scene = "annulus"').runs[0].base.sections["grains"]["layout"] == "rows"
        monkeypatch.chdir(tmp_path)
        (tmp_path / "iterations").mkdir()
        assert len(Sweep.load("iterations").axes) > 0


class TestText:
    def test_the_same_document_is_read_back(self):
        document = {
            "bare": 1,
            "section": {
                "whole": -3,
                "number": 0.1 + 0.2,
                "small": 5e-324,
                "huge": 1e308,
                "infinite": float("inf"),
                "yes": True,
                "text": 'quotes " and \\ and \t, \x7f and é',
                "list": [[0.0, -9.81], []],
                "table": {"a key": [1, {"b": 2.0}]},
                "a key": 0,
            },
            "empty": {},
        }
        assert tomllib.loads(toml_text(document)) == document
