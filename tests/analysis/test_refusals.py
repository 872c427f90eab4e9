"""Commands of pictures, pages, reports, exports and series refuse bad input in one line, writing nothing."""

import shlex
import sys

import pytest
from command import exit_code, require_refusal
from recordings import make_frames, record

BAD = [
    ("plot missing.usdc", "'missing.usdc' does not exist"),
    ("plot text.usdc", "is not a USD file that can be read"),
    ("plot empty.usda", "holds no grains"),
    ("plot run.usdc --frames 0,x", "'0,x' is not a list of whole numbers"),
    ("plot run.usdc --frames 7", "frame 7 does not exist"),
    ("plot run.usdc -o picture.bmp", "must end in .png, .pdf, .svg"),
    ("plot run.usdc -o run.mp4 --frames 1", "have no effect on a film"),
    ("plot run.usdc -o run.mp4 --no-curves", "have no effect on a film"),
    ("export no.usdc", "does not exist"),
    ("export run.usdc -o run.vtk", "must end in .vtkhdf"),
    ("view nothing", "nothing"),
    ("view no.usdc", "'no.usdc' does not exist"),
    ("view no.usdc --set time.dt=1", "--set has no effect on a recording"),
    ("view annulus --port 0", "--port"),
    ("report anulus -o new", "annulus"),
    ("report annulus annulus -o new", "annulus"),
    ("report annulus -o text.usdc", "cannot be created"),
    ("run annulus --measure energy", "--measure has no effect without --series"),
    ("run annulus --series run.csv", "--series has no effect without --measure"),
    ("run annulus --measure energi --series run.csv", "did you mean 'energy'"),
    ("run annulus --measure '' --series run.csv", "unknown quantity ''"),
    ("run annulus --measure energy --series run.txt", "must end in .csv"),
    ("run annulus --measure energy --series run.csv --every 0", "every is 0"),
    ("run annulus --every 3", "--every has no effect without --checkpoint or --measure"),
]
MISSING = [
    ("plot run.usdc", "matplotlib.axes", "plot needs matplotlib.axes: pip install 'warpgrains[report]'"),
    ("run annulus -o run.mp4", "matplotlib.axes", "needs matplotlib.axes: pip install 'warpgrains[film]'"),
    ("run annulus -o run.mp4", "imageio_ffmpeg", "needs imageio_ffmpeg: pip install 'warpgrains[film]'"),
    ("view annulus", "viser", "view needs viser: pip install 'warpgrains[view]'"),
    *(
        ("report annulus -o new", library, f"report needs {library}: pip install 'warpgrains[report]'")
        for library in ("matplotlib", "scipy", "clarabel")
    ),
]


@pytest.mark.parametrize(
    ("command", "library", "complaint"),
    [*((command, None, complaint) for command, complaint in BAD), *MISSING],
)
def test_it_is_one_line(tmp_path, monkeypatch, capfd, command, library, complaint):
    monkeypatch.chdir(tmp_path)
    record(tmp_path / "run.usdc", make_frames(3))
    (tmp_path / "text.usdc").write_text("no stage")
    (tmp_path / "empty.usda").write_text("#usda 1.0\n")
    if library is not None:
        monkeypatch.delitem(sys.modules, "warpgrains.analysis.plots", raising=False)
        monkeypatch.setitem(sys.modules, library, None)
    capfd.readouterr()
    assert exit_code(*shlex.split(command)) == 2
    require_refusal(capfd, complaint)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty.usda", "run.usdc", "text.usdc"]
