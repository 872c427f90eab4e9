"""Iterations of a step with a round wall over those with tangents, to 1e-6 m/s: CSV.

    python -m tests.bench.walls -o tests/bench/results/walls.csv

The scene is `no_inner_wall`, a heap of equal grains on a lattice that slides up the wall and sloshes back,
with random speeds, and with radii that differ by up to a tenth. A few steps take most of the iterations, and
other ones in every run: so there are many starts. `tangent` and `round` are means over the steps of their own
runs. Every step of the runs with a round wall is solved with tangents too, from the same state: `same` is the
ratio of the means, `same_median` the median of all steps' ratios.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from warpgrains import Scene, Simulation
from warpgrains.arrays import FloatArray
from warpgrains.scene.scheme import SCHEMES
from warpgrains.warp_start import start_warp

from .rows import open_table
from .timing import say

COLUMNS = (
    "radii",
    "method",
    "scheme",
    "tangent",
    "round",
    "ratio",
    "ratio_min",
    "ratio_max",
    "same",
    "same_median",
)
METHODS = ("gauss-seidel", "accelerated")
WALLS = ("tangent", "round")
TOLERANCE, MOST = 1e-6, 100_000  # m/s, sweeps
STARTS, STEPS = 16, 300
SMALLEST = {"equal": 1.0, "0.9 to 1": 0.9}
"""The smallest radius, of the largest."""


def started(radii: str, seed: int) -> Scene:
    """Return the heap with some speed, and so much smaller grains."""
    scene, random = Scene.load("no_inner_wall"), np.random.default_rng(seed)
    velocity = scene.velocity * random.uniform(0.8, 1.2)
    radius = scene.radius * random.uniform(SMALLEST[radii], 1.0, scene.n)
    return scene.replace(velocity=velocity, radius=radius, tolerance=TOLERANCE, max_iterations=MOST)


def iterations(scene: Scene, steps: int) -> FloatArray:
    """Count those of steps with tangents, with a round wall, and with tangents from the latter's states.

    Shape (3, steps).
    """
    own, run, same = (Simulation(scene, threads=1, wall=wall) for wall in (*WALLS, "tangent"))
    counts = np.empty((3, steps))
    for step in range(steps):
        same.restore(run.state())
        counts[:, step] = [simulation.step().iterations for simulation in (own, run, same)]
    return counts


def row(radii: str, method: str, scheme: str, starts: int, steps: int) -> dict[str, Any]:
    """Count iterations from all starts."""
    scenes = (started(radii, seed).replace(method=method, scheme=scheme) for seed in range(starts))
    tangent, around, same = np.stack([iterations(scene, steps) for scene in scenes], axis=1)
    ratio = around.mean(axis=1) / tangent.mean(axis=1)
    values = (
        tangent.mean(),
        around.mean(),
        around.mean() / tangent.mean(),
        ratio.min(),
        ratio.max(),
        around.mean() / same.mean(),
        np.median(around / same),
    )
    return dict(zip(COLUMNS, (radii, method, scheme, *(f"{value:.4g}" for value in values)), strict=True))


def rows(starts: int, steps: int) -> Iterator[dict[str, Any]]:
    """Count iterations of both methods and schemes."""
    for radii in SMALLEST:
        for method in METHODS:
            for scheme in SCHEMES:
                say(f"  {radii}, {method}, {scheme}")
                yield row(radii, method, scheme, starts, steps)


def main(arguments: list[str] | None = None) -> None:
    """Count, and write the figures down one by one."""
    summary = "Count iterations of steps with a round wall, and with tangents."
    parser = argparse.ArgumentParser(prog="python -m tests.bench.walls", description=summary)
    parser.add_argument("-o", "--output", type=Path, help="CSV file (default: standard output)")
    parser.add_argument("--starts", type=int, default=STARTS, help=f"random starts (default: {STARTS})")
    parser.add_argument("--steps", type=int, default=STEPS, help=f"steps of each (default: {STEPS})")
    chosen = parser.parse_args(arguments)
    start_warp()
    with open_table(chosen.output, COLUMNS) as table:
        for counted in rows(chosen.starts, chosen.steps):
            table.add(counted)


if __name__ == "__main__":
    main()
