"""Scenes from files: every key, overrides, grains in files of their own, and the line for what is wrong."""

import numpy as np
import pytest
from sample_scenes import SCENE_FILE

from warpgrains import InputError, Scene
from warpgrains.scene.layouts import LAYOUTS
from warpgrains.scene.toml import shipped_scenes


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "mine.toml"
        path.write_text(text)
        return path

    return write


def test_load_reads_every_key(write):
    made = Scene.load(write(SCENE_FILE))
    assert np.array_equal(made.position, [[0.75, 0.0], [0.0, 0.75]])
    assert np.array_equal(made.velocity, [[1.0, 2.0], [1.0, 2.0]])
    assert np.array_equal(made.radius, [0.125, 0.25])
    assert np.array_equal(made.mass, [2.0, 2.0])
    assert (made.radius_in, made.radius_out, made.gravity, made.drag) == (0.5, 1.0, (0.0, -1.0), 0.25)
    assert (made.dt, made.duration, made.steps) == (0.125, 2.0, 16)
    assert (made.tolerance, made.max_iterations, made.order) == (1e-3, 7, "color")
    assert (made.name, made.text) == ("mine", SCENE_FILE)


def test_overrides_replace_values_and_stay_with_the_text(write):
    values = ("physics.drag=0.5", "physics.gravity = [1, 0]", "solver.order=sequential")
    made = Scene.load(write(SCENE_FILE), [*values, "grains.mass=[1.0, 3.0]"])
    assert (made.drag, made.gravity, made.order) == (0.5, (1.0, 0.0), "sequential")
    assert np.array_equal(made.mass, [1.0, 3.0])
    assert made.text.endswith("# --set grains.mass=[1.0, 3.0]")


def test_text_tells_what_was_changed_after_reading(write):
    made = Scene.load(write(SCENE_FILE)).replace(drag=0.5, order="sequential")
    assert made.text == SCENE_FILE + "\n# changed afterwards: drag, order"
    assert Scene(position=made.position, radius=0.1, mass=0.1, radius_out=1.0).replace(drag=0.5).text == ""


def test_mass_by_area(write):
    made = Scene.load(write(SCENE_FILE.replace("mass = 2.0", "density = 10.0")))
    assert np.array_equal(made.mass, 10.0 * np.pi * made.radius**2)


@pytest.mark.parametrize("suffix", ["npz", "csv"])
def test_grains_from_a_file_beside_the_scene(write, tmp_path, suffix):
    """Editors and spreadsheets of some systems begin files with a mark of their encoding."""
    position, velocity, radius = [[0.75, 0.0], [0.0, 0.75]], [[0.0, 1.0], [0.1, 0.2]], [0.125, 0.25]
    if suffix == "npz":
        np.savez(tmp_path / "grains.npz", position=position, velocity=velocity, radius=radius)
    else:
        (tmp_path / "grains.csv").write_text(
            "\ufeffx, y,vx,vy,radius\n0.75,0.0,0.0,1.0,0.125\n0.0,0.75,0.1,0.2,0.25\n", "utf-8"
        )
    made = Scene.load(
        write(f'\ufeffdomain.radius_out = 1.0\n[grains]\nfile = "grains.{suffix}"\nmass = 2.0\n')
    )
    assert np.array_equal(made.position, position)
    assert np.array_equal(made.velocity, velocity)
    assert np.array_equal(made.radius, radius)


def test_scene_that_is_not_there_or_no_text(tmp_path):
    with pytest.raises(InputError, match=r"'anulus': did you mean 'annulus'\? Known: annulus, bidisperse, "):
        Scene.load("anulus")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"binary\.toml cannot be read"):
        Scene.load(tmp_path / "binary.toml")


def test_a_file_wins_over_a_shipped_scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pile").mkdir()
    (tmp_path / "annulus").write_text(SCENE_FILE)
    assert Scene.load("annulus").n == 2
    assert Scene.load("pile").n == 1000


def test_a_layout_with_a_key_of_every_layout_is_refused(write, monkeypatch):
    def odd(annulus, *, density=2.0):
        return [[0.0, 0.5]], [0.1]

    monkeypatch.setitem(LAYOUTS, "odd", odd)
    path = write('[domain]\nradius_out = 1.0\n[grains]\nlayout = "odd"\ndensity = 1.0\n')
    with pytest.raises(InputError, match="has the parameter density: choose another name"):
        Scene.load(path)


@pytest.mark.parametrize("name", shipped_scenes())
def test_shipped_scenes_start_without_overlap(name):
    assert Scene.load(name).count_overlaps() == (0, 0, 0.0)
