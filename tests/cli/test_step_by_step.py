"""`run --step-by-step`: the course's keys, from a pipe and from a terminal; its history, and a picture."""

import os
import pty
import subprocess
import sys
import termios
import time

import pytest
from command import exit_code

from warpgrains import Scene, Simulation
from warpgrains.base.files import read_table
from warpgrains.cli import step_by_step

UNKNOWN = "unknown key; N: next step   R: run   S: stop   Q: quit\n"


@pytest.fixture
def press(monkeypatch, capfd):
    """Send keys through a pipe, which ends with them; return what is printed and complained of."""

    def press(keys, *options):
        theirs, ours = os.pipe()
        os.write(ours, keys.encode())
        os.close(ours)
        monkeypatch.setattr(step_by_step, "STDIN", theirs)
        try:
            assert exit_code("run", "annulus", "--step-by-step", *options) == 0
        finally:
            os.close(theirs)
        return capfd.readouterr()

    return press


@pytest.mark.parametrize(
    ("keys", "steps", "complaint"),
    [
        ("nNn", 3, ""),
        ("nrsnqnn", 3, ""),
        ("n\nr\n", 25, ""),
        ("nNxn", 3, UNKNOWN),
        ("nné", 2, UNKNOWN),
        ("n\x1b[An", 1, UNKNOWN),
    ],
)
def test_keys(press, keys, steps, complaint):
    """What comes with an escape is a part of the unknown key."""
    printed, said = press(keys, "--steps", 25)
    assert said == complaint
    assert [line.split()[0] for line in printed.splitlines()[2:]] == list(map(str, range(1, steps + 1)))


def test_a_terminal_gives_keys_at_once_and_a_run_is_in_real_time():
    ours, theirs = pty.openpty()
    before = termios.tcgetattr(theirs)
    run = [sys.executable, "-m", "warpgrains", "run", "annulus", "--step-by-step"]
    command = ["timeout", "--foreground", "100", *run, "--set", "time.dt=0.05", "--steps", "1000"]
    process = subprocess.Popen(command, stdin=theirs, stdout=subprocess.PIPE, text=True)
    assert "N: next step" in process.stdout.readline()
    process.stdout.readline()

    def steps(keys, count):
        """Press keys, without an end of a line, and return the next steps that are printed."""
        os.write(ours, keys)
        return [int(process.stdout.readline().split()[0]) for _ in range(count)]

    assert steps(b"n", 1) + steps(b"n", 1) == [1, 2]
    begin = time.monotonic()
    assert steps(b"r", 11) == list(range(3, 14))
    assert time.monotonic() - begin >= 10 * 0.05
    os.write(ours, b"sq")
    assert len(process.stdout.readlines()) < 900
    assert process.wait(timeout=60) == 0
    assert termios.tcgetattr(theirs) == before


@pytest.mark.parametrize("spacing", [0.05, 0.0])
def test_steps_of_a_run_are_that_far_apart(spacing, monkeypatch):
    clock, pressed = [10.0], ["r"]

    def key(patience):
        clock[0] += patience or 0.0
        return pressed.pop() if pressed else None

    monkeypatch.setattr(step_by_step, "_key", key)
    monkeypatch.setattr(step_by_step, "monotonic", lambda: clock[0])
    begun = [clock[0] for _ in step_by_step._pressed(5, spacing)]
    assert begun == pytest.approx([10.0 + k * spacing for k in range(5)])


def test_history_has_every_iteration_and_is_drawn(press, tmp_path, capfd):
    output = tmp_path / "zeta.csv"
    press("r", "--steps", 25, "--history", output)
    rows, simulation = read_table(output), Simulation(Scene.load("annulus"))
    for step in range(1, 26):
        history = simulation.step(history=True).history
        assert history is not None
        found = [(float(row["zeta"]), float(row["residual"])) for row in rows if row["step"] == str(step)]
        assert found == list(zip(*history, strict=True))
    assert exit_code("plot", output) == 0
    assert capfd.readouterr().out == f"{tmp_path / 'zeta.png'}: 25 steps\n"
    assert (tmp_path / "zeta.png").read_bytes().startswith(b"\x89PNG")
