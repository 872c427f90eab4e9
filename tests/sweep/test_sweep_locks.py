"""Two processes on one sweep: each does the runs that the other leaves, and says which it left."""

import subprocess
import sys

import pytest
from command import require_refusal
from same_bits import contents
from sweeps import SMALL, batch, results, table, write

from warpgrains.errors import OutputError
from warpgrains.simulation.checkpoint import read_checkpoint
from warpgrains.sweep.execution import ExecutionOptions, RunSettings
from warpgrains.sweep.runner import finish_runs
from warpgrains.sweep.sweep import Sweep
from warpgrains.sweep.sweep_folder import SweepFolder

LONG = """
scene = "annulus"
[set]
time.duration = 3.0
[axes]
physics.drag = {range = [0.1, 0.9], count = 12}
"""


def test_run_that_another_process_has_is_left_to_it(tmp_path, held_elsewhere, done, capfd):
    out = tmp_path / "out"
    run = out / "runs" / "00001"
    run.mkdir(parents=True)
    holder = held_elsewhere(run / "checkpoint.npz")
    assert batch(write(tmp_path), "-o", out) == 1
    printed = capfd.readouterr().out
    assert "not finished      1 (continue with --resume), first run 1: '" in printed
    assert f"is being written by process {holder.pid}" in printed
    assert list(run.iterdir()) == [run / ".checkpoint.npz.lock"]
    assert [row["run"] for row in table(out / "results.csv")] == ["0", "2", "3", "4", "5"]
    holder.kill()
    holder.wait(timeout=60)
    assert batch(write(tmp_path), "-o", out, "--resume") == 1
    assert results(out) == results(done)


@pytest.mark.parametrize("options", [[], ["--usd"]])
def test_twice_at_once(tmp_path, options):
    sweep, out = write(tmp_path, LONG), tmp_path / "out"
    command = [sys.executable, "-m", "warpgrains", "batch", str(sweep), "-o", str(out), *options]
    both = [subprocess.Popen([*command, "--resume"], stdout=subprocess.DEVNULL) for _ in range(2)]
    assert {process.wait(timeout=200) for process in both} <= {0, 1}
    assert batch(sweep, "-o", out, "--resume", *options) == 0
    assert batch(sweep, "-o", tmp_path / "alone", *options) == 0
    assert results(out) == results(tmp_path / "alone")
    for path in (tmp_path / "alone").rglob("recording.usdc"):
        assert path.read_bytes() == (out / path.relative_to(tmp_path / "alone")).read_bytes()
    assert not list(out.rglob("*.lock"))
    for path in out.rglob("checkpoint.npz"):
        other = tmp_path / "alone" / path.relative_to(out)
        assert contents(read_checkpoint(path).state) == contents(read_checkpoint(other).state)


@pytest.mark.parametrize(
    ("change", "until", "complaint"),
    [
        (
            ("[axes]", "contact.friction = 0.5\n[axes]"),
            None,
            "annulus.toml' is of a sweep with another scene",
        ),
        (("[axes]", "[axes]"), "rest", "settings.json' is of a sweep with --until none"),
        (("0.9", "0.8"), None, "settings.json' is of a sweep with other runs"),
    ],
)
def test_another_sweep_that_begins_at_once_is_refused(tmp_path, change, until, complaint):
    """Both find no folder; the files of the first that writes them are those of the sweep."""
    texts, folders = [LONG, LONG.replace(*change)], []
    for number, (text, end) in enumerate(zip(texts, (None, until), strict=True)):
        (tmp_path / str(number)).mkdir()
        sweep = Sweep.load(write(tmp_path / str(number), text))
        folder = SweepFolder(tmp_path / "out", sweep.axes, RunSettings(until=end))
        folder.create_or_check(sweep, sweep.runs, False)
        folders.append((folder, sweep))
    (first, sweep), (second, other) = folders
    first.write_common_files(sweep)
    with pytest.raises(OutputError, match=complaint):
        second.write_common_files(other)


@pytest.mark.parametrize(
    ("change", "options"),
    [(("", ""), ["--folders", "--measure", "energy"]), (("[5, 15]", "[5, 14]"), [])],
    ids=["other settings", "other values"],
)
def test_a_sweep_that_is_refused_keeps_the_tables_of_the_other(tmp_path, monkeypatch, capfd, change, options):
    """The other one begins after it has checked its folder."""
    (tmp_path / "other").mkdir()
    out, other = tmp_path / "out", write(tmp_path / "other", SMALL.replace(*change))
    write_common_files = SweepFolder.write_common_files

    def come_between(*arguments):
        monkeypatch.undo()
        assert batch(other, "-o", out, *options) == 1
        capfd.readouterr()
        write_common_files(*arguments)

    monkeypatch.setattr(SweepFolder, "write_common_files", come_between)
    assert batch(write(tmp_path), "-o", out) == 2
    require_refusal(capfd, "choose another -o")
    assert batch(other, "-o", tmp_path / "alone", *options) == 1
    assert results(out) == results(tmp_path / "alone")


def test_sweeps_that_go_on_in_different_ways_are_refused(tmp_path):
    """They have the runs of a shorter one, so that only the results of the others differ."""
    folders = []
    for number, values in enumerate(("0.1", "0.1, 0.2", "0.1, 0.3")):
        (tmp_path / str(number)).mkdir()
        text = f'scene = "annulus"\n[set]\ntime.duration = 0.1\n[axes]\nphysics.drag = [{values}]'
        sweep = Sweep.load(write(tmp_path / str(number), text))
        folder = SweepFolder(tmp_path / "out", sweep.axes, RunSettings())
        folder.create_or_check(sweep, sweep.runs, False)
        folder.write_common_files(sweep)
        folders.append((folder, sweep))
    _, (first, sweep), (second, other) = folders
    assert finish_runs(first, sweep.runs, ExecutionOptions(), lambda _: None) == {}
    with pytest.raises(OutputError, match=r"run 1 in .* belongs to another sweep"):
        finish_runs(second, other.runs, ExecutionOptions(), lambda _: None)
    with pytest.raises(OutputError, match=r"run 1 in .* belongs to another sweep"):
        SweepFolder(tmp_path / "out", other.axes, RunSettings()).write_tables(other)
