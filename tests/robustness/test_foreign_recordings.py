"""USD files that no recorder wrote: the readers find what is wrong, and print nothing else."""

import os

import pytest
from command import exit_code, require_refusal

from warpgrains import InputError
from warpgrains.analysis.plots import plot
from warpgrains.analysis.vtk import export
from warpgrains.cli import check
from warpgrains.pictures.film import draw_film
from warpgrains.usd.check import inspect_recording
from warpgrains.usd.recording import Recording


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
