"""Sweep files: which runs they stand for, and that each run's scene file is what it says"""

import tomllib
from dataclasses import fields

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


def load(folder, text):
    (folder / "sweep.toml").write_text(text)
    return Sweep.load(folder / "sweep.toml")


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
def test_values_of_an_axis(axis, expected):
    found = axis_values("a.b", axis)
    assert found == expected
    assert [type(value) for value in found] == [type(value) for value in expected]


@pytest.mark.parametrize(
    ("combine", "text", "expected"),
    [
        (
            "grid",
            "physics.drag = [0.1, 0.2]\ngrains.count = {range = [5, 7], count = 2}",
            [(0.1, 5), (0.1, 7), (0.2, 5), (0.2, 7)],
        ),
        ("zip", "physics.drag = [0.1, 0.1]\ngrains.count = [5, 7]\n", [(0.1, 5), (0.1, 7)]),
        ("zip", "", [()]),
    ],
)
def test_values_of_runs(tmp_path, combine, text, expected):
    axes = f"[axes]\n{text}" if text else ""
    sweep = load(tmp_path, f'combine = "{combine}"\nscene = "annulus"\n{axes}')
    assert [tuple(run.values.values()) for run in sweep.runs] == expected
    assert [run.number for run in sweep.runs] == list(range(len(expected)))


CUP = """
[[walls]]
kind = "polyline"
points = [[-0.5, 0.0], [0.0, -0.5], [0.5, 0.0]]
"""
SEEDS = """scene = "polydisperse"
    set.time.duration = 0.1
    axes.grains.seed = {seeds = 4}"""
SIDES = """scene = "box"
    set.domain.top.mass = 2.0
    axes.domain.top.pressure = [1.0, 3.0]
    axes.domain.x = [[0.0, 1.6], [0.0, 2.0]]"""
OPENING = """scene = "hopper"
    set.walls.0.to = ["-0.5 $opening", -0.1]
    set.walls.1.to = ["$opening", "-$opening"]
    set.physics.drag = "$opening"
    axes.opening = [0.25, 0.5]
    axes.walls.0.friction = [0.0, 0.9]"""
POLYLINE = """scene = "cup.toml"
    axes.walls.0.closed = [false, true]
    axes.physics.drag = [0.1, 0.2]"""
LAST_RUNS = {
    "seeds": (SEEDS, "polydisperse", ["time.duration=0.1", "grains.seed=3"]),
    "sides": (SIDES, "box", ["domain.top.mass=2.0", "domain.top.pressure=3.0", "domain.x=[0.0, 2.0]"]),
    "an opening between two walls": (
        OPENING,
        "hopper",
        ["walls.0.to=[-0.25, -0.1]", "walls.1.to=[0.5, -0.5]", "walls.0.friction=0.9", "physics.drag=0.5"],
    ),
    "polyline": (POLYLINE, "cup.toml", ["walls.0.closed=true", "physics.drag=0.2"]),
}


@pytest.mark.parametrize(("text", "base", "overrides"), LAST_RUNS.values(), ids=LAST_RUNS)
def test_scene_of_a_run(tmp_path, monkeypatch, text, base, overrides):
    """The file of a run gives the scene that the same overrides give on the command line."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cup.toml").write_text(Scene.load("pile").text + CUP)
    run = load(tmp_path, text).runs[3]
    (tmp_path / "scene.toml").write_text(run.text("grains"))
    found, expected, other = (Scene.load(*given) for given in (("scene.toml",), (base, overrides), (base,)))
    for field in fields(Scene):
        if field.name not in ("name", "text"):
            assert np.array_equal(getattr(found, field.name), getattr(expected, field.name)), field.name
    assert (found.walls, found.duration) != (other.walls, other.duration)
    assert f"run 3 of a sweep over {expected.name}: " in found.text


def test_folder_of_scenes(tmp_path):
    scenes = tmp_path / "scenes"
    scenes.mkdir()
    for name in ("b", "a"):
        (scenes / f"{name}.toml").write_text(SCENE)
    (scenes / "notes.txt").write_text("not a scene")
    assert [run.base.name for run in Sweep.load(scenes).runs] == ["a", "b"]
    sweep = load(tmp_path, 'folder = "scenes"\n[axes]\nphysics.drag = [0.1, 0.2]')
    names = [(run.base.name, *run.values.values()) for run in sweep.runs]
    assert names == [("a", 0.1), ("a", 0.2), ("b", 0.1), ("b", 0.2)]


def test_files_beside_the_sweep_win_over_shipped_ones_but_folders_do_not(tmp_path, monkeypatch):
    (tmp_path / "annulus").write_text(SCENE)
    assert load(tmp_path, 'scene = "annulus"').runs[0].base.sections["grains"]["radius"] == 0.1
    (tmp_path / "annulus").unlink()
    (tmp_path / "annulus").mkdir()  # of results
    assert load(tmp_path, 'scene = "annulus"').runs[0].base.sections["grains"]["layout"] == "rows"
    monkeypatch.chdir(tmp_path)
    (tmp_path / "iterations").mkdir()
    assert len(Sweep.load("iterations").axes) > 0


def test_the_text_of_a_document_is_read_back():
    section = {
        "whole": -3,
        "numbers": [0.1 + 0.2, 5e-324, 1e308, float("inf")],
        "yes": True,
        "text": 'quotes " and \\ and \t, \x7f and é',
        "list": [[0.0, -9.81], []],
        "table": {"a key": [1, {"b": 2.0}]},
        "a key": 0,
    }
    document = {"bare": 1, "section": section, "empty": {}}
    assert tomllib.loads(toml_text(document)) == document
