"""`warpgrains batch --resume`: runs that take long, cannot be done, or whose files are damaged."""

import os
import shutil
import sys

import pytest
from sweeps import LONG, SMALL, Interrupted, Slices, batch, results, rows, steps_kept, write

from warpgrains.base.frame_log import FrameLog, LogReader
from warpgrains.base.locks import Lock
from warpgrains.solver import engine, threads
from warpgrains.sweep import group
from warpgrains.sweep.group import Group
from warpgrains.sweep.sweep_folder import SweepFolder
from warpgrains.sweep.sweep_run import SweepRun
from warpgrains.usd.writer import reopen_log


def test_run_that_takes_long_gets_a_folder(tmp_path, monkeypatch, capfd):
    """It goes on from where it is when the time is over, even if the process is killed then."""
    sweep, out, advance, clock = write(tmp_path, LONG), tmp_path / "out", Group.advance, [0.0]

    def advance_or_die(group, seconds, on_progress):
        def end_after_a_step(fraction):
            on_progress(fraction)
            clock[0] += 100.0 if fraction > 0.0 else 0.0

        if clock[0] > 0.0:
            raise Interrupted
        advance(group, seconds, end_after_a_step)

    with monkeypatch.context() as patch:
        patch.setattr(Group, "advance", advance_or_die)
        patch.setattr(group, "perf_counter", lambda: clock[0])
        patch.setattr(engine, "BRIEF", 0)
        patch.setattr(threads, "GLANCE", 1e-4)  # before the runs are over, on any machine
        assert batch(sweep, "-o", out) == 130
    assert capfd.readouterr().err.endswith("interrupted; to continue: the same command with --resume\n")
    first = steps_kept(out)
    assert batch(sweep, "-o", out, "--resume") == 0
    assert 0 < first < steps_kept(out) == 12 * 800
    assert batch(sweep, "-o", tmp_path / "short") == 0
    assert not (tmp_path / "short" / "runs").exists()
    assert results(out) == results(tmp_path / "short")


def test_a_run_whose_extra_is_missing_is_left_to_another_machine(tmp_path, monkeypatch, capfd):
    sweep = write(tmp_path, SMALL.replace("[axes]", '[axes]\nsolver.method = ["gauss-seidel", "exact"]'))
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "warpgrains.solver.exact.convex", None)
        assert batch(sweep, "-o", tmp_path / "out") == 1
    said = capfd.readouterr().out
    assert "not finished      4 (continue with --resume), first run 6: method 'exact' needs" in said
    assert len(rows(tmp_path / "out")) == 8
    assert batch(sweep, "-o", tmp_path / "out", "--resume") == 1  # two have too much drag
    assert len(rows(tmp_path / "out")) == 12


def lock(run, patch, kept):
    run.mkdir(parents=True)
    held = Lock(run / "checkpoint.npz")

    def end():
        assert list(run.iterdir()) == [run / ".checkpoint.npz.lock"]
        held.release()

    return end


def put_a_file(run, patch, kept):
    run.parent.mkdir(parents=True)
    run.touch()
    return run.unlink


def refuse_folder(run, patch, kept):
    """Which the run needs after a while."""
    open_folder = SweepRun.open

    def open_others(one, folder, *given):
        if folder == run:
            raise OSError("permission denied")
        return open_folder(one, folder, *given)

    Slices(patch, of_all=True)
    patch.setattr(SweepRun, "open", open_others)
    return patch.undo


def begin_elsewhere(run, patch, kept):
    """On a file system without locks, after this process has begun the run without a folder."""
    shutil.copytree(kept / "runs" / run.name, run)
    Slices(patch, of_all=True)
    patch.setattr(SweepFolder, "with_folders", lambda folder: set())
    return patch.undo


@pytest.mark.parametrize(
    ("hinder", "reason"),
    [
        (lock, ".npz' is being written by process PID on"),
        (put_a_file, "File exists"),
        (refuse_folder, "permission denied\n"),
        (begin_elsewhere, "another process has begun it\n"),
    ],
)
def test_a_run_that_cannot_be_done_is_left(tmp_path, done, kept, monkeypatch, capfd, hinder, reason):
    sweep, out = write(tmp_path), tmp_path / "out"
    end = hinder(out / "runs" / "00001", monkeypatch, kept)
    assert batch(sweep, "-o", out, "--index", 1, "--count", 6) == 1
    alone = capfd.readouterr().out
    assert batch(sweep, "-o", out, "--resume") == 1
    for said in (alone, capfd.readouterr().out):
        assert "not finished      1 (continue with --resume), first run 1: " in said
        assert reason.replace("PID", str(os.getpid())) in said
    assert "results" not in alone
    assert [row["run"] for row in rows(out)] == ["0", "2", "3", "4", "5"]
    end()
    assert batch(sweep, "-o", out, "--resume") == 1
    assert results(out) == results(done)


def piped(path):
    """Put a pipe that nobody writes to in the place of a file."""
    path.unlink()
    os.mkfifo(path)


def damage_frame(run):
    """Change a byte of the first frame."""
    log = run / "recording.usdc.frames"
    content = bytearray(log.read_bytes())
    content[LogReader(log).end + 40] ^= 1
    log.write_bytes(content)


def make_foreign(run, name, text):
    (run / "checkpoint.npz").unlink()
    (run / name).write_text(text)


DAMAGES = {
    "does not exist": lambda run: (run / "recording.usdc.frames").unlink(),
    "holds 0 of the": damage_frame,
    "is not a checkpoint": lambda run: (run / "checkpoint.npz").write_bytes(b"PK"),
    "checkpoint": lambda run: piped(run / "checkpoint.npz"),
    "checkpoint.npz' is of another run: delete the folder of the run to repeat it": (
        lambda run: shutil.copy(run.with_name("00009") / "checkpoint.npz", run)
    ),
    "recording.usdc': not a recording of warpgrains: delete the folder": (
        lambda run: make_foreign(run, "recording.usdc", "foreign")
    ),
    "lacks rows before step": lambda run: (run / "series.csv").unlink(),
    "series.csv': not a series": lambda run: make_foreign(run, "series.csv", "x,y\n1,2\n"),
}
"""What is done to a run, by the reason of its failure."""


def test_damaged_files_of_interrupted_runs(tmp_path, monkeypatch, capfd):
    """One of them cannot be read, perhaps for a while only: it has no result."""
    axis = "physics.drag = {range = [0.1, 0.9], count = 10}"
    sweep = write(tmp_path, f'scene = "annulus"\n[set]\ntime.duration = 0.4\n[axes]\n{axis}')
    out, outputs = tmp_path / "out", ("--usd", "--measure", "packing", "--every", 7)
    assert batch(sweep, "-o", out, *outputs) == 0
    whole = results(out)
    (part,) = out.glob("parts/[0-9]*.csv")
    piped(part)
    runs = [out / "runs" / f"{number:05}" for number in range(9)]
    for run in runs:
        reopen_log(run / "recording.usdc", run / "recording.usdc.frames")
        (run / "recording.usdc").unlink()
    for run, damage in zip(runs, DAMAGES.values(), strict=False):
        damage(run)
    reopen = FrameLog.reopen

    def fail(log, *given):
        if log.path.parent == runs[8]:
            raise OSError("Input/output error")
        reopen(log, *given)

    monkeypatch.setattr(FrameLog, "reopen", fail)
    capfd.readouterr()
    assert batch(sweep, "-o", out, "--resume", *outputs) == 1
    said = capfd.readouterr()
    assert f"'{part}' is damaged: its runs are repeated" in said.err
    assert part.with_name(f"{part.name}.damaged").exists()
    assert "failed            8, first run 0: " in said.out
    assert "not finished      1 (continue with --resume), first run 8: " in said.out
    found = rows(out)
    assert [row["run"] for row in found] == [*map(str, range(8)), "9"]
    for reason, row in zip(DAMAGES, found, strict=False):
        assert reason in row["error"]
    assert found[8]["error"] == ""
    monkeypatch.undo()
    for run in runs[:8]:
        shutil.rmtree(run)
    assert batch(sweep, "-o", out, "--resume", *outputs) == 0
    assert results(out) == whole
