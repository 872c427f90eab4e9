"""Checked mode: the first index outside of its array is reported, with stage, array and index."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from pages import ROOT
from trimmed import trimmed

import warpgrains.kernels

TOO_SHORT = """
import warpgrains as wg
from warpgrains.solver import buffers, sizes

def lengths(size):
    table = sizes.lengths(size)
    {change}
    return table

buffers.lengths = lengths
wg.Simulation(wg.Scene.load("polydisperse"), method={method!r}, order="color", threads={threads}).advance(50)
"""


def checked(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python in checked mode."""
    environment = {**os.environ, "WARPGRAINS_CHECK_BOUNDS": "1"}
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, env=environment)


@pytest.mark.parametrize(
    ("change", "method", "threads", "reported"),
    [
        (
            'table["contacts"]["set_start"] = 3',
            "gauss-seidel",
            1,
            r"place_pairs uses index 3 of contacts\.set_start, which has length 3",
        ),
        (
            'table["momentum"]["last_velocity"] = 5',
            "accelerated",
            1,
            r"begin_momentum uses index \d+ of momentum\.last_velocity, which has length 5",
        ),
        (
            'table["grains"]["next_velocity"] = 40',
            "gauss-seidel",
            2,
            r"begin_velocity uses index \d+ of grains\.next_velocity, which has length 40",
        ),
    ],
)
def test_first_violation_is_reported(change: str, method: str, threads: int, reported: str) -> None:
    done = checked("-c", TOO_SHORT.format(change=change, method=method, threads=threads))
    expected = rf"SimulationError: step \d+: {reported}: please report this defect with the scene"
    assert re.search(expected, done.stderr.splitlines()[-1]), done.stderr


def test_every_access_is_checked() -> None:
    """C++ that uses data of a scene is passed to `checked`, and writes elements as ARRAY.data[INDEX]."""
    elsewhere = {
        "advance.py",
        "gpu.py",
        "placing.py",
        "pushing.py",
        "threads.py",
        "waiting.py",
    }
    for file in Path(warpgrains.kernels.__file__).parent.glob("*.py"):
        if file.name in elsewhere:  # counters of threads, and arrays that are not a scene's
            continue
        source = re.sub(r'CHECK = """.*?"""', "", file.read_text(), flags=re.DOTALL)
        source = source.replace("(double *)velocity.data + PLACE", "")  # tested by PLACE itself
        for decorated in source.split("@wp.func_native(")[1:]:
            code = re.split(r"\n *def ", decorated)[0]
            assert ".data" not in code or code.lstrip().startswith("checked("), f"{file.name}: {code}"
            assert not re.search(r"\.data(?!\[)", code), f"{file.name}: {code}"
        assert not re.findall(r"\bs\.[a-z_]+\.[a-z_.]+(?<!shape)\[", source), (
            f"{file.name} indexes an array itself"
        )


def test_command_line(tmp_path: Path) -> None:
    run = ("-m", "warpgrains", "run", "annulus", "--steps", "5", "--check-bounds")
    done = subprocess.run([sys.executable, *run], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "every index within its array" in done.stdout


@pytest.mark.slow
def test_hard_scenes_stay_within_their_arrays() -> None:
    steps = 500 if trimmed(10_000) < 10_000 else 10_000
    done = checked(str(ROOT / "tests/support/bounds_fuzz.py"), str(steps))
    assert done.returncode == 0, done.stderr
