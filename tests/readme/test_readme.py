"""What the README shows is true: its Python runs and is typed, its commands are there, and run if quick."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command import exit_code

import warpgrains
from warpgrains.cli import main as command_line

README = Path(__file__).parents[2] / "README.md"
SLOW = ("batch", "report", "grade", "view")
PLACEHOLDER = re.compile(r"\b[A-Z]{3,}\b|\.\.\.|tcp:|\$")
GIVEN = "import numpy as np\n\nxy = np.array([[0.9, 0.1], [-0.8, 0.4]])\n"
"""What its code takes for granted."""


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", README.read_text(), re.M | re.S)


def commands():
    found = re.findall(r"(?:^|/)(warpgrains \w+.*?)(?: +#.*)?$", "\n".join(blocks("bash")), re.M)
    found += re.findall(r"`(warpgrains \w+ [^`]+)`", README.read_text())
    return sorted({line for line in found if line.split()[1] in command_line.COMMANDS})


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    path = tmp_path_factory.mktemp("readme") / "readme.py"
    path.write_text(GIVEN + "\n".join(blocks("python")))
    return path


def test_python_runs(program, monkeypatch):
    monkeypatch.chdir(program.parent)
    names = {}
    exec(compile(program.read_text(), program, "exec"), names)
    assert names["summary"].steps == 800
    assert np.isfinite(names["simulation"].position).all()
    assert (program.parent / "annulus.usdc").is_file()
    assert (program.parent / "annulus.npz").is_file()


CHECKERS = {
    "mypy": ["mypy"],
    "pyright": ["basedpyright", "--level", "error", "--pythonpath", sys.executable],
}


@pytest.mark.parametrize(
    "checker",
    [CHECKERS["mypy"], pytest.param(CHECKERS["pyright"], marks=pytest.mark.slow)],
    ids=CHECKERS,
)
def test_python_is_typed(program, checker):
    command = [sys.executable, "-m", *checker, str(program)]
    done = subprocess.run(command, cwd=README.parent, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    assert (Path(warpgrains.__file__).parent / "py.typed").is_file()


@pytest.mark.parametrize("line", commands())
def test_commands_are_parsed(line):
    words = shlex.split(line)[1:]
    if not PLACEHOLDER.search(line) and words[0] != "run":
        assert command_line._parser().parse_args(words).command is command_line.COMMANDS[words[0]]


def test_quick_commands_run(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    ran = 0
    for line in sorted(commands(), key=lambda line: "run" not in line.split()):
        words = shlex.split(line)[1:]
        needed = [
            word for word in words[1:] if word.endswith((".npz", ".usdc", ".csv")) and words[0] != "run"
        ]
        if words[0] in SLOW or PLACEHOLDER.search(line) or "pile" in words or "--resume" in words:
            continue
        if all((tmp_path / word).exists() for word in needed):
            assert exit_code(*words) == 0, (line, capfd.readouterr().err)
            ran += 1
    assert ran >= 4
