"""A sweep with one damaged run: it is named and counted as failed, and the others go on."""

import os
import shutil
from pathlib import Path

import pytest
from sweeps import SMALL, batch, results, rows, write

from warpgrains.frame_log import FrameLog, LogReader
from warpgrains.usd.writer import reopen_log

GOOD = SMALL.replace("100.0, ", "")
OUTPUTS = ("--usd", "--measure", "packing", "--every", 7)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Four runs, each with a recording and a series."""
    folder = tmp_path_factory.mktemp("whole")
    assert batch(write(folder, GOOD), "-o", folder / "out", *OUTPUTS) == 0
    return folder / "out"


def interrupt(run):
    """Undo the end of a run, as if the process had been killed before it had its result."""
    for shard in run.parents[1].glob("parts/[0-9]*.csv"):
        shard.unlink()
    reopen_log(run / "recording.usdc", run / "recording.usdc.frames")
    (run / "recording.usdc").unlink()


def damage_frame(log):
    """Change a byte of the first frame."""
    content = bytearray(log.read_bytes())
    first = LogReader(log).end
    content[first + 40] ^= 1
    log.write_bytes(content)


def piped(path):
    """Put a pipe that nobody writes to in the place of a file."""
    path.unlink()
    os.mkfifo(path)


DAMAGED_FILES = {
    "no log": (lambda run: (run / "recording.usdc.frames").unlink(), "does not exist"),
    "a frame is damaged": (lambda run: damage_frame(run / "recording.usdc.frames"), "holds 0 of the"),
    "checkpoint": (lambda run: (run / "checkpoint.npz").write_bytes(b"PK"), "is not a checkpoint"),
    "checkpoint is a pipe": (lambda run: piped(run / "checkpoint.npz"), "checkpoint"),
    "checkpoint of another run": (
        lambda run: shutil.copy(run.with_name("00003") / "checkpoint.npz", run),
        "checkpoint.npz' is of another run: delete the folder of the run to repeat it",
    ),
    "foreign recording": (
        lambda run: ((run / "checkpoint.npz").unlink(), (run / "recording.usdc").write_text("foreign")),
        "recording.usdc': not a recording of warpgrains: delete the folder",
    ),
    "no series": (lambda run: (run / "series.csv").unlink(), "lacks rows before step"),
    "foreign series": (
        lambda run: ((run / "checkpoint.npz").unlink(), (run / "series.csv").write_text("x,y\n1,2\n")),
        "series.csv': not a series",
    ),
}


@pytest.mark.parametrize(("damage", "reason"), DAMAGED_FILES.values(), ids=DAMAGED_FILES.keys())
def test_damaged_files_of_an_interrupted_run(tmp_path, whole, damage, reason, capfd):
    out, sweep = tmp_path / "out", write(tmp_path, GOOD)
    shutil.copytree(whole, out)
    interrupt(out / "runs" / "00001")
    damage(out / "runs" / "00001")
    assert batch(sweep, "-o", out, "--resume", *OUTPUTS) == 1
    found = rows(out)
    assert [row["run"] for row in found] == ["0", "1", "2", "3"]
    assert [bool(row["error"]) for row in found] == [False, True, False, False]
    assert reason in found[1]["error"]
    assert "failed            1, first run 1: " in capfd.readouterr().out
    shutil.rmtree(out / "runs" / "00001")
    assert batch(sweep, "-o", out, "--resume", *OUTPUTS) == 0
    assert results(out) == results(whole)


def test_log_that_cannot_be_read_is_left_for_repair(tmp_path, whole, capfd, monkeypatch):
    """The disk may fail for a while only: there is no result, and --resume tries again."""
    out = tmp_path / "out"
    shutil.copytree(whole, out)
    interrupt(out / "runs" / "00001")

    def fail(*_):
        raise OSError("Input/output error")

    monkeypatch.setattr(FrameLog, "reopen", fail)
    assert batch(write(tmp_path, GOOD), "-o", out, "--resume", *OUTPUTS) == 1
    assert "not finished      1 (continue with --resume), first run 1: " in capfd.readouterr().out


@pytest.mark.parametrize("damage", [lambda path: path.write_bytes(b"1"), piped], ids=["cut", "pipe"])
def test_damaged_part_is_done_again(tmp_path, damage, capfd):
    sweep, out = write(tmp_path, GOOD), tmp_path / "out"
    assert batch(sweep, "-o", out) == 0
    before = results(out)
    (part,) = (out / "parts").glob("*.csv")
    damage(part)
    capfd.readouterr()
    assert batch(sweep, "-o", out, "--resume") == 0
    assert f"'{part}' is damaged: its runs are repeated" in capfd.readouterr().err
    assert part.with_name(f"{part.name}.damaged").exists()
    assert results(out) == before


@pytest.mark.parametrize("is_read", [False, True])
def test_part_that_another_process_renames(tmp_path, monkeypatch, is_read):
    """Just before it is read, or after."""
    sweep, out = write(tmp_path, GOOD), tmp_path / "out"
    assert batch(sweep, "-o", out) == 0
    before = results(out)
    (part,) = (out / "parts").glob("*.csv")
    part.write_bytes(b"1")
    aside = part.with_name(f"{part.name}.damaged")
    read = Path.read_bytes

    def read_and_rename(path):
        content = read(path) if is_read or path != part else b""
        if path == part and not aside.exists():
            part.rename(aside)
        return content if is_read else read(path)

    monkeypatch.setattr(Path, "read_bytes", read_and_rename)
    assert batch(sweep, "-o", out, "--resume") == 0
    assert results(out) == before


def test_file_in_the_place_of_the_only_run(tmp_path, capfd):
    (tmp_path / "out" / "runs").mkdir(parents=True)
    (tmp_path / "out" / "runs" / "00000").touch()
    assert batch(write(tmp_path, 'scene = "annulus"'), "-o", tmp_path / "out") == 1
    assert not (tmp_path / "out" / "results.csv").exists()
    printed = capfd.readouterr().out
    assert "not finished      1 (continue with --resume), first run 0: " in printed
    assert "results" not in printed


def test_a_damaged_copy_of_grains_is_refused(tmp_path, capfd):
    (tmp_path / "grains.csv").write_text("x,y,radius,mass\n0.5,0.0,0.1,0.1\n-0.5,0.0,0.1,0.1\n")
    (tmp_path / "scene.toml").write_text('domain.radius_out = 1.0\ngrains.file = "grains.csv"\n')
    axes = "[axes]\nphysics.drag = [0.1, 0.5]\n[set]\ntime.duration = 0.1\n"
    sweep, out = write(tmp_path, f'scene = "scene.toml"\n{axes}'), tmp_path / "out"
    assert batch(sweep, "-o", out, "--index", 0, "--count", 2) == 0
    (copy,) = (out / "grains").iterdir()
    whole = copy.read_bytes()
    copy.write_bytes(whole.replace(b"-0.5", b"-0.7"))
    assert batch(sweep, "-o", out, "--resume") == 2
    assert f"{copy.name}' is damaged: delete it to have it copied" in capfd.readouterr().err
    copy.unlink()
    assert batch(sweep, "-o", out, "--resume") == 0
    assert copy.read_bytes() == whole
