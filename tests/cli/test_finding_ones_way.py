"""What the command line tells of scenes, of progress and of how to go on."""

import re
import subprocess
import sys
from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest
from command import exit_code, require_refusal
from pages import PAGES
from recordings import make_frames, record

from warpgrains import Scene
from warpgrains.base import console
from warpgrains.cli.commands import COMMANDS
from warpgrains.cli.main import _parser, main
from warpgrains.cli.scenes import keys, parameters_of
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
    assert re.search(r"physics.drag +kg/s +0.0 ", printed)
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
        assert key.default in (None, numbers.get(name, key.default)), key
    units = {"gravity": "m/s2", "method": "", "radius": "m", "density": "kg/m2"}
    assert {name: found[name].unit for name in units} == units
    if layout:
        assert {*parameters_of(LAYOUTS[layout])} - {"space", "walls"} <= {*found}  # these come from the scene


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
        line.removeprefix("# ") if before.startswith("#") and re.match(r"# \w+ = (?!\.\.\.)", line) else line
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


@pytest.mark.parametrize("name", COMMANDS)
def test_help_of_a_command_ends_with_an_example_that_is_one(name, capfd):
    """As --help, and as `warpgrains help`."""
    for words in ((name, "--help"), ("help", name)):
        with pytest.raises(SystemExit, match="0"):
            main(words)
        said = " ".join(capfd.readouterr().out.split())
        assert said.endswith(f"Example: {COMMANDS[name].example}")
    assert _parser().parse_args(COMMANDS[name].example.split()[1:]).command is COMMANDS[name]


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_shells_complete_commands_and_options(shell, capfd):
    assert main(["--completion", shell]) == 0
    said = capfd.readouterr().out
    assert all(word in said for word in ("compress", "color-by", "homework"))


def test_keys_units_and_defaults_have_columns_of_their_own(capfd):
    assert exit_code("scenes", "annulus") == 0
    _, table = capfd.readouterr().out.split("\n\nkey ")
    head, *lines = f"key {table}".splitlines()
    ends = [head.index(word) for word in ("unit", "default", "meaning")]
    assert "contact.wall_rolling_friction" in table
    for line in lines:
        assert all(line[end - 1] == " " for end in ends), line
        assert line.startswith(" ") or all(line[end] != " " for end in ends[1:]), line


def test_a_device_that_is_not_there_is_one_line():
    command = [sys.executable, "-m", "warpgrains", "run", "annulus", "--steps", "1", "--device", "cuda:7"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200)
    assert done.returncode == 2
    assert done.stderr.startswith("warpgrains: error: device 'cuda:7' does not exist")
    assert done.stderr.count("\n") == 1


def test_many_recordings_are_checked_at_once(tmp_path, capfd):
    files = [record(tmp_path / f"{name}.usdc", make_frames(2)) for name in "ab"]
    assert exit_code("check", *files) == 0
    assert capfd.readouterr().out == "".join(f"{path}: OK: 2 frames, 5 grains\n" for path in files)
    files[0].write_text("no recording")
    assert exit_code("check", *files) == 1
    first, second = capfd.readouterr().out.splitlines()
    assert "is not a USD file that can be read: `warpgrains run SCENE -o FILE.usdc` writes one" in first
    assert second == f"{files[1]}: OK: 2 frames, 5 grains"


def test_pages_that_include_a_file_name_it():
    for name, path in (("model", "kernels/MODEL.md"), ("report", "scenes/report/report.md")):
        assert f"This page is the file `{path}`" in PAGES[name].read_text()
