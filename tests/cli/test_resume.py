"""Runs that were interrupted or killed, and resumed: the same bits as if nothing had happened."""

import json
import shutil
from dataclasses import replace

import lightusd
import numpy as np
import pytest
from command import exit_code
from recordings import GRAINS
from same_bits import contents

from warpgrains import Simulation
from warpgrains.base.files import read_table
from warpgrains.base.frame_log import FrameLog
from warpgrains.simulation.checkpoint import read_checkpoint
from warpgrains.usd.check import inspect_recording
from warpgrains.usd.recorder import log_of


def run(*arguments):
    return exit_code("run", *arguments)


def same_frames(one, other):
    """Return how many frames two recordings have, which an independent reader finds equal."""
    assert inspect_recording(one) == inspect_recording(other) == []
    grains = [lightusd.load(str(path)).prim_at(GRAINS) for path in (one, other)]
    for name in ("points", "velocities", "primvars:speed"):
        ours, theirs = (prim.attribute(name) for prim in grains)
        assert ours.timesamples.times == theirs.timesamples.times == tuple(range(len(ours.timesamples)))
        for code in ours.timesamples.times:
            assert np.array_equal(np.asarray(ours.get(code)), np.asarray(theirs.get(code)))
    return len(ours.timesamples)


@pytest.mark.parametrize(("order", "suffix"), [("color", ".usda"), ("sequential", ".usdz")])
def test_longer_run_than_was_planned(order, tmp_path, capfd, suffix):
    """And a finished run stays as it is."""
    whole, parts, kept = tmp_path / f"whole{suffix}", tmp_path / f"parts{suffix}", tmp_path / "run.npz"
    common = ["annulus", "--order", order, "--fps", 50, "--steps"]
    assert run(*common, 60, "-o", whole) == 0
    capfd.readouterr()
    assert run(*common, 25, "-o", parts, "--checkpoint", kept, "--json") == 0
    before = parts.stat()
    assert run("--resume", kept, "--json") == 0
    first, again = map(json.loads, capfd.readouterr().out.splitlines())
    assert again | {"seconds": first["seconds"]} == first
    assert (parts.stat().st_ino, parts.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    assert run("--resume", kept, "--duration", 0.6) == 0
    assert not log_of(parts).exists()
    assert same_frames(parts, whole) == 31


def test_an_interrupted_run_is_recovered_or_continued_elsewhere(tmp_path, stop_at, monkeypatch, capfd):
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    monkeypatch.chdir(here)
    stop_at(15)
    files = ["-o", "run.usdc", "--checkpoint", "kept one.npz"]
    assert run("annulus", "--steps", 30, "--every", 5, "--fps", 100, *files) == 130
    assert capfd.readouterr().err.splitlines()[-1] == (
        "warpgrains: error: interrupted; to continue: warpgrains run --resume 'kept one.npz';"
        " to recover the frames so far: warpgrains recover run.usdc.frames"
    )
    monkeypatch.chdir(tmp_path)
    shutil.copytree(here, there)
    assert exit_code("recover", "here/run.usdc.frames") == 0
    assert capfd.readouterr().out == "here/run.usdc: 16 frames\n"
    assert run("--resume", there / "kept one.npz") == 0
    assert sorted(path.name for path in there.iterdir()) == ["kept one.npz", "run.usdc"]
    assert inspect_recording(here / "run.usdc") == inspect_recording(there / "run.usdc") == []


@pytest.mark.parametrize(("begun", "stop", "first", "then"), [(0, 150, 40, 100), (130, 175, 40, 40)])
def test_means_weigh_every_step_once(tmp_path, monkeypatch, begun, stop, first, then):
    """Also if their interval changes, or a run begins at a later step."""
    monkeypatch.chdir(tmp_path)
    simulation = Simulation("annulus")
    simulation.advance(begun)
    simulation.save("begun.npz")
    measure = ["--measure", "kinetic_energy", "--series"]
    options = ["--mean", "--checkpoint", "run.npz", "--every", first]
    assert run("--resume", "begun.npz", "--steps", stop, *measure, "mean.csv", *options) == 0
    assert run("--resume", "run.npz", "--steps", 300, "--every", then) == 0
    each = simulation.measure("kinetic_energy", steps=300 - begun).rows
    last = begun
    for row in read_table(tmp_path / "mean.csv"):
        step, mean = int(row["step"]), float(row["kinetic_energy"])
        own = [one["kinetic_energy"] for one in each if last < one["step"] <= step]
        assert len(own) == step - last
        assert mean == pytest.approx(np.mean(own), rel=1e-12)  # some hundred sums, each to 1e-16
        last = step
    assert last >= 280


def test_in_python_a_run_is_resumed_as_by_the_command(tmp_path, stop_at):
    """With its recording and its summary, from a run that was interrupted, and to a later end."""
    whole, parts, kept = tmp_path / "whole.usda", tmp_path / "parts.usda", tmp_path / "run.npz"
    expected = Simulation("annulus").run(60, record=whole, fps=50)
    stop_at(25)
    with pytest.raises(KeyboardInterrupt):
        Simulation("annulus").run(40, record=parts, fps=50, checkpoint=kept, every=10)
    simulation, summary = Simulation.resume(kept, steps=60, every=7)
    assert replace(summary, seconds=0.0, output="") == replace(expected, seconds=0.0, output="")
    assert same_frames(parts, whole) == 31
    assert read_checkpoint(kept).options.every == 7
    again, same = Simulation.resume(kept)
    assert contents(again.state()) == contents(simulation.state())
    assert replace(same, seconds=0.0) == replace(summary, seconds=0.0)


def test_saved_state_goes_on_to_the_end_of_its_scene(tmp_path, capfd):
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


def test_checkpoint_counts_no_frame_that_is_not_on_the_disk(tmp_path, monkeypatch):
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
