"""Two processes on one sweep: each does the runs that the other leaves, and says which it left."""

import subprocess
import sys

import pytest
from command import require_refusal
from same_bits import contents
from sweeps import SMALL, batch, begin, results, rows, write

from warpgrains.errors import OutputError
from warpgrains.simulation.checkpoint import read_checkpoint
from warpgrains.sweep.execution import ExecutionOptions, RunSettings
from warpgrains.sweep.runner import finish_runs
from warpgrains.sweep.sweep_folder import SweepFolder

LONG = """
scene = "annulus"
[set]
time.duration = 1.0
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
    assert [row["run"] for row in rows(out)] == ["0", "2", "3", "4", "5"]
    holder.kill()
    holder.wait(timeout=60)
    assert batch(write(tmp_path), "-o", out, "--resume") == 1
    assert results(out) == results(done)


@pytest.mark.parametrize("options", [pytest.param([], marks=pytest.mark.slow), ["--usd"]])
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
    ("change", "options", "complaint"),
    [
        ("= 30|= 31", "", "annulus.toml' is of a sweep with another scene: choose another -o"),
        ("30|30", "--folders --measure rattlers", "is of a sweep with --measure rattlers: choose another -o"),
    ],
)
def test_another_sweep_that_begins_at_once_keeps_its_tables(
    tmp_path, monkeypatch, capfd, change, options, complaint
):
    """The files of the first that writes them are those of the sweep, though both find no folder."""
    (tmp_path / "other").mkdir()
    out, other = tmp_path / "out", write(tmp_path / "other", SMALL.replace(*change.split("|")))
    write_common_files = SweepFolder.write_common_files

    def come_between(*arguments):
        monkeypatch.undo()
        assert batch(other, "-o", out, *options.split()) == 1
        capfd.readouterr()
        write_common_files(*arguments)

    monkeypatch.setattr(SweepFolder, "write_common_files", come_between)
    assert batch(write(tmp_path), "-o", out) == 2
    require_refusal(capfd, complaint)
    assert batch(other, "-o", tmp_path / "alone", *options.split()) == 1
    assert results(out) == results(tmp_path / "alone")


def test_sweeps_that_go_on_in_different_ways_are_refused(tmp_path):
    """They have the runs of a shorter one, so that only the results of the others differ."""
    text = 'scene = "annulus"\n[set]\ntime.duration = 0.1\n[axes]\nphysics.drag = [0.1'
    texts = [f"{text}{more}]" for more in ("", ", 0.2", ", 0.3")]
    _, first, second = (begin(tmp_path / str(k), text, tmp_path / "out") for k, text in enumerate(texts))
    assert finish_runs(first[0], first[1].runs, ExecutionOptions(), lambda _: None) == {}
    with pytest.raises(OutputError, match=r"run 1 in .* belongs to another sweep"):
        finish_runs(second[0], second[1].runs, ExecutionOptions(), lambda _: None)
    with pytest.raises(OutputError, match=r"run 1 in .* belongs to another sweep"):
        SweepFolder(tmp_path / "out", second[1].axes, RunSettings()).write_tables(second[1])
