"""Scenes from files: every key, overrides, grains in files of their own, and the line for what is wrong."""

import numpy as np
import pytest
from sample_scenes import SCENE_FILE

from warpgrains import InputError, Scene
from warpgrains.scene.layouts import LAYOUTS
from warpgrains.scene.toml import shipped_scenes


@pytest.fixture
def load(tmp_path):
    def load(text, overrides=()):
        (tmp_path / "mine.toml").write_text(text)
        return Scene.load(tmp_path / "mine.toml", overrides)

    return load


def test_load_reads_every_key(load):
    made = load(SCENE_FILE)
    assert np.array_equal(made.position, [[0.75, 0.0], [0.0, 0.75]])
    assert np.array_equal(made.velocity, [[1.0, 2.0], [1.0, 2.0]])
    assert np.array_equal(made.radius, [0.125, 0.25])
    assert np.array_equal(made.mass, [2.0, 2.0])
    assert (made.radius_in, made.radius_out, made.gravity, made.drag) == (0.5, 1.0, (0.0, -1.0), 0.25)
    assert (made.dt, made.duration, made.steps) == (0.125, 2.0, 16)
    assert (made.tolerance, made.max_iterations, made.order) == (1e-3, 7, "color")
    assert (made.name, made.text) == ("mine", SCENE_FILE)
    dense = load(SCENE_FILE.replace("mass = 2.0", "density = 10.0"))
    assert np.array_equal(dense.mass, 10.0 * np.pi * dense.radius**2)


def test_what_is_changed_stays_with_the_text(load):
    values = ("physics.drag=0.5", "physics.gravity = [1, 0]", "solver.order=sequential")
    made = load(SCENE_FILE, [*values, "grains.mass=[1.0, 3.0]"])
    assert (made.drag, made.gravity, made.order) == (0.5, (1.0, 0.0), "sequential")
    assert np.array_equal(made.mass, [1.0, 3.0])
    assert made.text.endswith("# --set grains.mass=[1.0, 3.0]")
    afterwards = load(SCENE_FILE).replace(drag=0.5, order="sequential")
    assert afterwards.text == SCENE_FILE + "\n# changed afterwards: drag, order"
    assert Scene(position=made.position, radius=0.1, mass=0.1, radius_out=1.0).replace(drag=0.5).text == ""


@pytest.mark.parametrize("suffix", ["npz", "csv"])
def test_grains_from_a_file_beside_the_scene(load, tmp_path, suffix):
    """Editors and spreadsheets of some systems begin files with a mark of their encoding."""
    grains = {"position": [[0.75, 0.0], [0.0, 0.75]], "velocity": [[0.0, 1.0], [0.1, 0.2]]}
    grains["radius"] = [0.125, 0.25]
    np.savez(tmp_path / "grains.npz", **grains)
    table = "\ufeffx, y,vx,vy,radius\n0.75,0.0,0.0,1.0,0.125\n0.0,0.75,0.1,0.2,0.25\n"
    (tmp_path / "grains.csv").write_text(table, "utf-8")
    made = load(f'\ufeffdomain.radius_out = 1.0\n[grains]\nfile = "grains.{suffix}"\nmass = 2.0\n')
    for name, value in grains.items():
        assert np.array_equal(getattr(made, name), value)


def test_a_file_wins_over_a_shipped_scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pile").mkdir()
    (tmp_path / "annulus").write_text(SCENE_FILE)
    assert (Scene.load("annulus").n, Scene.load("pile").n) == (2, 1000)


def test_a_layout_with_a_key_of_every_layout_is_refused(load, monkeypatch):
    def odd(annulus, *, density=2.0):
        return [[0.0, 0.5]], [0.1]

    monkeypatch.setitem(LAYOUTS, "odd", odd)
    with pytest.raises(InputError, match="has the parameter density: choose another name"):
        load('[domain]\nradius_out = 1.0\n[grains]\nlayout = "odd"\ndensity = 1.0\n')


@pytest.mark.parametrize("name", shipped_scenes())
def test_shipped_scenes_start_without_overlap(name):
    assert Scene.load(name).count_overlaps() == (0, 0, 0.0)
