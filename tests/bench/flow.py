"""Scenes that are measured: the common flow, which every program gets, and piles.

In the flow, equal discs fill 40 % of an annulus. They are released at rest from a square lattice, lowest rows
first, each a little off its place, and fall in a thin liquid. The fastest of 1,000 reach 1.7 m/s, 0.4 radii a
step of 0.01 s, so that every second step needs another list.

Every pile is the same one on another scale: equal discs fill 40 % of a disc from below, on a hexagonal
lattice a little too wide, each a little off its place, and sink in a liquid that is thick against dt. All
lengths of a step are in radii, all times in sqrt(radius / gravity).
"""

from math import inf, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from warpgrains import Scene, Simulation, State
from warpgrains.base.arrays import FloatArray

from .rows import say

GRAVITY = 9.81  # m/s2
FILLING = 0.4  # of the annulus or disc
RADIUS_IN, RADIUS_OUT = 0.5, 2.0  # m
PITCH = 2.05  # of the lattice, in radii
SHAKE = 0.01  # how far a grain is off its place, in radii
GOLDEN = 0.6180339887498949
DURATION = 2.0  # s
SPLASHING = 0.6  # s, when all splash
SOLVED = {"method": "accelerated", "order": "color", "stop": "residual", "tolerance": 1e-2}
"""How it is solved where steps are measured."""
ACCELERATED = {"method": "accelerated", "order": "color", "tolerance": 1e-3}
"""How it is solved where nothing else is said."""

ITERATIONS = 50  # of a step that is measured
STEP = 0.03  # dt in sqrt(radius / gravity)
THICKNESS = 0.9  # part of a velocity that drag takes in a step
RESTING = 2e-4  # rms way in a step, in radii, below which a pile is said to rest
SETTLING = {1_000: 4_800, 10_000: 2_400, 100_000: 1_200, inf: 200}
"""Steps that piles of so many grains are given: fewer than they need where they would take hours."""
SWEPT = {"method": "gauss-seidel", "stop": "zeta", "tolerance": 0.0, "max_iterations": ITERATIONS}
"""How a step has that many plain sweeps."""


def flowing(n: int, **changes: Any) -> Scene:
    """Return the scene of so many grains, with some of its fields changed."""
    radius = sqrt(FILLING * (RADIUS_OUT**2 - RADIUS_IN**2) / n)
    fields = {
        "position": _shaken_lattice(n, radius),
        "radius": radius,
        "mass": 0.1,
        "radius_in": RADIUS_IN,
        "radius_out": RADIUS_OUT,
        "gravity": (0.0, -GRAVITY),
        "drag": 0.5,
        "dt": 0.01,
        "duration": DURATION,
        "name": f"flow of {n}",
    }
    return Scene(**{**fields, **changes})


def splashing(n: int, cache: Path) -> tuple[Scene, State]:
    """Return the scene, in steps as long to its grains as 0.01 s to 1,000, and its state amid the flow."""
    dt = 0.01 * sqrt(1_000 / n)
    scene = flowing(n, **SOLVED, dt=dt)
    return scene, kept_state(cache / f"flow-{n}-{SPLASHING}.npz", scene, round(SPLASHING / dt))


def _shaken_lattice(n: int, radius: float) -> FloatArray:
    """The n lowest places clear of the walls, by height and from the left, each grain a little off it."""
    pitch = PITCH * radius
    k = np.arange(-int(RADIUS_OUT / pitch) - 1, int(RADIUS_OUT / pitch) + 2)
    place = np.stack([np.tile(k, len(k)), np.repeat(k, len(k))], axis=1) * pitch
    distance = np.hypot(*place.T)
    clear = (distance > RADIUS_IN + 1.02 * radius) & (distance < RADIUS_OUT - 1.02 * radius)
    place = place[clear][:n]
    i = np.arange(n)
    shake = np.stack([np.sin(2.0 * pi * GOLDEN * i), np.cos(2.0 * pi * GOLDEN**2 * i)], axis=1)
    return place + SHAKE * radius * shake


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


def kept_state(file: Path, scene: Scene, steps: int) -> State:
    """Return the state after so many steps, from a checkpoint; where there is none, save it."""
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        say(f"{scene.name}: {steps:,} steps")
        simulation = Simulation(scene)
        simulation.advance(steps)
        simulation.save(file)
    return Simulation.load(file, threads=1).state()


def continued(scene: Scene, state: State, threads: int | None = 1, **changes: Any) -> Simulation:
    """Continue from a state, with lists that are past their first steps."""
    simulation = Simulation(scene, threads=threads, **changes)
    simulation.restore(state)
    simulation.advance(3)
    return simulation
