"""Checked mode: the first index outside of its array is reported, with array and index."""

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
        wg.Simulation("polydisperse", order="color", threads=threads).advance(50)
    except wg.SimulationError as error:
        print(error)
"""
CASES = [
    ("contacts.set_start", 3, 1),
    ("verlet.recent_deviation", 5, 1),
    ("grains.next_velocity", 40, 2),
]


def checked(*arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "WARPGRAINS_CHECK_BOUNDS": "1"}
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, env=environment)


def test_first_violation_is_reported() -> None:
    done = checked("-c", TOO_SHORT.format(cases=CASES))
    assert done.returncode == 0, done.stderr
    for line, (name, length, _) in zip(done.stdout.splitlines(), CASES, strict=True):
        reported = rf"index \d+ of {re.escape(name)}, which has length {length}, was used"
        assert re.fullmatch(rf"step \d+: {reported}: please report this defect with the scene.*", line), line


def test_every_access_is_checked() -> None:
    """C++ that uses data of a scene is passed to `checked`, and writes elements as ARRAY.data[INDEX]."""
    elsewhere = {
        "advance.py",
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
            assert not re.search(r"\.data(?!\[)|\.data\[[^]]*\[", code), f"{file.name}: {code}"
        assert not re.findall(r"\bs\.[a-z_]+\.[a-z_.]+(?<!shape)\[", source), (
            f"{file.name} indexes an array itself"
        )


@pytest.mark.slow
def test_hard_scenes_stay_within_their_arrays() -> None:
    steps = 250 if trimmed(10_000) < 10_000 else 10_000
    done = checked(str(ROOT / "tests/support/bounds_fuzz.py"), str(steps))
    assert done.returncode == 0, done.stderr
