"""`run --step-by-step`: the course's keys, from a pipe and from a terminal; its history, and a picture."""

import os
import pty
import subprocess
import sys
import termios
from pathlib import Path

import pytest
from command import exit_code, require_refusal

from warpgrains import Scene, Simulation
from warpgrains.files import read_table

COMMAND = [sys.executable, "-m", "warpgrains", "run", "annulus", "--step-by-step"]
HISTORY = "step,iteration,zeta,residual\n"


def steps_of(printed: str) -> list[int]:
    return [int(line.split()[0]) for line in printed.splitlines()[2:]]


@pytest.mark.parametrize(("keys", "steps"), [("nNxn", 3), ("nrsnqnn", 3), ("q", 0), ("", 0), ("r", 25)])
def test_keys(keys: str, steps: int) -> None:
    done = subprocess.run([*COMMAND, "--steps", "25"], input=keys, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert steps_of(done.stdout) == list(range(1, steps + 1))


def test_a_terminal_gives_keys_at_once_and_is_left_as_it_was() -> None:
    ours, theirs = pty.openpty()
    before = termios.tcgetattr(theirs)
    command = ["timeout", "--foreground", "100", *COMMAND]
    with subprocess.Popen(command, stdin=theirs, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        heads = [process.stdout.readline() for _ in range(2)]
        assert "N: next step" in heads[0]
        for step in (1, 2):
            os.write(ours, b"n")  # and no end of a line
            assert process.stdout.readline().split()[0] == str(step)
        os.write(ours, b"q")
        assert process.wait(timeout=60) == 0
    assert termios.tcgetattr(theirs) == before


def test_history_has_every_iteration_and_is_drawn(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "zeta.csv"
    options = ["--steps", "40", "--history", str(output)]
    subprocess.run([*COMMAND, *options], input="r", check=True, capture_output=True, text=True)
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
    ("options", "complaint"),
    [
        (["-o", "a.usdc"], "--output cannot go with --step-by-step"),
        (["--checkpoint", "a.npz"], "--checkpoint cannot go with --step-by-step"),
        (["--json"], "--json cannot go with --step-by-step"),
        (["--history", "a.txt"], "must end in .csv"),
        (["--history", "mine.csv"], "no history"),
    ],
)
def test_bad_options_are_one_line(
    options: list[str],
    complaint: str,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.csv").write_text("a,b\n1,2\n")
    assert exit_code("run", "annulus", "--step-by-step", *options) == 2
    require_refusal(capfd, complaint)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.csv"]


def test_history_needs_step_by_step(capfd: pytest.CaptureFixture[str]) -> None:
    assert exit_code("run", "annulus", "--history", "a.csv") == 2
    require_refusal(capfd, "--history needs --step-by-step")


@pytest.mark.parametrize(
    "text", ["a,b\n1,2\n", HISTORY, HISTORY + "1,1,x,0\n", HISTORY + "1,1,nan,0\n", HISTORY + "1\n"]
)
def test_a_table_that_is_no_history(text: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.csv").write_text(text)
    assert exit_code("plot", tmp_path / "a.csv") == 2
    require_refusal(capfd, "is no history of `warpgrains run --step-by-step --history`")
    assert not (tmp_path / "a.png").exists()
