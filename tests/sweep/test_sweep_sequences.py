"""Sweeps that are killed, resumed, shared and damaged, in any order: same results as undisturbed."""

import shutil
import subprocess
import sys
import time
from contextlib import suppress
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp

import pytest
from command import dying_in_writing, exit_code
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test
from same_bits import contents
from sweeps import LONG, Interrupted, Slices, batch, results, rows, steps_kept, table, write
from trimmed import few_or_many

from warpgrains import Scene, Simulation
from warpgrains.simulation.checkpoint import read_checkpoint

NUMBERS = [0, 1, 4, 5]  # of the small sweep's runs: the others fail
UNTIL = ("--until", "rest,speed=1.5,time=0.05")  # some end after 20 steps, some never
MEASURE = ("--measure", "packing")
FOLDERS = [(), ("--folders",), ("--usd",), (*MEASURE, "--every", "7")]


@cache
def undisturbed(*options):
    """Return the output of a sweep that nothing disturbs."""
    folder = Path(mkdtemp())
    assert batch(write(folder), "-o", folder / "out", *options) == 1
    return folder / "out"


@cache
def end(scene, steps):
    """Return the state of a run alone after so many steps."""
    simulation = Simulation(Scene.load(scene))
    simulation.run(steps=steps)
    return contents(simulation.state())


class Sequences(RuleBasedStateMachine):
    """Actions on one sweep; no result that is on the disk is ever written again."""

    def __init__(self):
        super().__init__()
        self.folder, self.patch = TemporaryDirectory(), pytest.MonkeyPatch()
        self.slices, self.sweep = Slices(self.patch), write(Path(self.folder.name))
        self.out, self.written, self.lost = Path(self.folder.name, "out"), {}, []
        self.damaged = {}
        self.options = None

    def teardown(self):
        try:
            if self.options is not None:
                self.resume()
                self.check()
        finally:
            self.patch.undo()
            self.folder.cleanup()

    def check(self):
        assert results(self.out) == results(undisturbed(*self.results_of))
        for name in ("settings.json", "scenes/annulus.toml"):
            assert (self.out / name).read_bytes() == (undisturbed(*self.results_of) / name).read_bytes()
        for row in rows(self.out):
            folder = self.out / "runs" / f"{int(row['run']):05}"
            if not row["error"] and folder.exists():
                kept, steps = read_checkpoint(folder / "checkpoint.npz"), int(row["steps"])
                scene = undisturbed("--folders") / "runs" / folder.name / "scene.toml"
                assert contents(kept.state) == end(scene, steps)
                assert (folder / "recording.usdc").exists() == (kept.options.record is not None)
                if kept.options.series is not None:
                    whole = undisturbed(*MEASURE, "--every", "7", *self.until) / "runs" / folder.name
                    assert (folder / "series.csv").read_bytes() == (whole / "series.csv").read_bytes()
        assert not [path for name in ("*.lock", "*.frames", ".draft*") for path in self.out.rglob(name)]

    def resume(self, *more, codes=(0, 1, 130)):
        assert batch(self.sweep, "-o", self.out, *self.options, *more, "--resume") in codes

    @initialize(
        folders=st.sampled_from(FOLDERS),
        until=st.sampled_from([(), UNTIL]),
        left=st.integers(1, 9),
        of_all=st.booleans(),
    )
    def begin(self, folders, until, left, of_all):
        """Where all groups end early, runs get a folder in which they go on."""
        self.options, self.until, self.slices.of_all = (*folders, *until), until, of_all
        self.results_of = tuple(option for option in self.options if option != "--folders")
        self.interrupted(left)

    @rule(left=st.integers(0, 9))
    def interrupted(self, left):
        self.slices.left = left
        self.resume()
        self.slices.left = 1_000

    @rule(publication=st.integers(1, 20), before=st.booleans())
    def interrupted_in_writing(self, publication, before):
        with suppress(Interrupted), dying_in_writing(Interrupted, publication, before):
            self.resume()

    @rule(index=st.integers(0, 2))
    def shared(self, index):
        self.resume("--index", index, "--count", 3)

    @rule()
    def resumed_by_hand(self):
        for checkpoint in self.out.glob("runs/*/checkpoint.npz"):
            assert exit_code("run", "--resume", checkpoint) == 0

    @rule()
    def folders_are_no_longer_asked_for(self):
        """Runs that are begun keep theirs, and the others need none, but outputs stay the same."""
        self.options = self.results_of

    @rule(number=st.sampled_from(NUMBERS))
    def folder_is_gone(self, number):
        shutil.rmtree(self.out / "runs" / f"{number:05}", ignore_errors=True)

    @rule()
    def all_but_the_folders_of_runs_is_gone(self):
        if (self.out / "runs").exists():
            (self.out / "runs").rename(self.out.with_name("runs"))
            shutil.rmtree(self.out)
            self.out.mkdir()
            self.out.with_name("runs").rename(self.out / "runs")
            self.lost.clear()

    @rule()
    def checkpoints_are_not_there_yet(self):
        """As when a process ends between the first frame and the first checkpoint."""
        for checkpoint in self.out.glob("runs/*/checkpoint.npz"):
            if checkpoint.with_name("recording.usdc.frames").exists():
                checkpoint.unlink()

    @rule()
    def shards_are_gone(self):
        for shard in self.out.glob("parts/[0-9]*.csv"):
            self.lost.append((shard, shard.read_bytes()))
            shard.unlink()

    @rule()
    def shards_are_back(self):
        """As when a file system shows them late: their runs are done twice."""
        for shard, content in self.lost:
            if not shard.exists():
                shard.write_bytes(content)
        self.lost.clear()

    @rule()
    def shards_are_damaged(self):
        for shard in self.out.glob("parts/[0-9]*.csv"):
            shard.write_bytes(shard.read_bytes().replace(b"annulus", b"annalus", 1))
            self.damaged[shard] = shard.stat().st_mtime_ns  # another with the same content may replace it

    @rule()
    def series_are_beyond_their_checkpoints(self):
        for series in self.out.glob("runs/*/series.csv"):
            kept = read_checkpoint(series.with_name("checkpoint.npz"))
            if kept.statistics.steps < kept.options.steps and not kept.statistics.met:  # it has not ended
                series.write_text(f"{series.read_text()}99,0.99,1\n")

    @invariant()
    def no_result_is_written_again(self):
        if self.options is not None:
            there = self.out.glob("parts/[0-9]*.csv")
            results = [path for path in there if any(not row["error"] for row in table(path))]
            moments = {path: path.stat().st_mtime_ns for path in results}
            sound = {path: moment for path, moment in moments.items() if self.damaged.get(path) != moment}
            assert all(sound.get(path, moment) == moment for path, moment in self.written.items())
            self.written = sound


@pytest.mark.parametrize(
    ("folders", "until", "of_all"),
    [((), UNTIL, True), (("--folders",), (), False), (("--usd",), UNTIL, True), (FOLDERS[3], UNTIL, False)],
)
def test_one_sequence_of_every_rule(folders, until, of_all):
    sweep = Sequences()
    try:
        sweep.begin(folders, until, 2, of_all)
        for happen, *given in (
            (sweep.shared, 1),
            (sweep.checkpoints_are_not_there_yet,),
            (sweep.series_are_beyond_their_checkpoints,),
            (sweep.folder_is_gone, 4),
            (sweep.interrupted_in_writing, 7, False),
            (sweep.shards_are_gone,),
            (sweep.shards_are_back,),
            (sweep.shards_are_damaged,),
            (sweep.resumed_by_hand,),
            (sweep.all_but_the_folders_of_runs_is_gone,),
            (sweep.folders_are_no_longer_asked_for,),
        ):
            happen(*given)
            sweep.no_result_is_written_again()
            sweep.interrupted(2)
            sweep.no_result_is_written_again()
    finally:
        sweep.teardown()


@few_or_many(2, 200, stateful_step_count=6)
def test_sequences(how):
    run_state_machine_as_test(Sequences, settings=how)


DRIVER = """
import sys
from warpgrains.cli.main import main
from warpgrains.solver import engine, threads
from warpgrains.sweep import runner
engine.BRIEF, threads.GLANCE = 0, 1e-3
runner.LIMIT = 0.1 * (5 if "--usd" in sys.argv else 1)
runner.LEAST_WIDTH = runner.WIDTH = runner.WIDTH_OF_FOLDERS = 4
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.parametrize(
    ("options", "moments"),
    [
        pytest.param((), [3_000], marks=pytest.mark.slow),
        pytest.param(("--measure", "packing", "--every", "100"), [700, 4_000], marks=pytest.mark.slow),
        (("--usd",), [50]),
    ],
)
def test_two_processes_at_once_are_killed(tmp_path, options, moments):
    """Each does the runs that the other leaves."""
    sweep, out, whole = write(tmp_path, LONG), tmp_path / "out", tmp_path / "whole"
    assert batch(sweep, "-o", whole, *options) == 0
    command = [sys.executable, "-c", DRIVER, "batch", str(sweep), "-o", str(out), "--resume", *options]
    for moment in (*moments, None):
        both = [subprocess.Popen(command, stdout=subprocess.DEVNULL) for _ in range(2)]
        while moment is not None and None in [one.poll() for one in both] and steps_kept(out) < moment:
            time.sleep(0.001)
        for one in both:
            if moment is not None:
                one.kill()
            assert one.wait(timeout=200) in ((0, 1) if moment is None else (0, 1, -9))
    assert batch(sweep, "-o", out, "--resume", *options) == 0
    assert results(out) == results(whole)
    assert len(table(out / "timing.csv")) == 12
    assert not list(out.rglob("*.lock"))
    for path in out.rglob("checkpoint.npz"):
        assert contents(read_checkpoint(path).state) == end(path.with_name("scene.toml"), 800)
    for name in ("recording.usdc", "series.csv"):
        found = {path.relative_to(out): path.read_bytes() for path in out.rglob(name)}
        assert found == {path.relative_to(whole): path.read_bytes() for path in whole.rglob(name)}
