"""`check` and `plot` on USD files that no recorder wrote: one line, or what is wrong, and nothing else."""

import os
from time import monotonic

import pytest
from command import exit_code
from recordings import make_frames, record

from warpgrains.cli import apart

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


def require_answer(capfd, code):
    """Check that the command said what is wrong, or what it did, and nothing else."""
    printed = capfd.readouterr()
    assert "Traceback" not in printed.out + printed.err
    if code == 2:
        assert printed.out == ""
        assert printed.err.startswith("warpgrains: error: ")
        assert printed.err.count("\n") == 1, printed.err
    else:
        assert printed.out


@pytest.mark.parametrize("content", FOREIGN.values(), ids=FOREIGN.keys())
def test_foreign_file(tmp_path, content, capfd):
    path = tmp_path / "foreign.usda"
    path.write_text(content)
    code = exit_code("check", path)
    assert code in (1, 2)
    require_answer(capfd, code)
    code = exit_code("plot", path)
    require_answer(capfd, code)
    assert code == 2 or (tmp_path / "foreign.png").exists()


def test_file_that_crashes_its_reader(tmp_path, capfd):
    path = tmp_path / "deep.usda"
    path.write_text("#usda 1.0\n" + 'def "A" {' * 100_000 + "}" * 100_000)
    for command in ("check", "plot"):
        assert exit_code(command, path) == 2
        require_answer(capfd, 2)


def test_file_that_hangs_its_reader(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(apart, "SECONDS", 3.0)
    os.mkfifo(tmp_path / "fifo.usda")
    path = tmp_path / "hanging.usda"
    path.write_text('#usda 1.0\ndef "World" (references = @./fifo.usda@) {}\n')
    start = monotonic()
    assert exit_code("check", path) == 2
    assert monotonic() - start < 20.0
    assert "is not read within 3 s" in capfd.readouterr().err


def test_file_that_takes_too_much_memory(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(apart, "BYTES", 2**20)
    path = record(tmp_path / "run.usdc", make_frames(2))
    assert exit_code("check", path) == 2
    assert "takes more memory than its size allows" in capfd.readouterr().err
