"""The common flowing scene, the same for every program that is compared: grains that fall and splash.

Equal discs fill 40 % of an annulus. They are released at rest from a square lattice, lowest rows first, each
a little off its place, and fall in a thin liquid. The fastest of 1,000 reach 1.7 m/s, 0.4 radii a step of
0.01 s, so that every second step needs another list.
"""

from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from warpgrains import Scene, Simulation, State
from warpgrains.arrays import FloatArray

from .rows import say

FILLING = 0.4  # of the annulus
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


def flowing(n: int, **changes: Any) -> Scene:
    """Return the scene of so many grains, with some of its fields changed."""
    radius = sqrt(FILLING * (RADIUS_OUT**2 - RADIUS_IN**2) / n)
    fields = {
        "position": _shaken_lattice(n, radius),
        "radius": radius,
        "mass": 0.1,
        "radius_in": RADIUS_IN,
        "radius_out": RADIUS_OUT,
        "gravity": (0.0, -9.81),
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
