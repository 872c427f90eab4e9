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


def test_nothing_at_all_prints_help(capfd):
    assert exit_code() == 0
    printed = capfd.readouterr()
    assert printed.out.startswith("usage: warpgrains")
    assert "scenes" in printed.out
    assert printed.err == ""


def test_scenes_are_listed_with_a_line_each(capfd):
    assert exit_code("scenes") == 0
    lines = capfd.readouterr().out.splitlines()
    for kind in ("scene", "sweep"):
        for name in shipped(kind):
            line = next(line for line in lines if line.split()[:1] == [name])
            assert line.endswith((".", "?"))


@pytest.mark.parametrize("name", shipped("scene"))
def test_a_scene_is_explained_key_by_key(name, capfd):
    assert exit_code("scenes", name) == 0
    printed = capfd.readouterr().out
    for key in keys(None):
        assert f"{key.section}.{key.name} " in printed
    assert "physics.drag            kg/s        0.0 " in printed


@pytest.mark.parametrize("layout", [None, *LAYOUTS])
def test_every_key_has_a_meaning_and_numbers_have_units(layout):
    numbers = {field.name: field.default for field in fields(Scene)}
    for key in keys(layout):
        assert key.meaning.rstrip().endswith((".", ":", "...")), key
        assert (
            key.default is None
            or key.default is REQUIRED
            or key.default == numbers.get(key.name, key.default)
        )
    units = {key.name: key.unit for key in keys(layout)}
    assert units["gravity"] == "m/s2"
    assert units["method"] == ""
    assert units["radius"] == "m"
    assert units["density"] == "kg/m2"
    if layout:
        assert {*parameters_of(LAYOUTS[layout])} <= {*units}


def test_a_layout_that_does_not_describe_a_key_is_refused(tmp_path, monkeypatch, capfd):
    def ring(annulus, *, radius, turn=0.0):
        """Place grains on a circle."""

    monkeypatch.setitem(LAYOUTS, "ring", ring)
    (tmp_path / "ring.toml").write_text('[domain]\nradius_out = 1.0\n[grains]\nlayout = "ring"\n')
    assert exit_code("scenes", tmp_path / "ring.toml") == 2
    require_refusal(capfd, "layout 'ring' has the parameter turn: describe it in its docstring")


@pytest.mark.parametrize("base", shipped("scene"))
def test_a_begun_scene_is_that_which_it_is_from(base, tmp_path, capfd):
    path = tmp_path / "my.toml"
    assert exit_code("init", path, "--from", base) == 0
    mine, other = Scene.load(path), Scene.load(base)
    for field in fields(Scene):
        if field.name not in ("name", "text"):
            assert np.array_equal(getattr(mine, field.name), getattr(other, field.name)), field.name
    capfd.readouterr()
    before = path.read_bytes()
    assert exit_code("init", path) == 2
    require_refusal(capfd, "refusing to overwrite")
    assert path.read_bytes() == before


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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("grains = 3", "grains is 3: it must be a section"),
        ("grains.layout = [1]", "unknown grains.layout [1]"),
        ("domain.radius = 3", "unknown key in [domain] 'radius'"),
        ("walls = [3]", "walls[0] is 3: it must be a Disc or "),
    ],
)
def test_a_bad_scene_is_neither_explained_nor_begun_from(tmp_path, capfd, text, message):
    bad = tmp_path / "bad.toml"
    bad.write_text(text)
    for arguments in (["scenes", bad], ["init", tmp_path / "x.toml", "--from", bad]):
        assert exit_code(*arguments) == 2
        require_refusal(capfd, message)


def test_a_log_has_a_line_now_and_then(capfd, monkeypatch):
    monkeypatch.setattr(console, "BETWEEN_LINES", 0.0)
    with console.progress_bar(100, 20) as bar:
        bar.update(40)
    with console.progress_bar(100, shown=False) as bar:
        bar.update(40)
    printed = capfd.readouterr()
    assert printed.out == ""
    assert printed.err == "60 of 100 steps, 0 s, 0 s left\n"


def test_an_interrupt_says_how_to_go_on(tmp_path, capfd, stop_at):
    stop_at(450)
    kept, output = tmp_path / "kept one.npz", tmp_path / "run.usdc"
    options = ("--checkpoint", kept, "--every", 100, "-o", output)
    assert exit_code("run", "annulus", *options) == 130
    assert capfd.readouterr().err.splitlines()[-1] == (
        f"warpgrains: error: interrupted; to continue: warpgrains run --resume '{kept}';"
        f" to recover the frames so far: warpgrains recover {output}.frames"
    )
    assert sorted(tmp_path.iterdir()) == [kept, output.with_name("run.usdc.frames")]
    assert exit_code("run", "--resume", kept) == 0


def test_an_interrupted_sweep_says_so_too(tmp_path, capfd, monkeypatch):
    from warpgrains.sweep import runner

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(runner, "finish_runs", interrupted)
    assert exit_code("batch", "iterations", "-o", tmp_path / "out") == 130
    said = capfd.readouterr().err
    assert said.endswith("interrupted; to continue: the same command with --resume\n")
