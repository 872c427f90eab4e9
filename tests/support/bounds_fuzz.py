"""Random steps of hard scenes in checked mode: every index that a kernel uses is tested (kernels/access.py).

    python tests/support/bounds_fuzz.py STEPS [SEED [LONGEST]]

Scenes, threads, restores and resumed checkpoints are drawn at random. Runs of one scene have up to LONGEST
steps (60) before something changes. It ends with status 1 at the first index that is outside of its array.
"""

import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

os.environ["WARPGRAINS_CHECK_BOUNDS"] = "1"  # before the kernels are imported

import numpy as np
from random_scenes import random_scene

from warpgrains import Batch, Simulation, SimulationError
from warpgrains.solver import service

service._find_proof = lambda *_: None  # NumPy's, with indices of its own; it takes most of the time


def moved(simulation: Simulation, rng: np.random.Generator, folder: Path) -> Simulation:
    """Go on as before, from the state, from a checkpoint on other threads, or with another gravity."""
    way = rng.integers(4)
    if way == 0:
        simulation.restore(simulation.state())
    elif way == 1:
        simulation.save(folder / "state.npz")
        return Simulation.load(folder / "state.npz", threads=1 + int(rng.random() < 0.2))
    elif way == 2:
        simulation.change(gravity=(float(rng.normal(0.0, 20.0)), -9.81))
    return simulation


def runs(rng: np.random.Generator, folder: Path, longest: int = 60) -> Iterator[tuple[Any, int]]:
    """Yield what is to be advanced, and how far, of one random scene, or of a batch of some."""
    if rng.random() < 0.1:
        scenes = [random_scene(rng) for _ in range(3)]
        yield Batch(scenes, threads=int(rng.integers(1, 3))), longest // 3
        return
    simulation = Simulation(random_scene(rng), threads=int(rng.choice([1, 1, 1, 1, 2, 3])))
    for _ in range(6):
        yield simulation, int(rng.integers(1, longest))
        simulation = moved(simulation, rng, folder)


def advanced(what: Any, steps: int) -> int:
    """Take steps; return how many were taken. A scene that has no solution may refuse them."""
    try:
        if isinstance(what, Batch):
            what.run(steps)
            return steps * len(what.scenes)
        what.advance(steps)
    except SimulationError as error:
        if "please report" in str(error):
            raise
    return steps


def fuzz(steps: int, seed: int, longest: int = 60) -> int:
    """Take at least so many random steps; return how many."""
    done = scene = 0
    with tempfile.TemporaryDirectory() as folder:
        while done < steps:
            try:
                for what, some in runs(np.random.default_rng((seed, scene)), Path(folder), longest):
                    done += advanced(what, some)
            except SimulationError as error:
                sys.exit(f"scene {scene} of seed {seed}: {error}")
            scene += 1
    return done


if __name__ == "__main__":
    number, *rest = map(int, sys.argv[1:])
    print(f"{fuzz(number, *(rest or [0]))} steps, every index within its array")
