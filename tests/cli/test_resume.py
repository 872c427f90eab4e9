"""Runs that were interrupted or killed, and resumed: the same bits as if nothing had happened."""

import json

import lightusd
import numpy as np
import pytest
from command import exit_code, require_refusal
from recordings import GRAINS
from same_bits import contents

from warpgrains import Simulation
from warpgrains.frame_log import FrameLog
from warpgrains.simulation.checkpoint import read_checkpoint
from warpgrains.usd.check import inspect_recording
from warpgrains.usd.recorder import log_of


def run(*arguments):
    return exit_code("run", *arguments)


def summary_of(capfd):
    summary = json.loads(capfd.readouterr().out)
    return {name: value for name, value in summary.items() if name not in ("seconds", "output")}


@pytest.mark.parametrize(("order", "suffix"), [("color", ".usda"), ("sequential", ".usdz")])
def test_longer_run_than_was_planned(order, tmp_path, suffix):
    whole, parts = tmp_path / f"whole{suffix}", tmp_path / f"parts{suffix}"
    common = ["annulus", "--order", order, "--fps", 50, "--steps"]
    assert run(*common, 60, "-o", whole) == 0
    assert run(*common, 25, "-o", parts, "--checkpoint", tmp_path / "run.npz") == 0
    assert run("--resume", tmp_path / "run.npz", "--duration", 0.6) == 0
    assert not log_of(parts).exists()
    assert same_frames(parts, whole) == 31


def same_frames(one, other):
    """Return how many frames two recordings have, which an independent reader finds equal."""
    assert inspect_recording(one) == inspect_recording(other) == []
    grains = [lightusd.load(str(path)).prim_at(GRAINS) for path in (one, other)]
    for name in ("points", "velocities", "primvars:displayColor:indices"):
        ours, theirs = (prim.attribute(name) for prim in grains)
        assert ours.timesamples.times == theirs.timesamples.times == tuple(range(len(ours.timesamples)))
        for code in ours.timesamples.times:
            assert np.array_equal(np.asarray(ours.get(code)), np.asarray(theirs.get(code)))
    return len(ours.timesamples)


class TestResumeOnce:
    def test_finished_run_stays_as_it_is(self, tmp_path, capfd):
        output, kept = tmp_path / "run.usdc", tmp_path / "run.npz"
        assert run("annulus", "--steps", 30, "-o", output, "--checkpoint", kept, "--json") == 0
        expected, before = summary_of(capfd), output.stat()
        assert run("--resume", kept, "--json") == 0
        assert summary_of(capfd) == expected
        assert (output.stat().st_ino, output.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)

    def test_frames_of_a_stopped_run_become_a_file(self, tmp_path, stop_at, capfd):
        output = tmp_path / "run.usdc"
        stop_at(15)
        options = ["-o", output, "--checkpoint", tmp_path / "run.npz", "--every", 5, "--fps", 100]
        assert run("annulus", *options) == 130
        capfd.readouterr()
        assert exit_code("recover", log_of(output)) == 0
        assert capfd.readouterr().out == f"{output}: 16 frames\n"
        assert inspect_recording(output) == []
        assert exit_code("recover", output) == 2

    def test_both_files_may_move(self, tmp_path, stop_at, monkeypatch):
        here, there = tmp_path / "here", tmp_path / "there"
        here.mkdir()
        monkeypatch.chdir(here)
        stop_at(15)
        assert (
            run("annulus", "--steps", 30, "-o", "run.usdc", "--checkpoint", "run.npz", "--every", 10) == 130
        )
        monkeypatch.chdir(tmp_path)
        here.rename(there)
        assert run("--resume", there / "run.npz") == 0
        assert sorted(path.name for path in there.iterdir()) == ["run.npz", "run.usdc"]
        assert inspect_recording(there / "run.usdc") == []

    def test_saved_state_goes_on_to_the_end_of_its_scene(self, tmp_path, capfd):
        simulation = Simulation("annulus", duration=0.5)
        simulation.run(steps=20)
        simulation.save(tmp_path / "saved.npz")
        before = (tmp_path / "saved.npz").read_bytes()
        for options in ([], ["--checkpoint", tmp_path / "end.npz"]):
            assert run("--resume", tmp_path / "saved.npz", "--json", *options) == 0
            assert json.loads(capfd.readouterr().out)["steps"] == 30
            assert (tmp_path / "saved.npz").read_bytes() == before
        simulation.run(steps=30)
        assert contents(read_checkpoint(tmp_path / "end.npz").state) == contents(simulation.state())

    def test_checkpoint_counts_no_frame_that_is_not_on_the_disk(self, tmp_path, monkeypatch):
        """Where frames cannot be written, the checkpoint before them stays; the run goes on from there."""
        output, kept = tmp_path / "run.usdc", tmp_path / "run.npz"
        append = FrameLog.append

        def fill_the_disk(log, arrays):
            if log.frames > 10:
                raise OSError("disk full")
            append(log, arrays)

        with monkeypatch.context() as patch:
            patch.setattr(FrameLog, "append", fill_the_disk)
            options = ["-o", output, "--fps", 50, "--checkpoint", kept, "--every", 10]
            assert run("annulus", "--steps", 60, *options) == 1
        statistics = read_checkpoint(kept).statistics
        assert (statistics.steps, statistics.frames) == (20, 11)
        assert run("--resume", kept) == 0
        assert run("annulus", "--steps", 60, "--fps", 50, "-o", tmp_path / "whole.usdc") == 0
        assert same_frames(output, tmp_path / "whole.usdc") == 31

    @pytest.mark.parametrize("found", ["nothing", "something else"])
    def test_recording_that_is_not_there(self, tmp_path, stop_at, capfd, found):
        output, kept = tmp_path / "run.usdc", tmp_path / "run.npz"
        stop_at(20)
        assert run("annulus", "--steps", 30, "-o", output, "--checkpoint", kept, "--every", 10) == 130
        log_of(output).unlink()
        if found == "something else":
            assert run("column", "--steps", 19, "-o", output) == 0
        capfd.readouterr()
        assert run("--resume", kept) == 2
        require_refusal(capfd, "run.usdc.frames" if found == "nothing" else "holds frames of another scene")
