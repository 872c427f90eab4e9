"""Runs that are begun, killed, resumed and started twice at once, in any order: what comes out is known.

The model is one undisturbed run. A killed process is an exception at a random step, or before or after a
random file takes its name; kill -9 at random steps, among several processes at once, is the last test.
"""

import subprocess
import sys
import time
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from command import dying_in_writing, exit_code
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test
from same_bits import contents
from trimmed import few_or_many, trimmed

from warpgrains import Scene, Simulation
from warpgrains.base.files import read_table
from warpgrains.simulation.checkpoint import read_checkpoint
from warpgrains.usd.recorder import log_of, recover
from warpgrains.usd.recording import Recording

STEPS, FPS = 24, 100  # a frame after every step
RUN = ["run", "annulus", "--set", "grains.shift=1e-7", "--fps", str(FPS), "--steps", str(STEPS)]


class Killed(BaseException):
    """What stands for a killed process."""


@cache
def model():
    """Return the states after each step of a run that nothing disturbs."""
    simulation = Simulation(Scene.load("annulus", ["grains.shift=1e-7"]), threads=1)
    states = [simulation.state()]
    for _ in range(STEPS):
        simulation.step()
        states.append(simulation.state())
    return states


def require_frames(path, count):
    """Check that a recording holds the first frames of the model, as far as its numbers go."""
    expected = np.array([state.position for state in model()[:count]], np.float32)
    assert np.array_equal(Recording(path).position, expected)


class Sequences(RuleBasedStateMachine):
    """Actions on one run; what lies on the disk is always a part of the model."""

    def __init__(self):
        super().__init__()
        self.folder = TemporaryDirectory()
        self.kept, self.output = (Path(self.folder.name, name) for name in ("run.npz", "run.usdc"))
        self.patch = pytest.MonkeyPatch()
        self.is_begun = False

    def teardown(self):
        self.patch.undo()
        if self.is_begun:
            assert exit_code("run", "--resume", self.kept) == 0
            require_frames(self.output, STEPS + 1)
            assert contents(read_checkpoint(self.kept).state) == contents(model()[STEPS])
            left = {path.name for path in Path(self.folder.name).iterdir()}
            assert left == {self.kept.name, self.output.name}
        self.folder.cleanup()

    @initialize(every=st.integers(1, 9))
    def begin(self, every):
        """The process dies after the first checkpoint."""
        self.die_at_step(0)
        options = ["--checkpoint", self.kept, "-o", self.output, "--every", every]
        self.until_death(*RUN, *options)
        self.is_begun = True

    @rule(step=st.integers(0, STEPS))
    def killed_in_a_step(self, step):
        self.die_at_step(step)
        self.until_death("run", "--resume", self.kept)

    @rule(publication=st.integers(1, 12), before=st.booleans(), every=st.integers(1, 9))
    def killed_in_writing(self, publication, before, every):
        with dying_in_writing(Killed, publication, before):
            self.until_death("run", "--resume", self.kept, "--every", every)

    @rule(step=st.integers(0, STEPS))
    def twice_at_once(self, step):
        """While one process is at this step, another begins: it is refused, and the first goes on."""
        advance, codes = Simulation.advance, []

        def try_another(simulation, *arguments):
            if simulation.steps >= step and not codes:
                codes.append(exit_code("run", "--resume", self.kept))
            return advance(simulation, *arguments)

        self.patch.setattr(Simulation, "advance", try_another)
        self.until_death("run", "--resume", self.kept)
        assert codes in ([], [2])

    @rule()
    def recovered(self):
        if log_of(self.output).exists():
            require_frames(*recover(log_of(self.output)))

    @invariant()
    def checkpoint_is_of_the_model(self):
        if self.is_begun:
            state = read_checkpoint(self.kept).state
            assert contents(state) == contents(model()[state.steps])

    def die_at_step(self, step):
        advance = Simulation.advance

        def die(simulation, steps, *arguments):
            if simulation.steps + steps > step:
                raise Killed
            return advance(simulation, steps, *arguments)

        self.patch.setattr(Simulation, "advance", die)

    def until_death(self, *arguments):
        try:
            assert exit_code(*arguments) == 0
        except Killed:
            pass
        finally:
            self.patch.undo()


@few_or_many(8, 1000, stateful_step_count=8)
def test_sequences(how):
    run_state_machine_as_test(Sequences, settings=how)


POURED = ["silo", "--steps", 500, "--forces", "--measure", "flow,kinetic_energy"]  # in the order of colors


def start(*arguments):
    command = [sys.executable, "-m", "warpgrains", "run", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize("count", [1, pytest.param(trimmed(100), marks=pytest.mark.slow)])
def test_processes(tmp_path, count):
    """Kill -9 at random steps, among processes that continue one run at once: nothing tells that there were.

    One of them does, or they do one after the other; those that are refused say so in one line.
    """
    names = "run.usdc", "run.npz", "run.csv"
    whole, end, series = (tmp_path / name for name in names)
    assert exit_code("run", *POURED, "-o", whole, "--checkpoint", end, "--series", series, "--every", 5) == 0
    expected = read_checkpoint(end)
    rows = read_table(series)
    assert float(rows[-1]["inflow_count"]) > 30
    for number in range(count):
        rng = np.random.default_rng(number)
        folder = tmp_path / str(number)
        folder.mkdir()
        output, kept, measured = (folder / name for name in names)
        every = int(rng.integers(1, 8))
        options = ["-o", output, "--checkpoint", kept, "--series", measured, "--every", 5 * every]
        processes = [start(*POURED, *options)]
        for step in sorted(rng.integers(0, expected.statistics.steps, 1 + number % 3)):
            while None in [process.poll() for process in processes] and not (
                kept.exists() and read_checkpoint(kept).statistics.steps >= step
            ):
                time.sleep(0.005)
            time.sleep(rng.uniform(0.0, 0.05))
            for process in processes:
                process.kill()
                process.communicate(timeout=60)
            processes = [start("--resume", kept) for _ in range(2 + number % 2)]
        ends = [(process.communicate(timeout=600)[1], process.returncode) for process in processes]
        assert 0 in [code for _, code in ends]
        assert all(code == 0 or (code == 2 and said.count("\n") == 1) for said, code in ends)
        found = read_checkpoint(kept)
        assert output.read_bytes() == whole.read_bytes()
        assert read_table(measured) == rows[::every]
        assert contents(found.state) == contents(expected.state)
        assert replace(found.statistics, seconds=0.0) == replace(expected.statistics, seconds=0.0)
        left = {path.name for path in folder.iterdir() if path.suffix != ".lock"}
        assert left == {*names}
