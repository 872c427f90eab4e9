"""Random steps of hard scenes in checked mode: every index that a kernel uses is tested (kernels/access.py).

    python tests/support/bounds_fuzz.py STEPS [SEED [LONGEST]]

Scenes are dense, jammed, huge, tiny or spread; methods, orders, schemes, walls, friction, threads, restores
and resumed checkpoints are drawn at random. Runs of one scene have up to LONGEST steps (60) before something
changes. It ends with status 1 at the first index that is outside of its array.
"""

import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

os.environ["WARPGRAINS_CHECK_BOUNDS"] = "1"  # before the kernels are imported

import numpy as np

from warpgrains import Batch, Scene, Segment, Simulation, SimulationError
from warpgrains.scene.fields import METHODS, ORDERS
from warpgrains.solver import service

service._find_proof = lambda *_: None  # NumPy's, with indices of its own; it takes most of the time

GRAINS = {"dense": (40, 160), "jammed": (20, 100), "huge": (500, 1500), "tiny": (1, 4), "spread": (5, 80)}
KINDS = tuple(GRAINS)
OFTEN = (0.25, 0.3, 0.005, 0.22, 0.225)


def random_scene(rng: np.random.Generator) -> Scene:
    """Draw a scene: its kind says how many grains there are, and how they overlap."""
    kind = str(rng.choice(KINDS, p=OFTEN))
    n = int(rng.integers(*GRAINS[kind]))
    inner = float(rng.choice([0.0, 0.3]))
    filled = {"dense": rng.uniform(1.0, 6.0), "jammed": rng.uniform(0.9, 1.3), "tiny": 0.3}.get(kind, 0.5)
    typical = np.sqrt(filled * (1.0 - inner**2) / n)
    ratio = float(rng.choice([1.0, 1.5, 10.0]))
    radius = np.minimum(typical * rng.uniform(1.0 / ratio, 1.0, n), 0.3 * (1.0 - inner))
    distance = np.sqrt(rng.uniform(inner**2, 1.0, n)) * rng.uniform(0.8, 1.0)
    angle = rng.uniform(0.0, rng.choice([2.0, 1.0, 0.05]) * np.pi, n)
    position = np.maximum(distance, 1.001 * inner)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    method = str(rng.choice(METHODS[: 2 + (n < 60)]))
    rough = method != "exact" and rng.random() < 0.4
    return Scene(
        position=position,
        velocity=rng.normal(0.0, rng.choice([0.0, 1.0, 20.0]), (n, 2)),
        radius=radius if ratio > 1.0 else float(radius.max()),
        mass=10.0 ** rng.uniform(-3.0, 3.0, n) if rng.random() < 0.3 else 1.0,
        radius_in=inner,
        radius_out=1.0,
        gravity=(0.0, float(rng.choice([0.0, -9.81, -1e4]))),
        dt=float(rng.choice([1e-4, 1e-3, 1e-2])),
        tolerance=float(rng.choice([1e-8, 1e-4, 1e-2])),
        max_iterations=int(rng.choice([1, 10, 50, 200, 1000], p=[0.3, 0.3, 0.25, 0.13, 0.02])),
        order=str(rng.choice(ORDERS)),
        method=method,
        scheme=str(rng.choice(["text", "leapfrog"])),
        wall=str(rng.choice(["tangent", "round"])),
        friction=float(rng.choice([0.05, 0.5, 2.0])) if rough else 0.0,
        angular_velocity_out=float(rng.normal(0.0, 10.0)) if rough else 0.0,
        spin=rng.normal(0.0, 10.0, n) if rough else None,
        walls=random_walls(rng, float(radius.min())) if rng.random() < 0.3 else (),
        stop="residual" if method == "exact" else str(rng.choice(["zeta", "residual"])),
    )


def random_walls(rng: np.random.Generator, smallest: float) -> list[Segment]:
    """Draw segments that move by less than the smallest radius in the longest step."""
    fastest = 0.3 * smallest / 1e-2
    return [
        Segment(
            tuple(rng.uniform(-1.0, 1.0, 2)),
            tuple(rng.uniform(-1.0, 1.0, 2)),
            velocity=tuple(rng.uniform(-fastest, fastest, 2)),
            angular_velocity=float(rng.choice([0.0, 0.1 * fastest])),
        )
        for _ in range(rng.integers(1, 4))
    ]


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
