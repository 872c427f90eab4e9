"""`check` and `plot` on USD files that no recorder wrote: one line, or what is wrong, and nothing else."""

import os
from time import monotonic

import pytest
from command import answer, exit_code, small_disk
from forks import ForkServer
from recordings import make_frames, record

from warpgrains import InputError
from warpgrains.analysis.plots import plot
from warpgrains.analysis.recording import Recording
from warpgrains.cli import sandboxed
from warpgrains.usd.check import inspect_recording

POINTS = '#usda 1.0\ndef Xform "World" {{\n  def Points "Grains" {{\n{}\n  }}\n}}\n'
INSTANCER = POINTS.replace("def Points", "def PointInstancer")

FOREIGN = {
    "nothing": "#usda 1.0\n",
    "string samples": POINTS.format('    string points.timeSamples = {0: "here", 1: "there"}'),
    "scalar points": POINTS.format("    point3f points.timeSamples = {0: (1, 2, 3)}"),
    "number as points": POINTS.format("    float points.timeSamples = {0: 1.0}"),
    "points only": POINTS.format("    point3f[] points.timeSamples = {0: [(1, 2, 3)]}"),
    "blocked": POINTS.format("    point3f[] points.timeSamples = {0: None}"),
    "empty": POINTS.format("    point3f[] points.timeSamples = {0: []}\n    float[] widths = []"),
    "nan": POINTS.format(
        "    point3f[] points.timeSamples = {0: [(nan, inf, 3)]}\n    float[] widths = [nan]"
    ),
    "no widths": POINTS.format(
        "    point3f[] points.timeSamples = {0: [(1, 2, 3)]}\n    string widths = 'broad'"
    ),
    "other lengths": POINTS.format(
        "    point3f[] points.timeSamples = {0: [(1, 2, 3)], 1: [(1, 2, 3), (2, 3, 4)]}\n"
        "    vector3f[] velocities.timeSamples = {0: []}\n    float[] widths = [1, 2, 3]\n    int[] ids = [1]"
    ),
    "half codes": POINTS.format("    point3f[] points.timeSamples = {-1e300: [(1, 2, 3)], 0.5: [(1, 2, 3)]}"),
    "positions only": INSTANCER.format("    point3f[] positions.timeSamples = {0: [(1, 2, 3)]}"),
    "scales as text": INSTANCER.format(
        "    point3f[] positions.timeSamples = {0: [(1, 2, 3)]}\n    string scales = 'large'"
    ),
    "reference to nothing": '#usda 1.0\ndef "World" (references = @./none.usda@) {}\n',
    "reference to itself": '#usda 1.0\ndef "World" (references = @./foreign.usda@</World>) {}\n',
    "cut off": POINTS.format("")[:40],
    "binary without content": "PXR-USDC",
}


@pytest.fixture(scope="module")
def forks():
    with ForkServer() as forks:
        yield forks


@pytest.mark.parametrize("content", FOREIGN.values(), ids=FOREIGN.keys())
def test_foreign_file(tmp_path, content, capfd, monkeypatch, forks):
    monkeypatch.setattr(sandboxed.subprocess, "run", forks.run)
    path = tmp_path / "foreign.usda"
    path.write_text(content)
    assert answer(capfd, "check", path)[0] in (1, 2)
    for command, output in (("plot", "foreign.png"), ("plot", "foreign.gif"), ("export", "foreign.pvd")):
        code, _, complaint = answer(capfd, command, path, "-o", tmp_path / output)
        assert (code == 0) == (tmp_path / output).exists()
        assert "or failed" not in complaint


@pytest.mark.parametrize("content", FOREIGN.values(), ids=FOREIGN.keys())
def test_foreign_file_in_python(tmp_path, content):
    path = tmp_path / "foreign.usda"
    path.write_text(content)
    for read in (inspect_recording, Recording, lambda path: plot(path, tmp_path / "foreign.png")):
        try:
            said = repr(read(path))
        except InputError as refusal:
            said = str(refusal)
        assert "\n" not in said


@pytest.mark.parametrize(("name", "kind"), [("scalar points", "Vec3f"), ("scales as text", "str")])
def test_what_is_foreign_is_named(tmp_path, name, kind):
    path = tmp_path / "foreign.usda"
    path.write_text(FOREIGN[name])
    with pytest.raises(InputError, match=f"is a {kind}, not an array of numbers"):
        inspect_recording(path)


def test_file_that_crashes_its_reader(tmp_path, capfd):
    path = tmp_path / "deep.usda"
    path.write_text("#usda 1.0\n" + 'def "A" {' * 100_000 + "}" * 100_000)
    for command in ("check", "plot"):
        assert answer(capfd, command, path)[0] == 2


def test_file_that_hangs_its_reader(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(sandboxed, "SECONDS", 1.0)
    os.mkfifo(tmp_path / "fifo.usda")
    path = tmp_path / "hanging.usda"
    path.write_text(f'#usda 1.0\ndef "World" (references = @{tmp_path}/fifo.usda@) {{}}\n')
    start = monotonic()
    assert exit_code("check", path) == 2
    assert monotonic() - start < 20.0
    assert "could not be read, or drawn, within 1 s" in capfd.readouterr().err


def test_file_that_takes_too_much_memory(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(sandboxed, "BYTES", 2**20)
    path = record(tmp_path / "run.usdc", make_frames(2))
    assert exit_code("check", path) == 2
    assert "takes more memory than its size allows" in capfd.readouterr().err


def test_picture_that_cannot_be_written(tmp_path, capfd):
    path = record(tmp_path / "run.usdc", make_frames(2))
    with small_disk(1000):
        assert exit_code("plot", path) == 1
    picture = path.with_suffix(".png")
    assert capfd.readouterr().err == f"warpgrains: error: '{picture}' cannot be written: File too large\n"
    assert list(tmp_path.iterdir()) == [path]
