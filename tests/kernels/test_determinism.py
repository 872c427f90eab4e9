"""The same bits on every run and in every process (for any number of workers: test_threads.py)."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest

from warpgrains import Scene, Simulation
from warpgrains.scene.fields import ORDERS

IN_A_FRESH_PROCESS = "import sys, test_determinism as t; print(*t.golden_hashes(int(sys.argv[1])))"


def golden_hashes(threads: int) -> list[str]:
    return [golden_hash(order, threads) for order in ORDERS]


def golden_hash(order: str, threads: int) -> str:
    """Hash all that a run leaves behind, and all that it reports."""
    simulation = Simulation(Scene.load("polydisperse"), threads=threads, order=order)
    reports = [simulation.step() for _ in range(50)]
    state = simulation.state()
    told = [(r.iterations, r.zeta, r.contacts, r.overlap) for r in reports]
    digest = hashlib.sha256(np.array(told).tobytes())
    for array in (state.position, state.velocity, *vars(state.corrections).values()):
        digest.update(b"" if array is None else np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


@pytest.fixture(scope="module")
def here() -> list[str]:
    return golden_hashes(threads=1)


def test_again(here: list[str]) -> None:
    assert golden_hashes(threads=1) == here


@pytest.mark.parametrize("threads", [1, 2])
def test_fresh_process(here: list[str], threads: int) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", IN_A_FRESH_PROCESS, str(threads)]
    process = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert process.returncode == 0, process.stderr
    assert process.stdout.splitlines()[-1].split() == here
