"""What the command line tells of scenes, of progress and of how to go on."""

from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest
from command import exit_code, require_refusal

from warpgrains import Scene, console
from warpgrains.cli.scenes import REQUIRED, keys, parameters_of
from warpgrains.scene.layouts import LAYOUTS
from warpgrains.scene.toml import shipped


def test_nothing_at_all_prints_help_and_scenes_have_a_line_each(capfd):
    assert exit_code() == 0
    printed = capfd.readouterr()
    assert printed.out.startswith("usage: warpgrains")
    assert "scenes" in printed.out
    assert printed.err == ""
    assert exit_code("scenes") == 0
    lines = capfd.readouterr().out.splitlines()
    for name in (*shipped("scene"), *shipped("sweep")):
        line = next(line for line in lines if line.split()[:1] == [name])
        assert line.endswith((".", "?"))


@pytest.mark.parametrize("name", shipped("scene"))
def test_a_scene_is_explained_key_by_key_and_begun_from(name, tmp_path, capfd):
    assert exit_code("scenes", name) == 0
    printed = capfd.readouterr().out
    for key in keys(None):
        assert f"{key.section}.{key.name} " in printed
    assert "physics.drag            kg/s        0.0 " in printed
    assert exit_code("init", tmp_path / "my.toml", "--from", name) == 0
    mine, other = Scene.load(tmp_path / "my.toml"), Scene.load(name)
    for field in fields(Scene):
        if field.name not in ("name", "text"):
            assert np.array_equal(getattr(mine, field.name), getattr(other, field.name)), field.name


@pytest.mark.parametrize("layout", [None, *LAYOUTS])
def test_every_key_has_a_meaning_and_numbers_have_units(layout):
    numbers = {field.name: field.default for field in fields(Scene)}
    found = {key.name: key for key in keys(layout)}
    for name, key in found.items():
        assert key.meaning.rstrip().endswith((".", ":", "...")), key
        assert key.default in (None, REQUIRED, numbers.get(name, key.default)), key
    units = {"gravity": "m/s2", "method": "", "radius": "m", "density": "kg/m2"}
    assert {name: found[name].unit for name in units} == units
    if layout:
        assert {*parameters_of(LAYOUTS[layout])} <= {*found}


def test_a_layout_that_does_not_describe_a_key_is_refused(tmp_path, monkeypatch, capfd):
    def ring(annulus, *, radius, turn=0.0):
        """Place grains on a circle."""

    monkeypatch.setitem(LAYOUTS, "ring", ring)
    (tmp_path / "ring.toml").write_text('[domain]\nradius_out = 1.0\n[grains]\nlayout = "ring"\n')
    assert exit_code("scenes", tmp_path / "ring.toml") == 2
    require_refusal(capfd, "layout 'ring' has the parameter turn: describe it in its docstring")


@pytest.mark.parametrize("base", ["annulus", "box"])
def test_what_is_commented_out_says_the_default(base, tmp_path):
    """With every comment of a default taken away, nothing changes."""
    path = tmp_path / "my.toml"
    assert exit_code("init", path, "--from", base) == 0
    lines = path.read_text().splitlines()
    bare = [
        line.removeprefix("# ") if before.startswith("#") and " = " in line and "..." not in line else line
        for before, line in pairwise(["", *lines])
    ]
    assert bare != lines
    path.write_text("\n".join(line for line in bare if not line.startswith("# position")))
    assert Scene.load(path).stop == Scene.load(base).stop


def test_a_log_has_a_line_now_and_then(capfd, monkeypatch):
    monkeypatch.setattr(console, "BETWEEN_LINES", 0.0)
    with console.progress_bar(100, 20) as bar:
        bar.update(40)
    with console.progress_bar(100, shown=False) as bar:
        bar.update(40)
    printed = capfd.readouterr()
    assert printed.out == ""
    assert printed.err == "60 of 100 steps, 0 s, 0 s left\n"
