"""A sweep with one damaged run: it is named and counted as failed, and the others go on."""

import os
import shutil
from pathlib import Path

import pytest
from sweeps import SMALL, batch, results, table, write

from warpgrains.frame_log import FrameLog, LogReader
from warpgrains.sweep.results import SECONDS
from warpgrains.usd.writer import reopen_log

GOOD = SMALL.replace("100.0, ", "")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Four runs, recorded."""
    folder = tmp_path_factory.mktemp("whole")
    assert batch(write(folder, GOOD), "-o", folder / "out", "--usd") == 0
    return folder / "out"


def resume_damaged(folder, whole, damage, *options):
    """Damage run 1 of a finished sweep and resume it; return the rows of its results."""
    out = folder / "out"
    shutil.copytree(whole, out)
    damage(out / "runs" / "00001")
    assert batch(write(folder, GOOD), "-o", out, "--resume", *options) == 1
    rows = table(out / "results.csv")
    assert [row["run"] for row in rows] == ["0", "1", "2", "3"]
    assert [bool(row["error"]) for row in rows] == [False, True, False, False]
    return rows


def with_value(column, value):
    """Return a damage that changes a cell of a result, or takes a column out of it."""

    def damage(run):
        (row,) = table(run / "result.csv")
        row[column] = value
        row = {name: cell for name, cell in row.items() if cell is not None}
        (run / "result.csv").write_text(f"{','.join(row)}\n{','.join(row.values())}\n")

    return damage


def cut_result(length):
    return lambda run: (run / "result.csv").write_bytes((run / "result.csv").read_bytes()[:length])


DAMAGED_RESULTS = {
    "empty": cut_result(0),
    "names only": cut_result(200),
    "short": cut_result(-60),
    "twice": lambda run: (run / "result.csv").write_bytes((run / "result.csv").read_bytes() * 2),
    "no seconds": with_value(SECONDS, None),
    "no run": with_value("run", None),
    "of another run": with_value("run", "3"),
    "no number": with_value("unconverged", "many"),
    "not UTF-8": lambda run: (run / "result.csv").write_bytes(b"\xff\xfe"),
    "a folder": lambda run: ((run / "result.csv").unlink(), (run / "result.csv").mkdir()),
    "a pipe": lambda run: piped(run / "result.csv"),
}


@pytest.mark.parametrize("damage", DAMAGED_RESULTS.values(), ids=DAMAGED_RESULTS.keys())
def test_damaged_result_is_named(tmp_path, whole, damage, capfd):
    rows = resume_damaged(tmp_path, whole, damage)
    assert rows[1]["error"] == "result.csv is damaged: delete the folder of the run to repeat it"
    assert "failed            1, first run 1: result.csv is damaged" in capfd.readouterr().out
    shutil.rmtree(tmp_path / "out" / "runs" / "00001")
    assert batch(write(tmp_path, GOOD), "-o", tmp_path / "out", "--resume") == 0
    assert results(tmp_path / "out") == results(whole)


def interrupted(damage):
    """Return a damage of a run that was killed before it had its result."""

    def undo_and_damage(run):
        (run / "result.csv").unlink()
        reopen_log(run / "recording.usdc", run / "recording.usdc.frames")
        (run / "recording.usdc").unlink()
        damage(run)

    return undo_and_damage


def damage_frame(log):
    """Change a byte of the first frame."""
    content = bytearray(log.read_bytes())
    first = LogReader(log).end
    content[first + 40] ^= 1
    log.write_bytes(content)


def cut_scene(run, end):
    """Keep a share of a scene file, or all but some lines."""
    lines = (run / "scene.toml").read_text().splitlines(keepends=True)
    (run / "scene.toml").write_text("".join(lines[: end if end < 0 else int(end * len(lines))]))


def changed_scene(run, old, new):
    text = (run / "scene.toml").read_text()
    assert text.count(old) >= 1
    last = text.rindex(old)
    (run / "scene.toml").write_text(text[:last] + new + text[last + len(old) :])


def piped(path):
    """Put a pipe that nobody writes to in the place of a file."""
    path.unlink()
    os.mkfifo(path)


DAMAGED_FILES = {
    "no log": (lambda run: (run / "recording.usdc.frames").unlink(), "does not exist"),
    "a frame is damaged": (lambda run: damage_frame(run / "recording.usdc.frames"), "holds 0 of the"),
    "checkpoint": (lambda run: (run / "checkpoint.npz").write_bytes(b"PK"), "is not a checkpoint"),
    "scene": (lambda run: (run / "scene.toml").write_bytes(b"\xff\xff"), "scene.toml' is damaged"),
    "empty scene": (lambda run: (run / "scene.toml").write_bytes(b""), "scene.toml' is damaged"),
    "half a scene": (lambda run: cut_scene(run, 0.5), "scene.toml' is damaged"),
    "scene without its last line": (lambda run: cut_scene(run, -1), "scene.toml' is damaged"),
    "scene with another value": (lambda run: changed_scene(run, "drag = 0.1", "drag = 0.3"), "is damaged"),
    "scene of another name": (lambda run: changed_scene(run, "run 1 of", "run 7 of"), "is damaged"),
    "scene is no TOML": (lambda run: (run / "scene.toml").write_text("# run 9 of\n=\n"), "is damaged"),
    "scene is a folder": (
        lambda run: ((run / "scene.toml").unlink(), (run / "scene.toml").mkdir()),
        "scene.toml' is not a regular file",
    ),
    "scene is a pipe": (lambda run: piped(run / "scene.toml"), "scene.toml' is not a regular file"),
    "checkpoint is a pipe": (lambda run: piped(run / "checkpoint.npz"), "checkpoint"),
}


@pytest.mark.parametrize(("damage", "reason"), DAMAGED_FILES.values(), ids=DAMAGED_FILES.keys())
def test_damaged_files_of_an_interrupted_run(tmp_path, whole, damage, reason, capfd):
    rows = resume_damaged(tmp_path, whole, interrupted(damage), "--usd")
    assert reason in rows[1]["error"]
    assert "failed            1, first run 1: " in capfd.readouterr().out


def test_log_that_cannot_be_read_is_left_for_repair(tmp_path, whole, capfd, monkeypatch):
    """The disk may fail for a while only: there is no result, and --resume tries again."""
    out = tmp_path / "out"
    shutil.copytree(whole, out)
    interrupted(lambda run: None)(out / "runs" / "00001")

    def fail(*_):
        raise OSError("Input/output error")

    monkeypatch.setattr(FrameLog, "reopen", fail)
    assert batch(write(tmp_path, GOOD), "-o", out, "--resume", "--usd") == 1
    assert "not finished      1 (continue with --resume), first run 1: " in capfd.readouterr().out


def test_checkpoint_of_another_run_is_not_continued(tmp_path, whole):
    def swap(run):
        shutil.copy(run.with_name("00003") / "checkpoint.npz", run / "checkpoint.npz")

    rows = resume_damaged(tmp_path, whole, interrupted(swap), "--usd")
    assert "checkpoint.npz' is of another run" in rows[1]["error"]


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


def test_file_in_the_place_of_a_run(tmp_path, capfd):
    (tmp_path / "out" / "runs").mkdir(parents=True)
    (tmp_path / "out" / "runs" / "00001").touch()
    assert batch(write(tmp_path, GOOD), "-o", tmp_path / "out") == 1
    assert "not finished      1 (continue with --resume), first run 1: " in capfd.readouterr().out
    assert len(table(tmp_path / "out" / "results.csv")) == 3


def test_table_that_is_not_written_is_not_named(tmp_path, capfd):
    (tmp_path / "out" / "runs").mkdir(parents=True)
    (tmp_path / "out" / "runs" / "00000").touch()
    assert batch(write(tmp_path, 'scene = "annulus"'), "-o", tmp_path / "out") == 1
    assert not (tmp_path / "out" / "results.csv").exists()
    assert "results" not in capfd.readouterr().out
