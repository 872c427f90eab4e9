"""`warpgrains batch --resume` and shares: the same tables whatever happens on the way."""

import shutil

import pytest
from same_bits import contents
from sweeps import LONG, SMALL, batch, results, table, write

from warpgrains.simulation.checkpoint import read_checkpoint
from warpgrains.solver import engine, threads
from warpgrains.sweep import short
from warpgrains.sweep.run import GroupedRun


def test_what_failed_once_stays_failed(tmp_path, slices, monkeypatch):
    """Even if it could go on later, such as when there is memory again: it has missed steps."""
    count, slices.left = GroupedRun.count, 1_000

    def fail_once(run, done):
        fails = len(slices.steps) == 2 and run.folder.labels["run"] == "0"
        count(run, done._replace(error="no room") if fails else done)

    monkeypatch.setattr(GroupedRun, "count", fail_once)
    assert batch(write(tmp_path), "-o", tmp_path / "out", "--folders") == 1
    errors = [row["error"] for row in table(tmp_path / "out" / "results.csv")]
    assert errors[0] == "no room"
    assert errors[1] == ""


class TestResume:
    @pytest.mark.parametrize("options", [["--folders"], ["--usd"], ["--measure", "packing", "--every", "7"]])
    def test_same_results_after_interruptions(self, tmp_path, kept, slices, options):
        sweep, out = write(tmp_path), tmp_path / "out"
        for number, left in enumerate((4, 3, 1_000)):
            slices.left = left
            assert batch(sweep, "-o", out, *options, *["--resume"] * (number > 0)) == (
                1 if left == 1_000 else 130
            )
        assert sum(slices.steps) == 40  # none of them twice
        assert results(out) == results(kept)
        for number in ("00001", "00004"):
            ends = [read_checkpoint(folder / "runs" / number / "checkpoint.npz") for folder in (kept, out)]
            assert contents(ends[0].state) == contents(ends[1].state)
            assert not (out / "runs" / number / "recording.usdc.frames").exists()
            assert (out / "runs" / number / "recording.usdc").exists() == (options == ["--usd"])
            assert (out / "runs" / number / "series.csv").exists() == ("--every" in options)

    def test_finished_runs_are_not_repeated(self, tmp_path, kept, capfd):
        shutil.copytree(kept, tmp_path / "out")
        shutil.rmtree(tmp_path / "out" / "runs" / "00004")
        before = {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "runs").rglob("*.*")}
        assert batch(write(tmp_path), "-o", tmp_path / "out", "--resume") == 1
        assert "6, 5 of them finished before" in capfd.readouterr().out
        assert all(path.stat().st_mtime_ns == moment for path, moment in before.items())
        assert results(tmp_path / "out") == results(kept)

    def test_old_sweep_goes_on(self, tmp_path, kept, done):
        """One of the times when every run had a folder: those that are left need none."""
        out = tmp_path / "out"
        shutil.copytree(kept, out)
        shutil.rmtree(out / "scenes")
        for number in ("00001", "00004", "00005"):
            shutil.rmtree(out / "runs" / number)
        assert batch(write(tmp_path), "-o", out, "--resume") == 1
        assert results(out) == results(done)
        assert sorted(path.name for path in (out / "runs").iterdir()) == ["00000", "00002", "00003"]

    def test_parts_that_are_gone_are_made_again(self, tmp_path, done, capfd):
        out = tmp_path / "out"
        shutil.copytree(done, out)
        (part,) = (out / "parts").glob("[0-9]*.csv")
        content = part.read_bytes()
        part.unlink()
        assert batch(write(tmp_path), "-o", out, "--resume") == 1
        assert "6, 2 of them finished before" in capfd.readouterr().out
        assert results(out) == results(done)
        part.write_bytes(content)  # as when a file system shows it late: its runs were done twice
        assert batch(write(tmp_path), "-o", out, "--resume") == 1
        assert results(out) == results(done)

    def test_damaged_part_is_set_aside(self, tmp_path, done, capfd):
        out = tmp_path / "out"
        shutil.copytree(done, out)
        (part,) = (out / "parts").glob("[0-9]*.csv")
        part.write_bytes(part.read_bytes().replace(b"annulus", b"annalus", 1))
        assert batch(write(tmp_path), "-o", out, "--resume") == 1
        said = capfd.readouterr()
        assert f"'{part}' is damaged: its runs are done again" in said.err
        assert "6, 2 of them finished before" in said.out
        assert part.with_name(f"{part.name}.damaged").exists()
        assert results(out) == results(done)

    def test_other_scene_is_refused(self, tmp_path, done, capfd):
        shutil.copytree(done, tmp_path / "out")
        other = write(tmp_path, SMALL.replace("max_iterations = 30", "max_iterations = 31"))
        assert batch(other, "-o", tmp_path / "out", "--resume") == 2
        assert "annulus.toml' is another scene than this sweep starts from" in capfd.readouterr().err

    def test_run_that_takes_long_gets_a_folder(self, tmp_path, monkeypatch):
        """It goes on from where it is when the time is over."""
        sweep = write(tmp_path, LONG.replace("[axes]", "time.duration = 80.0\n[axes]"))
        assert batch(sweep, "-o", tmp_path / "short") == 0
        monkeypatch.setattr(short, "SHORT", 0.0)
        monkeypatch.setattr(engine, "BRIEF", 0)
        monkeypatch.setattr(threads, "GLANCE", 1e-3)  # before the run is over, on any machine
        out = tmp_path / "out"
        assert batch(sweep, "-o", out) == 0
        assert results(out) == results(tmp_path / "short")
        kept = read_checkpoint(out / "runs" / "00000" / "checkpoint.npz")
        assert kept.statistics.steps == 8000

    def test_begun_sweep_needs_resume(self, tmp_path, done, capfd):
        shutil.copytree(done, tmp_path / "out")
        assert batch(write(tmp_path), "-o", tmp_path / "out") == 2
        assert "--resume continues a sweep" in capfd.readouterr().err
        assert results(tmp_path / "out") == results(done)

    def test_other_sweep_is_refused(self, tmp_path, done, capfd):
        shutil.copytree(done, tmp_path / "out")
        other = write(tmp_path, SMALL.replace("[5, 15]", "[5, 14]"))
        assert batch(other, "-o", tmp_path / "out", "--resume") == 2
        assert "run 1 in '" in capfd.readouterr().err

    def test_other_folders_are_refused(self, tmp_path, kept, capfd):
        shutil.copytree(kept, tmp_path / "out")
        other = write(tmp_path, SMALL.replace("[5, 15]", "[5, 14]"))
        assert batch(other, "-o", tmp_path / "out", "--resume") == 2
        assert "is another scene than this run of the sweep" in capfd.readouterr().err

    def test_longer_sweep_goes_on(self, tmp_path, done):
        """Values at the end of the first axis are runs that follow those that are there."""
        shutil.copytree(done, tmp_path / "out")
        longer = write(tmp_path, SMALL.replace("0.5]", "0.5, 0.6]"))
        assert batch(longer, "-o", tmp_path / "out", "--resume") == 1
        assert results(tmp_path / "out").startswith(results(done))
        assert len(table(tmp_path / "out" / "results.csv")) == 8


class TestShares:
    def test_shares_make_the_whole(self, tmp_path, done):
        sweep, out = write(tmp_path), tmp_path / "out"
        codes = [batch(sweep, "-o", out, "--index", index, "--count", 3) for index in (2, 0, 1)]
        assert codes == [1, 1, 0]  # the failed runs are 2 and 3, of the shares 2 and 0
        assert results(out) == results(done)

    def test_late_results_are_not_lost(self, tmp_path, kept, monkeypatch):
        """Runs that finish while the tables are written: who writes last has them all."""
        shutil.copytree(kept, tmp_path / "out")
        last = tmp_path / "out" / "runs" / "00005" / "result.csv"
        late = last.rename(tmp_path / "late.csv")
        from warpgrains.sweep import folder as sweep_folder

        write_whole = sweep_folder.write_whole

        def write_as_another_run_finishes(*arguments):
            write_whole(*arguments)
            if late.exists():
                late.rename(last)

        monkeypatch.setattr(sweep_folder, "write_whole", write_as_another_run_finishes)
        assert batch(write(tmp_path), "-o", tmp_path / "out", "--resume", "--index", 0, "--count", 6) == 0
        assert results(tmp_path / "out") == results(kept)
