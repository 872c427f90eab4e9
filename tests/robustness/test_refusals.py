"""Bad input, in Python or as a command, is refused in one line, and changes nothing: refusals.toml."""
# ruff: noqa: F401 (calls of the table use all that is imported here)

import io
import os
import re
import shlex
import shutil
import sys
import tomllib
import zipfile
from dataclasses import replace
from math import inf, nan
from pathlib import Path
from time import process_time

import numpy as np
import pytest
from checkpoints import rewrite_checkpoint
from command import exit_code, require_refusal
from recordings import make_frames, record
from same_bits import contents
from sample_scenes import SCENE_FILE
from sweeps import write

import warpgrains
from warpgrains import Batch, Box, InputError, Polyline, Scene, Segment, Simulation, analysis
from warpgrains.accuracy import certify
from warpgrains.analysis.plots import plot_history
from warpgrains.base.locks import Lock
from warpgrains.cli import main as command_line
from warpgrains.scene.layouts import LAYOUTS
from warpgrains.scene.state import first_state
from warpgrains.scene.toml import toml_value
from warpgrains.simulation.options import RunOptions
from warpgrains.space.geometry import NOWHERE
from warpgrains.space.region import Region
from warpgrains.sweep.axes import axis_values
from warpgrains.sweep.plot import SweepPlot
from warpgrains.sweep.sweep import Sweep
from warpgrains.usd.recorder import recover
from warpgrains.walls.annulus import Annulus
from warpgrains.walls.bodies import Joints

TABLE = tomllib.loads(Path(__file__).with_name("refusals.toml").read_text())
MOST_CHARACTERS = 220
RIDDLES = re.compile(
    r"\b(is there|goes? on|to go on|so many|anew|amid|beside|(?<!there )is no|are told|of its own"
    r"|is left as it is|which it may not|holds what|no number|none of them)\b"
)
"""Words that need explaining."""
CALLS = [
    (call.replace("{}", text, 1), complaint)
    for section in TABLE["python"].values()
    for call in section["calls"]
    for text, complaint in section["refused"]
]
COMMANDS = [
    (f"{name} {rest}", *complaint)
    for name, section in TABLE["command"].items()
    for rest, *complaint in section
]


def ring(**changes):
    """Return a scene of three grains between two circles."""
    fields = {"position": [[0.7, 0.0], [0.0, 0.7], [-0.7, 0.0]], "radius": 0.1, "mass": 0.1}
    return Scene(**{**fields, "radius_in": 0.5, "radius_out": 1.0, **changes})


def circle(**changes):
    return Scene(**{"position": [(0.0, 0.5)], "radius": 0.1, "mass": 1.0, "radius_out": 1.0, **changes})


def boxed(sides=None, **changes):
    """Return a scene of one grain in a box."""
    box = {"x": (0.0, 1.0), "y": (0.0, 0.7), **(sides or {})}
    return Scene(**{"position": [(0.5, 0.3)], "radius": 0.1, "mass": 1.0, "domain": box, **changes})


def pressed(**changes):
    return circle(**{"position": [(0.0, 0.2)], "pressure": 50.0, "gravity": (0.0, 0.0), **changes})


def scene_file(folder, good, bad):
    assert good in SCENE_FILE
    Path(folder, "mine.toml").write_text(SCENE_FILE.replace(good, bad))
    return Scene.load(folder / "mine.toml")


def grain_file(folder, name, content):
    if isinstance(content, dict):
        np.savez(folder / name, **content)
    elif callable(content):
        content(folder / name)
    else:
        (folder / name).write_text(content)
    grains = f'domain.radius_out = 1.0\n[grains]\nfile = "{name}"\nradius = 0.1\nmass = 2.0\n'
    (folder / "mine.toml").write_text(grains)
    return Scene.load(folder / "mine.toml")


def made(path, make):
    make(path)
    return path


def huge(path):
    """Make a file of 2 TB that takes no place."""
    with path.open("w") as file:
        file.truncate(2**41)


def immense(path, entry):
    """Write an archive whose array claims 1e13 numbers and has none."""
    header = io.BytesIO()
    claim = {"descr": "<f8", "fortran_order": False, "shape": (5 * 10**12, 2)}
    np.lib.format.write_array_header_1_0(header, claim)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(f"{entry}.npy", header.getvalue())


def packed(path):
    """Write a checkpoint that unpacks to more than it is."""
    Simulation("annulus").save(path)
    with np.load(path) as entries:
        np.savez_compressed(path, **dict(entries))


def changed(path, kept, **changes):
    path.write_bytes(kept)
    rewrite_checkpoint(path, **changes)
    return path


def sweep_file(folder, text):
    (folder / "piped").mkdir()
    os.mkfifo(folder / "piped" / "scene.toml")  # to which nobody may ever write
    return Sweep.load(write(folder, text))


def plot_table(folder, text):
    if text is not None:
        (folder / "results.csv").write_text(text)
    SweepPlot.parse("x=a,y=c").draw(folder / "results.csv")


def history_file(folder, text):
    (folder / "run.csv").write_text(text)
    plot_history(folder / "run.csv", folder / "run.png")


def with_row(array, row, value):
    changed = array.copy()
    changed[row] = value
    return changed


MATRIX = np.arange(400).reshape(20, 20)
PLACES = "position = [[0.75, 0.0], [0.0, 0.75]]"
AXES = 'scene = "annulus"\n[axes]\n'
RING = Annulus(0.5, 1.0).space
BOX = Box((-0.5, 0.5), (2.0, 2.8), periodic="x").space
ABOVE = {"region": {"y": (0.5, 0.9)}, "radius": 0.05, "density": 1.0, "name": "above"}
LID = {"pressure": 1.0, "mass": 1.0}
PISTON = Segment((-0.6, 0.5), (0.6, 0.5), force=-20.0, mass=2.0)
BELT = Segment((3e38, -5e37), (3.38e38, -5e37), velocity=(9e36, 0.0))
NAMES = {name: getattr(warpgrains, name) for name in warpgrains.__all__} | globals() | LAYOUTS
"""What calls may name, besides what `running` returns, and a folder."""

PLAIN = (Path(__file__).parents[1] / "grade" / "right" / "plain.c").read_text()
ONE_GRAIN = """
domain = {radius_in = 0.2, radius_out = 1.0}
grains = {position = [[0.0, -0.5]], radius = 0.1, mass = 0.1}
"""
WALL = "[[walls]]\nkind = 'segment'\nfrom = [0.5, 0]\nto = [0.7, 0]\n"
WALLED = {
    "walled": WALL,
    "spun": f"physics.spin_drag = 0.01\n{WALL}friction = 0.3\n",
    "turning": "physics.gravity = {angular_velocity = 0.1}\n",
}


def require_line(message, complaint):
    """Check that a message begins with a complaint, in which … is any text, and is one short line."""
    assert "\n" not in message
    assert len(re.split(r"[:?] [kK]nown: ", message)[0]) <= MOST_CHARACTERS
    assert not RIDDLES.search(message), message
    assert re.match(".*".join(map(re.escape, complaint.split("…"))), message), message


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """Simulations, and what there is of them, as calls name them."""
    s, kept = Simulation("annulus", order="color"), tmp_path_factory.mktemp("run") / "run.npz"
    Simulation(s.scene).run(150, record=kept.with_suffix(".usdc"), checkpoint=kept)
    s.advance(150)
    b = Batch([s.scene, s.scene.replace(drag=0.1)])
    b.run(150)
    alone = circle(position=[(0.6, 0.0)], radius=0.02, radius_in=0.3)
    return {
        **{"s": s, "b": b, "state": s.state(), "one": analysis.snapshot(alone, first_state(alone))},
        "kept": kept.read_bytes(),
        "seen": warpgrains.Recording(kept.with_suffix(".usdc")),
        "turning": Batch([s.scene, s.scene.replace(gravity={"angular_velocity": 1.0})]),
    }


@pytest.mark.parametrize(("call", "complaint"), CALLS)
def test_call(running, tmp_path, monkeypatch, call, complaint):
    given, here = tmp_path / "given", tmp_path / "here"
    given.mkdir()
    here.mkdir()
    monkeypatch.chdir(here)
    before = contents(running["s"].state())
    with pytest.raises(InputError) as refusal:
        eval(call, NAMES | running | {"folder": given})
    require_line(str(refusal.value).replace(f"{given}/", ""), complaint)
    assert contents(running["s"].state()) == before
    assert not list(here.iterdir())


def files(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a file of each kind, and with a run of 30 steps of which 20 are done."""
    folder = tmp_path_factory.mktemp("folder")
    (folder / "mine.toml").write_text(SCENE_FILE)
    (folder / "mine.csv").write_text("a,b\n1,2\n")
    (folder / "laid.toml").write_text("grains.layout = [1]")
    (folder / "no_wall.toml").write_text("walls = [3]")
    (folder / "fast.toml").write_text("fps = 'fast'")
    (folder / "text.usdc").write_text("no stage")
    (folder / "empty.usda").write_text("#usda 1.0\n")
    for name in ("kept", "all", "site"):
        (folder / name).mkdir()
    for name in ("homework.c", "all/homework.c"):
        (folder / name).write_text(PLAIN)
    (folder / "empty.c").write_text('#include "fem.h"\n')
    (folder / "huge.c").write_text(" " * (2**20 + 1))
    os.mkfifo(folder / "pipe")
    (folder / "site" / "index.html").write_text("<html></html>")
    for name, more in WALLED.items():
        (folder / f"{name}.toml").write_text(ONE_GRAIN + more)
    write(folder)
    record(folder / "run.usdc", make_frames(3))
    half = Simulation("annulus", duration=0.3)
    half.run(20, record=folder / "kept" / "run.usdc", checkpoint=folder / "kept" / "run.npz")
    return folder


@pytest.mark.parametrize(("command", "complaint", "missing"), [(*case, None)[:3] for case in COMMANDS])
def test_command(folder, monkeypatch, capfd, command, complaint, missing):
    monkeypatch.chdir(folder)
    if missing is not None:  # a library
        for module in ("analysis.plots", "pictures.film", "pictures.still"):
            monkeypatch.delitem(sys.modules, f"warpgrains.{module}", raising=False)
        monkeypatch.setitem(sys.modules, missing, None)
    before = files(folder)
    assert exit_code(*shlex.split(command)) == 2
    printed = capfd.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("warpgrains: error: ")
    require_line(printed.err.removeprefix("warpgrains: error: ").removesuffix("\n"), complaint)
    assert files(folder) == before


def test_exact_steps_that_are_solved_to_the_last_bit():
    """At tolerance 0, with masses of 1e-3 to 1e3 kg, all products q s of the interior point method vanish."""
    velocity = [[0.44835621616645077, 0.9061805352307977], [1.3069112702041161, -0.8550261027787118]]
    velocity += [[0.8026157078296301, 0.3946607284633689]]
    grains = {"position": [[1 / 6, 1 / 6], [0.5, 1 / 6], [5 / 6, 1 / 6]], "radius": 1 / 15, "dt": 0.1}
    box = {"domain": Box((0.0, 1.0), (0.0, 1.0)), "scheme": "leapfrog", "method": "exact", "tolerance": 0.0}
    summary = Simulation(Scene(**grains, **box, velocity=velocity, mass=[1e-3, 1.0, 1e3]), threads=1).run(20)
    assert summary.overlap < 1e-12


def test_compiler_that_fails_is_one_line(tmp_path, monkeypatch, capfd):
    """As one without room for its files does, after it has compiled something smaller."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "homework.c").write_text(PLAIN)
    fails = '#!/bin/sh\ncase "$*" in *sandbox.c*) echo full; echo disk; exit 1;; esac\n'
    (tmp_path / "cc").write_text(f'{fails}exec {shutil.which("cc")} "$@"\n')
    (tmp_path / "cc").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    assert exit_code("grade", "homework.c") == 2
    require_refusal(capfd, "the C compiler failed: full disk")


def test_joints_of_polylines_take_linear_time():
    """Twice the corners take twice the time, and not four times as with a test of all pairs."""
    taken = []
    for corners in (1500, 6000):
        angle = np.linspace(0.0, 6.0, corners)
        walls = Polyline(np.stack([np.cos(angle), np.sin(angle)], axis=1)).segments(0)
        begun = process_time()
        joints = Joints(walls, NOWHERE)
        assert sum(len(own) for k in range(len(walls)) for own in joints.of(k)) == 2 * (corners - 2)
        taken.append(process_time() - begun)
    assert taken[1] < 8.0 * taken[0]  # 4 if linear, 16 if quadratic


def test_no_help_text_is_a_riddle():
    parser = command_line._parser()
    (commands,) = (one.choices for one in parser._actions if isinstance(one.choices, dict))
    for name, own in {"": parser, **commands}.items():
        assert not RIDDLES.search(" ".join(own.format_help().split())), name
