"""Recordings whose process is killed or whose disk is full: what was whole stays whole."""

import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import endless_recording
import lightusd
import numpy as np
import pytest
from recordings import GRAINS
from trimmed import trimmed

import warpgrains
from warpgrains.errors import InputError
from warpgrains.usd.check import inspect_recording
from warpgrains.usd.recorder import log_of, recover

SCRIPT = Path(endless_recording.__file__)
GRAIN_COUNT = 400


class Recording:
    """A recording process, and what it leaves."""

    def __init__(self, folder, frames, **limits):
        self.path = folder / "run.usdc"
        self.counter = folder.parent / f"{folder.name}.counter"
        self.counter.write_bytes(bytes(8))
        command = [sys.executable, SCRIPT, self.path, GRAIN_COUNT, frames, self.counter]
        self.process = subprocess.Popen(
            [str(word) for word in command],
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONPATH": str(Path(warpgrains.__file__).parent.parent)},
            **limits,
        )

    @property
    def recorded(self):
        return int.from_bytes(self.counter.read_bytes(), "little")

    def wait_for_frames(self, least):
        while self.recorded < least and self.process.poll() is None:
            time.sleep(0.001)

    def left_frames(self, folder):
        """Check that every file that has a name is whole, and return how many frames there are.

        The log is copied to `folder` first, where there is room for a file of all its frames.
        """
        if self.path.exists():
            return require_frames(self.path)
        log = log_of(self.path)
        if not log.exists():
            return 0
        path, frames = recover(shutil.copy(log, folder))
        assert require_frames(path) == frames
        return frames


def require_frames(path):
    """Check each frame against what was recorded, by an independent reader, and return their number."""
    assert inspect_recording(path) == []
    points = lightusd.load(str(path)).prim_at(GRAINS).attribute("points")
    for number in range(len(points.timesamples)):
        expected = endless_recording.frame(number, GRAIN_COUNT)[0].astype(np.float32)
        assert np.array_equal(np.asarray(points.get(time=number))[:, :2], expected)
    return len(points.timesamples)


def kill_at(tmp_path, wanted, wait):
    folder, room = tmp_path / "run", tmp_path / "room"
    folder.mkdir()
    room.mkdir()
    recording = Recording(folder, frames=2_000)
    recording.wait_for_frames(wanted)
    time.sleep(wait)
    recording.process.kill()
    recording.process.communicate()
    recorded = recording.recorded
    assert recorded >= wanted
    assert recording.left_frames(room) >= recorded
    shutil.rmtree(folder)
    shutil.rmtree(room)
    return recorded


@pytest.mark.parametrize("wanted", [1, 99, 350])
def test_killed_run_loses_no_frame(tmp_path, wanted):
    assert kill_at(tmp_path, wanted, wait=0.0) < 2_000


@pytest.mark.slow
def test_killed_at_random_moments(tmp_path):
    random = np.random.default_rng(3)
    moments = [(random.integers(2_001), random.uniform(0, 0.02)) for _ in range(trimmed(40))]
    recorded = [kill_at(tmp_path, *moment) for moment in moments]
    assert len(set(recorded)) > len(moments) // 2


def fill(tmp_path, folder, **limits):
    """Record where not all fits, and return the complaint and the frames that are left."""
    room = tmp_path / "room"
    room.mkdir()
    recording = Recording(folder, frames=500, **limits)
    complaint = recording.process.communicate()[1]
    frames = recording.left_frames(room)
    assert recording.process.returncode == (0 if frames == 500 and recording.path.exists() else 1)
    assert frames == recording.recorded or (frames, recording.recorded) == (0, 1)
    shutil.rmtree(room)
    return complaint, frames


@pytest.mark.parametrize("largest", [20e3, 2e6], ids=["first frame", "later"])
def test_full_disk_is_one_clear_error(tmp_path, largest):
    folder = tmp_path / "run"
    folder.mkdir()

    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(largest), int(largest)))

    complaint, left = fill(tmp_path, folder, preexec_fn=limit)
    assert (left > 50) == (largest > 1e6)
    last = complaint.splitlines()[-1]
    assert last.startswith("OSError: '")
    assert "cannot be written" in last
    if not left:
        assert list(folder.iterdir()) == []


@pytest.mark.slow
def test_full_disk_at_random_fills(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    random = np.random.default_rng(4)
    left = []
    for _ in range(trimmed(20)):
        size = f"size={random.integers(100, 10_000)}k"
        mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", size, "tmpfs", folder], capture_output=True)
        if mounted.returncode:
            pytest.skip("only root can mount a small disk")
        try:
            left.append(fill(tmp_path, folder)[1])
        finally:
            subprocess.run(["umount", folder], check=True)
    assert len(set(left)) >= len(left) // 4


def test_recover_needs_frames(tmp_path):
    with pytest.raises(InputError, match="is not the log of a recording"):
        recover(tmp_path / "run.usdc")
    log = tmp_path / "run.usdc.frames"
    with pytest.raises(InputError, match="is not the log of a recording"):
        recover(log)
    for content in (b"", b"PK", b"warpgrains frames 1\n", bytes(100)):
        log.write_bytes(content)
        with pytest.raises(InputError, match="is not a log of frames"):
            recover(log)
    assert list(tmp_path.iterdir()) == [log]
