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

lengths = sizes.lengths
for name, length, threads in {cases}:
    group, array = name.split(".")
    buffers.lengths = lambda size: (table := lengths(size)) | {{group: table[group] | {{array: length}}}}
    try:
        wg.Simulation(
            wg.Scene.load("polydisperse"), method="accelerated", order="color", threads=threads
        ).advance(50)
    except wg.SimulationError as error:
        print(error)
"""
CASES = {
    ("contacts.set_start", 3, 1): "place_walls uses index 3 of",
    ("momentum.last_velocity", 5, 1): r"begin_momentum uses index \d+ of",
    ("grains.next_velocity", 40, 2): r"begin_velocity uses index \d+ of",
}


def checked(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python in checked mode."""
    environment = {**os.environ, "WARPGRAINS_CHECK_BOUNDS": "1"}
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, env=environment)


def test_first_violation_is_reported() -> None:
    done = checked("-c", TOO_SHORT.format(cases=list(CASES)))
    assert done.returncode == 0, done.stderr
    for line, ((name, length, _), use) in zip(done.stdout.splitlines(), CASES.items(), strict=True):
        reported = rf"{use} {re.escape(name)}, which has length {length}"
        assert re.fullmatch(rf"step \d+: {reported}: please report this defect with the scene.*", line), line


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
    run = ("-m", "warpgrains", "run", "annulus", "--method", "accelerated", "--steps", "5", "--check-bounds")
    done = subprocess.run([sys.executable, *run], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "every index within its array" in done.stdout


@pytest.mark.slow
def test_hard_scenes_stay_within_their_arrays() -> None:
    steps = 250 if trimmed(10_000) < 10_000 else 10_000
    done = checked(str(ROOT / "tests/support/bounds_fuzz.py"), str(steps))
    assert done.returncode == 0, done.stderr
