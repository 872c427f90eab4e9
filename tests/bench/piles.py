"""Piles at the bottom of a disc, the same on every machine; a settled one is kept for the next run.

Every pile is the same one on another scale: grains of one size fill two fifths of the disc from below, on a
hexagonal lattice a little too wide, each a little off its place, and sink in a liquid that is thick against
dt. All lengths of a step are in radii, all times in sqrt(radius / gravity).
"""

from dataclasses import dataclass
from functools import partial
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np

from warpgrains import Scene, Simulation, State
from warpgrains.arrays import FloatArray

from .flow import continued, kept_state
from .rows import say

ITERATIONS = 50  # of a step that is measured
GRAVITY = 9.81  # m/s2
FILLING = 0.4  # of the disc
STEP = 0.03  # dt in sqrt(radius / gravity)
THICKNESS = 0.9  # part of a velocity that drag takes in a step
RESTING = 2e-4  # rms way in a step, in radii, below which a pile is said to rest


@dataclass(frozen=True)
class Pile:
    """A pile, and the state that it has settled to."""

    scene: Scene
    state: State

    @property
    def kind(self) -> str:
        """Whether it rests, or plain Gauss-Seidel did not bring it to rest."""
        way = sqrt(np.mean(self.state.velocity**2) * 2.0) * self.scene.dt / self.scene.radius[0]
        return "resting pile" if way < RESTING else "slowly creeping pile"

    def simulation(self, threads: int | None = 1, **changes: Any) -> Simulation:
        """Continue from the settled state, with lists that are past their first steps."""
        return continued(self.scene, self.state, threads, **changes)


def advance(simulation: Simulation, steps: int) -> int:
    """Advance by so many steps; return how often contacts were swept."""
    return sum(simulation.step().iterations for _ in range(steps))


def settled_pile(n: int, cache: Path) -> Pile:
    scene, file = pile(n), cache / f"pile-{n}-{_steps_to_settle(n)}-{STEP}-{THICKNESS}.npz"
    return Pile(scene, kept_state(file, partial(_settle, scene)))


def pile(n: int) -> Scene:
    """Return the pile before it settles; its steps are of so many iterations, converged or not."""
    radius = sqrt(FILLING / n)
    mass, dt = radius**2, STEP * sqrt(radius / GRAVITY)
    return Scene(
        position=_filled_disc(n, radius),
        radius=radius,
        mass=mass,
        radius_out=1.0,
        gravity=(0.0, -GRAVITY),
        drag=THICKNESS * mass / dt,
        dt=dt,
        tolerance=0.0,
        max_iterations=ITERATIONS,
        name=f"pile of {n}",
    )


def _filled_disc(n: int, radius: float) -> FloatArray:
    """Rows from the bottom up; the pile will sink by about a quarter of a radius, however high it is."""
    gap = 0.4 / sqrt(n)
    pitch = (2.0 + gap) * radius
    row = np.arange(int(2.0 / pitch * 2.0 / sqrt(3.0)))[:, np.newaxis]
    column = np.arange(-int(1.0 / pitch) - 1, int(1.0 / pitch) + 2)
    x = (column + 0.5 * (row % 2)) * pitch
    y = np.broadcast_to(row * pitch * sqrt(3.0) / 2.0 - 1.0, x.shape)
    position = np.column_stack([x.ravel(), y.ravel()])
    position = position[np.hypot(*position.T) < 1.0 - 1.01 * radius][:n]
    return position + np.random.default_rng(1).uniform(-gap / 4.0, gap / 4.0, (n, 2)) * radius


def _settle(scene: Scene) -> Simulation:
    steps = _steps_to_settle(scene.n)
    say(f"settling a pile of {scene.n:,}: {steps:,} steps")
    simulation = Simulation(scene)
    advance(simulation, steps)
    return simulation


def _steps_to_settle(n: int) -> int:
    """How many steps a pile is given: fewer than it needs where they would take hours."""
    for most, steps in ((1_000, 4_800), (10_000, 2_400), (100_000, 1_200)):
        if n <= most:
            return steps
    return 200
