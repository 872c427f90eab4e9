"""Kernels compiled in checked mode, which names the first index outside of its array, and for a GPU."""

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from random_scenes import random_scene
from trimmed import trimmed

import warpgrains.kernels
from warpgrains import Batch, Simulation, SimulationError
from warpgrains.kernels.step import Kind, fused_step
from warpgrains.kernels.team.advance import kernel
from warpgrains.solver import buffers, failures, sizes

TOO_SHORT = [
    ("contacts.set_start", 3, 1),
    ("verlet.recent_deviation", 5, 1),
    ("grains.next_velocity", 40, 2),
]
HOPPER = 90
OF_EVERY_STAGE = [Kind(method, True, True, True) for method in ("gauss-seidel", "exact")]
"""The exact method has the stages of the accelerated one, and these are with all options."""


def checked(call: str) -> str:
    """Return what a function of this file prints, called in checked mode, which a process reads once."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "WARPGRAINS_CHECK_BOUNDS": "1"}
    command = [sys.executable, "-c", f"import test_check_bounds as own; own.{call}"]
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, env=environment, check=True).stdout


def with_length(name: str, length: int) -> Callable[[Any], Any]:
    """Return the lengths of all arrays, one of them changed."""
    group, array = name.split(".")

    def lengths(size: Any) -> Any:
        table = sizes.lengths(size)
        return table | {group: table[group] | {array: length}}

    return lengths


def print_violations() -> None:
    for name, length, threads in TOO_SHORT:
        buffers.lengths = with_length(name, length)
        try:
            Simulation("polydisperse", order="color", threads=threads).advance(50)
        except SimulationError as error:
            print(error)


def test_first_violation_is_reported() -> None:
    lines = checked("print_violations()").splitlines()
    for line, (name, length, _) in zip(lines, TOO_SHORT, strict=True):
        reported = rf"index \d+ of {re.escape(name)}, which has length {length}, was used"
        assert re.fullmatch(rf"step \d+: {reported}: please report this defect with the scene.*", line), line


def test_every_access_is_checked() -> None:
    """C++ that uses data of a scene is passed to `checked`, and writes elements as ARRAY.data[INDEX]."""
    elsewhere = {"advance.py", "placing.py", "pushing.py", "threads.py", "waiting.py"}
    for file in Path(warpgrains.kernels.__file__).parent.rglob("*.py"):
        if file.name in elsewhere:  # counters of threads, and arrays that are not a scene's
            continue
        source = re.sub(r'CHECK = """.*?"""', "", file.read_text(), flags=re.DOTALL)
        source = source.replace("(double *)velocity.data + PLACE", "")  # tested by PLACE itself
        for decorated in source.split("@wp.func_native(")[1:]:
            code = re.split(r"\n *def ", decorated)[0]
            assert ".data" not in code or code.lstrip().startswith("checked("), f"{file.name}: {code}"
            assert not re.search(r"\.data(?!\[)|\.data\[[^]]*\[", code), f"{file.name}: {code}"
        own = re.findall(r"\bs\.[a-z_]+\.[a-z_.]+(?<!shape)\[", source)
        assert not own, f"{file.name} indexes an array itself"


def random_runs(rng: np.random.Generator, file: str) -> Iterator[Simulation | Batch]:
    """Yield a random batch, or a simulation that goes on as before, from its state, or a file, or changed."""
    if rng.random() < 0.1:
        yield Batch([random_scene(rng) for _ in range(3)], threads=int(rng.integers(1, 3)))
        return
    simulation = Simulation(random_scene(rng), threads=int(rng.choice([1, 1, 1, 1, 2, 3])))
    for way in rng.integers(4, size=6):
        yield simulation
        if way == 0:
            simulation.restore(simulation.state())
        elif way == 1:
            simulation.save(file)
            simulation = Simulation.load(file, threads=1 + int(rng.random() < 0.2))
        elif way == 2:
            simulation.change(gravity=(float(rng.normal(0.0, 20.0)), -9.81))


def fuzz(steps: int, file: str) -> None:
    """Take at least so many steps of hard scenes, some of which may refuse them."""
    failures._find_proof = lambda *_: None  # NumPy's, with indices of its own; it takes most of the time
    scene = 0
    while steps > 0:
        rng, scene = np.random.default_rng((0, scene)), scene + 1
        for what in random_runs(rng, file):
            some = int(rng.integers(1, 60))
            steps -= some
            try:
                what.run(some)
            except SimulationError as error:
                if "please report" in str(error):
                    raise


@pytest.mark.slow
def test_hard_scenes_stay_within_their_arrays(tmp_path: Path) -> None:
    steps = 100 if trimmed(10_000) < 10_000 else 10_000
    checked(f"fuzz({steps}, {str(tmp_path / 'state.npz')!r})")


@pytest.mark.slow
@pytest.mark.parametrize("kind", OF_EVERY_STAGE, ids=str)
def test_compiles_for_cuda(tmp_path: Path, kind: Kind) -> None:
    """On a machine that has no GPU."""
    module = kernel(f"compiled_for_cuda_{kind}", fused_step(kind), on_gpu=True).module
    wp.compile_aot_module(module, arch=HOPPER, module_dir=tmp_path, use_ptx=True)
    assert list(tmp_path.glob("*.ptx"))
