"""Scenes of the benches: the common flow, which all programs simulate, and piles.

In the flow, equal discs fill 40 % of an annulus. They are released at rest from the lowest points of a square
lattice, each displaced a little, and fall with a small drag. The fastest of 1,000 grains reach 1.7 m/s, which
is 0.4 radii per step of 0.01 s, so that every second step needs a new list.

All piles are the same pile on other scales. Equal discs fill 40 % of a disc from below, on a slightly widened
hexagonal lattice, each displaced a little, and sink with a large drag. Lengths scale with the radius, times
with sqrt(radius / gravity).
"""

from math import inf, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from warpgrains import Scene, Simulation, State
from warpgrains.base.arrays import FloatArray

from .rows import say

GRAVITY = 9.81  # m/s2
FILLING = 0.4  # packing fraction of the annulus or disc
RADIUS_IN, RADIUS_OUT = 0.5, 2.0  # m
PITCH = 2.05  # of the square lattice [radii]
SHAKE = 0.01  # displacement of each grain from its lattice point [radii]
GOLDEN = 0.6180339887498949
DURATION = 2.0  # s
SPLASHING = 0.6  # time of the flow at which all grains splash [s]
SOLVED = {"method": "accelerated", "order": "color", "stop": "residual", "tolerance": 1e-2}
"""Solver settings of the flow where single steps are measured."""
ACCELERATED = {"method": "accelerated", "order": "color", "tolerance": 1e-3}
"""Solver settings of the flow in other benches."""

ITERATIONS = 50  # of a measured step
STEP = 0.03  # dt of piles [sqrt(radius / gravity)]
THICKNESS = 0.9  # part of a velocity that drag removes per step
RESTING = 2e-4  # rms displacement per step [radii] below which a pile rests
SETTLING = {1_000: 4_800, 10_000: 2_400, 100_000: 1_200, inf: 200}
"""Steps in which a pile settles, by the largest number of grains for which they hold.

For large piles, these are fewer than needed to come to rest.
"""
SWEPT = {"method": "gauss-seidel", "stop": "zeta", "tolerance": 0.0, "max_iterations": ITERATIONS}
"""Solver settings for exactly ITERATIONS plain sweeps per step."""


def flowing(n: int, **changes: Any) -> Scene:
    """Return the common flow with n grains. `changes` replace its fields."""
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
    """Return the flow and its state at the time SPLASHING, from a checkpoint in `cache`, made if missing.

    dt is 0.01 s for 1,000 grains, and proportional to the radius of the grains.
    """
    dt = 0.01 * sqrt(1_000 / n)
    scene = flowing(n, **SOLVED, dt=dt)
    return scene, kept_state(cache / f"flow-{n}-{SPLASHING}.npz", scene, round(SPLASHING / dt))


def _shaken_lattice(n: int, radius: float) -> FloatArray:
    """Return the n lowest lattice points at which grains touch no wall, each displaced a little [m].

    They are sorted by height, then x; shape (n, 2).
    """
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
    """Return a name, the pile of n grains, and its state after settling.

    The name says whether the pile rests. The state is from a checkpoint in `cache`, made if missing.
    """
    scene, steps = pile(n), next(steps for most, steps in SETTLING.items() if n <= most)
    state = kept_state(cache / f"pile-{n}-{steps}-{STEP}-{THICKNESS}.npz", scene, steps)
    way = sqrt(np.mean(state.velocity**2) * 2.0) * scene.dt / scene.radius[0]
    return "resting pile" if way < RESTING else "slowly creeping pile", scene, state


def pile(n: int) -> Scene:
    """Return the pile of n grains before it settles, with exactly ITERATIONS iterations per step."""
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
    """Return n lattice points in rows from the bottom of the disc up, each displaced a little [m], (n, 2).

    From there, the pile sinks by about a quarter of a radius.
    """
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
    """Return the state of a scene after a number of steps, as the checkpoint `file` holds it.

    If the file is missing, the steps are simulated and the checkpoint is written.
    """
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        say(f"{scene.name}: {steps:,} steps")
        simulation = Simulation(scene)
        simulation.advance(steps)
        simulation.save(file)
    return Simulation.load(file, threads=1).state()


def continued(scene: Scene, state: State, threads: int | None = 1, **changes: Any) -> Simulation:
    """Return a simulation that has done 3 steps from a state, so that its first lists are made."""
    simulation = Simulation(scene, threads=threads, **changes)
    simulation.restore(state)
    simulation.advance(3)
    return simulation
