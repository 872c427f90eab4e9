"""What a recording may replace."""

import pytest
from command import exit_code, require_refusal
from pxr import Usd
from recordings import make_frames, record

from warpgrains.errors import OutputError
from warpgrains.usd.recorder import log_of, recover


def someones_work(path):
    """Write a stage that is no recording."""
    stage = Usd.Stage.CreateNew(str(path))
    stage.DefinePrim("/House", "Xform")
    stage.Save()


@pytest.mark.parametrize("suffix", [".usdc", ".usda", ".usdz"])
def test_what_is_no_recording_is_not_replaced(tmp_path, suffix, capfd):
    path = tmp_path / f"run{suffix}"
    for content in (b"", b"old", b"PXR-USDC" + bytes(200), b"#usda 1.0\n", b"PK\x03\x04"):
        path.write_bytes(content)
        assert exit_code("run", "annulus", "--steps", 1, "-o", path) == 2
        require_refusal(capfd, "not a recording of warpgrains")
        assert path.read_bytes() == content
    assert list(tmp_path.iterdir()) == [path]


def test_stage_of_someone_else_is_not_replaced(tmp_path):
    someones_work(tmp_path / "run.usdc")
    before = (tmp_path / "run.usdc").read_bytes()
    with pytest.raises(OutputError, match="refusing to overwrite"):
        record(tmp_path / "run.usdc", make_frames(2))
    assert (tmp_path / "run.usdc").read_bytes() == before
    record(tmp_path / "other.usdc", make_frames(2))
    log_of(tmp_path / "run.usdc").touch()
    with pytest.raises(OutputError, match="refusing to overwrite"):
        recover(log_of(tmp_path / "run.usdc"))


@pytest.mark.parametrize("suffix", [".usdc", ".usda", ".usdz", ".USDC", ".Usdz"])
def test_recording_is_replaced(tmp_path, suffix):
    path = record(tmp_path / f"run{suffix}", make_frames(2))
    before = path.read_bytes()
    record(path, make_frames(3))
    assert path.read_bytes() != before
