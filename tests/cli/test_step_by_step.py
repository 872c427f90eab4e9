"""`run --step-by-step`: the course's keys, from a pipe and from a terminal; its history, and a picture."""

import os
import pty
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from command import exit_code, require_refusal

from warpgrains import Scene, Simulation
from warpgrains.cli import step_by_step
from warpgrains.files import read_table

COMMAND = [sys.executable, "-m", "warpgrains", "run", "annulus", "--step-by-step"]
Press = Callable[..., tuple[str, str]]
HISTORY = "step,iteration,zeta,residual\n"


def steps_of(printed: str) -> list[int]:
    return [int(line.split()[0]) for line in printed.splitlines()[2:]]


@pytest.fixture
def press(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Press:
    """Send keys through a pipe, which ends with them; return what is printed and complained of."""

    def press(keys: str, *options: object) -> tuple[str, str]:
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
    ("keys", "steps"), [("nNn", 3), ("nrsnqnn", 3), ("q", 0), ("", 0), ("r", 25), ("n\nr\n", 25)]
)
def test_keys(press: Press, keys: str, steps: int) -> None:
    printed, complaint = press(keys, "--steps", 25)
    assert complaint == ""
    assert steps_of(printed) == list(range(1, steps + 1))


@pytest.mark.parametrize("keys", ["nNxn", "nn n", "nné", "n\x1b[An"])
def test_an_unknown_key_is_answered_with_those_that_there_are(press: Press, keys: str) -> None:
    _, complaint = press(keys, "--steps", 25)
    assert complaint.count("\n") == 1
    assert "unknown key; N: next step   R: run   S: stop   Q: quit" in complaint


class Terminal:
    def __init__(self, *options: str) -> None:
        self.ours, self.theirs = pty.openpty()
        self.before = termios.tcgetattr(self.theirs)
        command = ["timeout", "--foreground", "100", *COMMAND, *options]
        self._process = subprocess.Popen(command, stdin=self.theirs, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        self.printed = self._process.stdout
        assert "N: next step" in self.printed.readline()
        self.printed.readline()

    def press(self, keys: str) -> None:
        os.write(self.ours, keys.encode())  # and no end of a line

    def step(self) -> str:
        return self.printed.readline().split()[0]

    def rest(self) -> list[str]:
        """Return the other lines that it prints before it ends, and leaves the terminal as it was."""
        lines = self.printed.readlines()
        assert self._process.wait(timeout=60) == 0
        assert termios.tcgetattr(self.theirs) == self.before
        return lines


def test_a_run_is_in_real_time_and_can_be_stopped() -> None:
    terminal = Terminal("--set", "time.dt=0.05", "--steps", "1000")
    begin = time.monotonic()
    terminal.press("r")
    assert [terminal.step() for _ in range(21)] == [str(step) for step in range(1, 22)]
    assert time.monotonic() - begin >= 20 * 0.05
    terminal.press("sq")
    assert len(terminal.rest()) < 900


def test_a_terminal_gives_keys_at_once() -> None:
    terminal = Terminal()
    for step in ("1", "2"):
        terminal.press("n")
        assert terminal.step() == step
    terminal.press("q")
    assert terminal.rest() == []


@pytest.mark.parametrize("spacing", [0.05, 0.0])
def test_steps_of_a_run_are_that_far_apart(spacing: float, monkeypatch: pytest.MonkeyPatch) -> None:
    clock, pressed = [10.0], ["r"]

    def key(patience: float | None) -> str | None:
        clock[0] += patience or 0.0
        return pressed.pop() if pressed else None

    monkeypatch.setattr(step_by_step, "_key", key)
    monkeypatch.setattr(step_by_step, "monotonic", lambda: clock[0])
    begun = [clock[0] for _ in step_by_step._pressed(5, spacing)]
    assert begun == pytest.approx([10.0 + k * spacing for k in range(5)])


def test_history_has_every_iteration_and_is_drawn(
    press: Press, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "zeta.csv"
    press("r", "--steps", 40, "--history", output)
    rows, simulation = read_table(output), Simulation(Scene.load("annulus"))
    for step in range(1, 41):
        history = simulation.step(history=True).history
        assert history is not None
        found = [(float(row["zeta"]), float(row["residual"])) for row in rows if row["step"] == str(step)]
        assert found == list(zip(*history, strict=True))
    assert exit_code("plot", output) == 0
    assert capfd.readouterr().out == f"{tmp_path / 'zeta.png'}: 40 steps\n"
    assert (tmp_path / "zeta.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    "text", ["a,b\n1,2\n", HISTORY, HISTORY + "1,1,x,0\n", HISTORY + "1,1,nan,0\n", HISTORY + "1\n"]
)
def test_a_table_that_is_no_history(text: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.csv").write_text(text)
    assert exit_code("plot", tmp_path / "a.csv") == 2
    require_refusal(capfd, "is not a history: `warpgrains run --step-by-step --history` writes one")
    assert not (tmp_path / "a.png").exists()
