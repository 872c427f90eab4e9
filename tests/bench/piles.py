"""Piles at the bottom of a disc, the same on every machine.

Every pile is the same one on another scale: grains of one size fill two fifths of the disc from below, on a
hexagonal lattice a little too wide, each a little off its place, and sink in a liquid that is thick against
dt. All lengths of a step are in radii, all times in sqrt(radius / gravity).
"""

from math import inf, sqrt
from pathlib import Path

import numpy as np

from warpgrains import Scene, State
from warpgrains.arrays import FloatArray

from .flow import kept_state

ITERATIONS = 50  # of a step that is measured
GRAVITY = 9.81  # m/s2
FILLING = 0.4  # of the disc
STEP = 0.03  # dt in sqrt(radius / gravity)
THICKNESS = 0.9  # part of a velocity that drag takes in a step
RESTING = 2e-4  # rms way in a step, in radii, below which a pile is said to rest
SETTLING = {1_000: 4_800, 10_000: 2_400, 100_000: 1_200, inf: 200}
"""Steps that piles of so many grains are given: fewer than they need where they would take hours."""
SWEPT = {"method": "gauss-seidel", "stop": "zeta", "tolerance": 0.0, "max_iterations": ITERATIONS}
"""How a step has that many plain sweeps."""


def settled_pile(n: int, cache: Path) -> tuple[str, Scene, State]:
    """Return whether plain Gauss-Seidel brought a pile to rest, the pile, and the state it has settled to."""
    scene, steps = pile(n), next(steps for most, steps in SETTLING.items() if n <= most)
    state = kept_state(cache / f"pile-{n}-{steps}-{STEP}-{THICKNESS}.npz", scene, steps)
    way = sqrt(np.mean(state.velocity**2) * 2.0) * scene.dt / scene.radius[0]
    return "resting pile" if way < RESTING else "slowly creeping pile", scene, state


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
