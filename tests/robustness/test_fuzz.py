"""Mutated and foreign files: one line or a right result, never anything else. More of it with -m slow."""

import json
import os
import re
from argparse import Namespace
from contextlib import contextmanager
from dataclasses import asdict
from functools import cache
from io import BytesIO
from math import inf, nan
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from command import exit_code, require_refusal
from hypothesis import given
from hypothesis import strategies as st
from recordings import make_frames, record
from same_bits import contents
from sample_scenes import SCENE_FILE
from trimmed import few_or_many

from warpgrains import InputError, Scene, Simulation
from warpgrains.analysis.plots import plot
from warpgrains.analysis.vtk import export
from warpgrains.cli import check
from warpgrains.drawing.kinds import RECORDINGS
from warpgrains.pictures.film import draw_film
from warpgrains.scene.reader import document_fields, scene_document
from warpgrains.simulation.checkpoint import read_checkpoint
from warpgrains.usd.check import inspect_recording
from warpgrains.usd.recording import Recording

CSV = "x,y,vx,vy,radius,mass\n0.7,0.0,0.1,0.0,0.1,0.1\n0.0,0.7,0.0,-0.2,0.05,0.2\n"
NUMBER = re.compile(r"[-+]?\d[\w.+-]*")
NUMBERS = ["nan", "-inf", "1e39", "1e308", "-0.0", "0", "-1", "2147483648", "9" * 40]
ODD = ["'x'", "true", "[]", "{}", "[[]]", "1979-05-27", "\\", "\0"]
ODD_JSON = (None, True, -1, 0, 1.5, nan, inf, 10**30, "", "x", "../x", [], [1], {}, {"a": 1})
EIGHT = [b"\xff" * 8, bytes(8), *((2**power).to_bytes(8, "little") for power in (20, 31, 40, 63))]


@st.composite
def mutations(draw, original):
    """Return bytes of which up to four places, which may be anywhere, are replaced, left out or cut off."""
    content, anywhere = bytearray(original), draw(st.randoms(use_true_random=True))
    for _ in range(draw(st.integers(1, 4))):
        place = anywhere.randint(0, len(content))
        end = draw(st.sampled_from([place, place + 1, place + 1, place + 8, place + 20, len(content)]))
        content[place:end] = draw(st.binary(max_size=3) | st.sampled_from(EIGHT))
    return bytes(content)


@st.composite
def reworded_texts(draw, text):
    """Return a text in which some names stand for other names of it, and numbers for other or odd values."""
    parts, anywhere = re.split(r"([\w.+-]+)", text), draw(st.randoms(use_true_random=True))
    words = parts[1::2]
    values = [word for word in words if NUMBER.fullmatch(word)] + NUMBERS + ODD
    names = [word for word in words if not NUMBER.fullmatch(word)]
    for _ in range(draw(st.integers(1, 3))):
        place = anywhere.randrange(len(words))
        words[place] = anywhere.choice(values if NUMBER.fullmatch(words[place]) else names)
    parts[1::2] = words
    return "".join(parts).encode()


def fuzzed(check, examples, few=200):
    """Return the tests of a check that takes one example."""

    def test(how):
        how(given(examples)(check))()

    return few_or_many(few, 10_000)(test)


@contextmanager
def file_of(name, content):
    """Check that what reads a file returns, or refuses it in one line, and leaves it alone there."""
    with TemporaryDirectory() as folder:
        path = Path(folder, name)
        path.write_bytes(content)
        message = "refused"
        try:
            yield path
        except InputError as refusal:
            message = str(refusal)
        assert message.count("\n") == 0 < len(message), message
        assert list(path.parent.iterdir()) == [path]
        assert path.read_bytes() == content


def scene_of(text, path):
    document, own = scene_document(text, path)
    return Scene(**document_fields(document, path.parent), **own)


def check_scene(content):
    with file_of("scene.toml", content) as path:
        scene = Scene.load(path)
        assert np.isfinite(scene.position).all()
        assert contents(scene_of(scene.text, path)) == contents(scene)


def check_grains(content):
    with file_of("grains.csv", content) as path:
        document = 'domain = {radius_out = 1.0}\n[grains]\nfile = "grains.csv"'
        assert scene_of(document, path.with_name("scene.toml")).n > 0


test_scene_files = fuzzed(check_scene, mutations(SCENE_FILE.encode()) | reworded_texts(SCENE_FILE))
test_grain_files = fuzzed(check_grains, mutations(CSV.encode()))


@cache
def saved():
    """Return the bytes of a checkpoint, what is read of it, and its entries."""
    with TemporaryDirectory() as folder:
        simulation, path = Simulation("annulus"), Path(folder, "run.npz")
        simulation.run(steps=60, checkpoint=path)
        with np.load(path) as entries:
            return path.read_bytes(), read_checkpoint(path), dict(entries)


def check_checkpoint(content):
    with file_of("run.npz", content) as path:
        assert contents(read_checkpoint(path).state) == contents(saved()[1].state)


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
    entry, file = np.frombuffer(json.dumps(header).encode(), np.uint8), BytesIO()
    np.savez(file, **saved()[2] | {"header": entry})
    with file_of("run.npz", file.getvalue()) as path:
        found = read_checkpoint(path)
        for name, value in asdict(found.statistics).items():
            assert isinstance(value, (int, type(getattr(saved()[1].statistics, name))))
        Simulation(found.scene, threads=1).restore(found.state)


test_damaged_checkpoints = fuzzed(check_checkpoint, st.deferred(lambda: mutations(saved()[0])))
test_headers = fuzzed(check_header, st.deferred(headers))


def grains(*attributes, kind="Points"):
    """Return a stage with grains of these attributes."""
    lines = "\n".join(attributes)
    return f'#usda 1.0\ndef Xform "World" {{\n  def {kind} "Grains" {{\n{lines}\n  }}\n}}\n'


ONE = "point3f[] points.timeSamples = {0: [(1, 2, 3)]}"
TWO = "point3f[] points.timeSamples = {0: [(1, 2, 3)], 1: [(1, 2, 3), (2, 3, 4)]}"
PLACED = "point3f[] positions.timeSamples = {0: [(1, 2, 3)]}"
FOREIGN = {
    "nothing": "#usda 1.0\n",
    "string samples": grains('string points.timeSamples = {0: "here", 1: "there"}'),
    "scalar points": grains("point3f points.timeSamples = {0: (1, 2, 3)}"),
    "number as points": grains("float points.timeSamples = {0: 1.0}"),
    "points only": grains(ONE),
    "blocked": grains("point3f[] points.timeSamples = {0: None}"),
    "empty": grains("point3f[] points.timeSamples = {0: []}", "float[] widths = []"),
    "nan": grains("point3f[] points.timeSamples = {0: [(nan, inf, 3)]}", "float[] widths = [nan]"),
    "no widths": grains(ONE, "string widths = 'broad'"),
    "other lengths": grains(
        TWO, "vector3f[] velocities.timeSamples = {0: []}", "float[] widths = [1, 2, 3]", "int[] ids = [1]"
    ),
    "half codes": grains("point3f[] points.timeSamples = {-1e300: [(1, 2, 3)], 0.5: [(1, 2, 3)]}"),
    "positions only": grains(PLACED, kind="PointInstancer"),
    "scales as text": grains(PLACED, "string scales = 'large'", kind="PointInstancer"),
    "reference to nothing": '#usda 1.0\ndef "World" (references = @./none.usda@) {}\n',
    "reference to itself": '#usda 1.0\ndef "World" (references = @./foreign.usda@</World>) {}\n',
    "cut off": grains("")[:40],
    "binary without content": "PXR-USDC",
}


@cache
def recordings():
    """Return suffix and content of recordings of every kind."""
    with TemporaryDirectory() as folder:
        paths = [Path(folder, name) for name in ("discs.usdc", "discs.usdz", "points.usda", "spheres.usdc")]
        for path in paths:
            record(
                path, make_frames(2), draw_as=path.stem, forces=path.suffix == ".usdc", color_by="pressure"
            )
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
    with file_of(f"run{suffix}", content) as path:
        picture = path.with_suffix(".png")
        try:
            check.check(Namespace(file=[str(path)]))
        except InputError as refusal:
            if "its reader" not in str(refusal):
                with pytest.raises(InputError):
                    plot(path, picture)
            raise
        plot(path, picture)
        picture.unlink()


test_recordings = fuzzed(check_recording, st.deferred(usd_files), few=4)


NAMED = {
    "scalar points": "is a Vec3f, not an array of numbers",
    "scales as text": "is a str, not an array of numbers",
}


@pytest.mark.parametrize("name", FOREIGN)
def test_foreign_file(tmp_path, name, capfd):
    path = tmp_path / "foreign.usda"
    path.write_text(FOREIGN[name])
    outputs = {plot: "foreign.png", draw_film: "foreign.gif", export: "foreign.pvd"}
    for read in (inspect_recording, Recording, *outputs):
        given = [tmp_path / outputs[read]] if read in outputs else []
        try:
            said = repr(read(path, *given))
        except InputError as refusal:
            said = str(refusal)
            assert "\n" not in said
        if read is inspect_recording:
            assert NAMED.get(name, "") in said
        assert list(tmp_path.iterdir()) == [path]
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("content", "limit", "complaint"),
    [
        ('def "A" {' * 100_000 + "}" * 100_000, {}, "its reader crashes (SIGSEGV)"),
        ('def "World" (references = @./fifo.usda@) {}', {"SECONDS": 1.0}, "it is not read within 1 s"),
        ('def "World" (references = @./fifo.usda@) {}', {"BYTES": 2**20}, "its reader "),
    ],
    ids=["crash", "hanging", "memory"],
)
def test_file_that_ends_its_reader(tmp_path, capfd, monkeypatch, content, limit, complaint):
    for name, value in limit.items():
        monkeypatch.setattr(check, name, value)
    os.mkfifo(tmp_path / "fifo.usda")
    path = tmp_path / "bad.usda"
    path.write_text(f"#usda 1.0\n{content}".replace("./fifo", f"{tmp_path}/fifo"))
    assert exit_code("check", path) == 2
    require_refusal(capfd, f"recording '{path}' is damaged: {complaint}")
