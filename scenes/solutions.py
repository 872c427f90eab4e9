"""Steps with friction that have several solutions: the same step, solved from different corrections."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import warpgrains as wg
from warpgrains.arrays import FloatArray
from warpgrains.scene.layouts import random
from warpgrains.scene.state import Corrections, State
from warpgrains.scene.walls import Annulus
from warpgrains.scenes.exhibits import Numbers
from warpgrains.scenes.style import panels

FRICTIONS = (0.1, 0.3, 0.5, 0.8, 1.2)
RUNS, STEPS, STARTS = 4, 12, 5
"""Runs of each friction, steps of a run that are solved again, and starts of each of them."""
TOLERANCE = 1e-9
"""[m/s]."""


def falling(friction: float, seed: int) -> wg.Scene:
    """Return 40 discs that fall in a circle."""
    position, radius = random(Annulus(0.0, 1.0), radius=[0.05, 0.08], count=40, seed=seed)
    return wg.Scene(
        position=position,
        radius=radius,
        mass=10.0 * np.pi * radius**2,
        radius_out=1.0,
        friction=friction,
        dt=0.005,
        tolerance=1e-6,
        max_iterations=2000,
    )


def other_start(kept: Corrections, friction: float, rng: np.random.Generator) -> Corrections:
    """Return random corrections of the same contacts, within Coulomb's bound."""
    scale = kept.pair_correction.max(initial=0.0)
    changed: dict[str, Any] = {}
    for name in ("pair", "wall"):
        normal = rng.uniform(0.0, scale, len(getattr(kept, name)))
        changed[f"{name}_correction"] = normal
        changed[f"{name}_friction"] = friction * normal * rng.uniform(-1.0, 1.0, len(normal))
    return replace(kept, **changed)


def solutions(scene: wg.Scene, state: State, rng: np.random.Generator) -> FloatArray | None:
    """Return velocities and rim speeds after a step from `STARTS` starts; None if one does not converge."""
    exactly, found = scene.replace(tolerance=TOLERANCE, max_iterations=20_000, stop="residual"), []
    for _ in range(STARTS):
        simulation = wg.Simulation(exactly)
        corrections = other_start(state.corrections, scene.friction, rng)
        simulation.restore(replace(state, corrections=corrections, lists=None))
        if simulation.step().residual > TOLERANCE:
            return None
        found.append(np.append(simulation.velocity, simulation.spin * scene.radius))
    return np.array(found)


def spread(friction: float) -> tuple[int, FloatArray]:
    """Return the number of steps that converge from all starts, and the spread of each [m/s]."""
    rng, spreads = np.random.default_rng(0), []
    for seed in range(RUNS):
        scene = falling(friction, seed)
        simulation = wg.Simulation(scene)
        for _ in range(STEPS):
            simulation.advance(10)
            found = solutions(scene, simulation.state(), rng)
            if found is not None:
                spreads.append(float(np.ptp(found, axis=0).max()))
    return len(spreads), np.array(spreads)


def draw(path: Path) -> Numbers:
    """Draw the spread of the solutions of each step, and count the steps that have several."""
    (figure, axes), numbers = panels(), {}
    for friction in FRICTIONS:
        count, spreads = spread(friction)
        axes.semilogy(np.full(count, friction), np.maximum(spreads, 1e-12), "o", color="C0", alpha=0.4)
        numbers[f"mu {friction:g}: steps solved from {STARTS} starts"] = float(count)
        numbers[f"mu {friction:g}: steps with several solutions"] = float(np.count_nonzero(spreads > 1e-5))
        numbers[f"mu {friction:g}: largest spread [m/s]"] = float(spreads.max())
    axes.set(xlabel="friction", ylabel="spread of the velocities [m/s]")
    figure.savefig(path)
    return numbers
