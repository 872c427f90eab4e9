"""Mutated input of every kind: one line or a right result, never anything else. More of it with -m slow."""

import json
from argparse import Namespace
from dataclasses import asdict
from functools import cache
from math import inf, nan
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from changed_bytes import mutations, reworded_texts
from hypothesis import given
from hypothesis import strategies as st
from recordings import make_frames, record
from same_bits import contents
from sample_scenes import SCENE_FILE
from test_foreign_recordings import FOREIGN
from trimmed import few_or_many

from warpgrains import InputError, Scene, Simulation
from warpgrains.analysis.plots import plot
from warpgrains.cli.check import check
from warpgrains.drawing.kinds import RECORDINGS
from warpgrains.scene.reader import scene_fields
from warpgrains.simulation.checkpoint import read_checkpoint

CSV = "x,y,vx,vy,radius,mass\n0.7,0.0,0.1,0.0,0.1,0.1\n0.0,0.7,0.0,-0.2,0.05,0.2\n"
ODD_JSON = (None, True, -1, 0, 1.5, nan, inf, 10**30, "", "x", "../x", [], [1], {}, {"a": 1})


def require_one_line(refusal):
    assert str(refusal).count("\n") == 0 < len(str(refusal)), str(refusal)


def fuzzed(check, examples, few=200):
    """Return the tests of a check that takes one example."""

    def test(how):
        how(given(examples)(check))()

    return few_or_many(few, 10_000)(test)


def check_scene(content):
    with TemporaryDirectory() as folder:
        path = Path(folder, "scene.toml")
        path.write_bytes(content)
        try:
            scene = Scene.load(path)
            assert np.isfinite(scene.position).all()
            again = Scene(**scene_fields(scene.text, path))
            assert contents(again) == contents(scene)
        except InputError as refusal:
            require_one_line(refusal)
        assert list(Path(folder).iterdir()) == [path]


test_scene_files = fuzzed(check_scene, mutations(SCENE_FILE.encode()) | reworded_texts(SCENE_FILE))


def check_grains(content):
    with TemporaryDirectory() as folder:
        Path(folder, "grains.csv").write_bytes(content)
        document = 'domain = {radius_out = 1.0}\n[grains]\nfile = "grains.csv"'
        try:
            scene = Scene(**scene_fields(document, Path(folder, "scene.toml")))
            assert scene.n > 0
        except InputError as refusal:
            require_one_line(refusal)


test_grain_files = fuzzed(check_grains, mutations(CSV.encode()))


@cache
def saved():
    """Return the bytes of a checkpoint, what is read of it, and its entries."""
    with TemporaryDirectory() as folder:
        simulation, path = Simulation(Scene.load("annulus")), Path(folder, "run.npz")
        simulation.run(steps=60, checkpoint=path)
        with np.load(path) as entries:
            return path.read_bytes(), read_checkpoint(path), dict(entries)


def check_checkpoint(content):
    with TemporaryDirectory() as folder:
        path = Path(folder, "run.npz")
        path.write_bytes(content)
        try:
            found = read_checkpoint(path)
        except InputError as refusal:
            require_one_line(refusal)
        else:
            assert contents(found.state) == contents(saved()[1].state)


test_damaged_checkpoints = fuzzed(check_checkpoint, st.deferred(lambda: mutations(saved()[0])))


@st.composite
def headers(draw):
    """Return a header with some values of another kind."""
    header = json.loads(saved()[2]["header"].tobytes())
    for _ in range(draw(st.integers(1, 3))):
        table = header[draw(st.sampled_from(["options", "statistics", "scene", "state"]))]
        if isinstance(table, dict):
            table[draw(st.sampled_from(sorted(table)))] = draw(st.sampled_from(ODD_JSON))
    return header


def check_header(header):
    with TemporaryDirectory() as folder:
        path = Path(folder, "run.npz")
        entry = np.frombuffer(json.dumps(header).encode(), np.uint8)
        np.savez(path, **saved()[2] | {"header": entry})
        try:
            found = read_checkpoint(path)
        except InputError as refusal:
            require_one_line(refusal)
            return
        assert all(
            type(value) is type(getattr(saved()[1].statistics, name)) or isinstance(value, int)
            for name, value in asdict(found.statistics).items()
        )
        Simulation(found.scene, threads=1).restore(found.state)


test_headers = fuzzed(check_header, st.deferred(headers))


@cache
def recordings():
    """Return suffix and content of recordings of every kind."""
    with TemporaryDirectory() as folder:
        drawings = [(".usdc", "discs"), (".usdz", "discs"), (".usda", "points"), (".usdc", "spheres")]
        paths = [Path(folder, f"{draw_as}{suffix}") for suffix, draw_as in drawings]
        for path in paths:
            drawn = {"forces": True, "color_by": "pressure"} if path.suffix == ".usdc" else {}
            record(path, make_frames(2), draw_as=path.stem, **drawn)
        return [(path.suffix, path.read_bytes()) for path in paths]


@st.composite
def usd_files(draw):
    """Return the suffix and the content of a file that is damaged or foreign."""
    foreign = [(".usda", text.encode()) for text in FOREIGN.values()]
    suffix, content = draw(st.sampled_from(recordings()) | st.sampled_from(foreign))
    if suffix == ".usda" and draw(st.integers(0, 3)):
        return suffix, draw(reworded_texts(content.decode()))
    return draw(st.sampled_from([suffix] * 9 + [*RECORDINGS])), draw(mutations(content))


def check_recording(example):
    """`check` first, in a child: what crashes it would also crash the drawing."""
    suffix, content = example
    with TemporaryDirectory() as folder:
        path, picture = Path(folder, f"run{suffix}"), Path(folder, "run.png")
        path.write_bytes(content)
        try:
            check(Namespace(file=str(path)))
            plot(path, picture)
            picture.unlink()
        except InputError as refusal:
            require_one_line(refusal)
            if "its reader" not in str(refusal):
                with pytest.raises(InputError):
                    plot(path, picture)
        assert list(Path(folder).iterdir()) == [path]
        assert path.read_bytes() == content


test_recordings = fuzzed(check_recording, st.deferred(usd_files), few=4)
