"""Hard steps with friction: those with several solutions, and those that do not converge."""

from dataclasses import replace
from time import process_time
from typing import Any

import numpy as np
from sections import Numbers, Section, panels

import warpgrains as wg
from warpgrains.base.arrays import FloatArray
from warpgrains.scene.layouts import random_layout
from warpgrains.scene.state import Corrections, State
from warpgrains.walls.annulus import Annulus

FRICTIONS = (0.1, 0.3, 0.5, 0.8, 1.2)
RUNS, STEPS, STARTS = 4, 12, 5  # of each friction; of a run that are solved again; of each of these
TOLERANCE = 1e-9  # m/s

SCENES = {"heap": 400, "rotating_drum": 800, "couette": 2000}  # and the number of their steps
SWEEPS = 500  # that a step may take before it counts as short
SHARE = 0.02  # of the speed that gravity gives in a step: the bound of its residual
BUDGETS = (50, 100, 200, 500, 1000, 2000, 5000, 10_000)  # sweeps after which the residual is drawn
KEPT = 8  # short steps that are solved again
TOLERANCES = 10.0 ** -np.arange(3.0, 10.0)  # m/s, of the exact method


def falling(friction: float, seed: int) -> wg.Scene:
    """Return 40 discs at random places that fall in a circle."""
    position, radius = random_layout(Annulus(0.0, 1.0).space, radius=[0.05, 0.08], count=40, seed=seed)
    body = {"position": position, "radius": radius, "mass": 10.0 * np.pi * radius**2, "radius_out": 1.0}
    return wg.Scene(**body, friction=friction, dt=0.005, tolerance=1e-6, max_iterations=2000)


def other_start(kept: Corrections, friction: float, rng: np.random.Generator) -> Corrections:
    """Return random corrections of the contacts of `kept`, within Coulomb's bound.

    Normal corrections are uniform between 0 and the largest one of a pair in `kept`.
    """
    scale = kept.pair_correction.max(initial=0.0)
    changed: dict[str, Any] = {}
    for name in ("pair", "wall"):
        normal = rng.uniform(0.0, scale, len(getattr(kept, name)))
        changed[f"{name}_correction"] = normal
        changed[f"{name}_friction"] = friction * normal * rng.uniform(-1.0, 1.0, len(normal))
    return replace(kept, **changed)


def solved(scene: wg.Scene, state: State, rng: np.random.Generator) -> FloatArray | None:
    """Solve a step several times, each time from other random corrections.

    Returns the velocities and rim speeds of each solution [m/s], shape (starts, 3 n), or None if one of them
    does not converge.
    """
    exactly, found = scene.replace(tolerance=TOLERANCE, max_iterations=20_000, stop="residual"), []
    for _ in range(STARTS):
        simulation = wg.Simulation(exactly)
        corrections = other_start(state.corrections, scene.friction, rng)
        simulation.restore(replace(state, corrections=corrections, lists=None))
        if simulation.step().residual > TOLERANCE:
            return None
        found.append(np.append(simulation.velocity, simulation.spin * scene.radius))
    return np.array(found)


def spreads(friction: float) -> FloatArray:
    """Return the largest velocity difference between solutions of a step, for many steps [m/s], shape (k,).

    Only steps that converge from all random corrections (`solved`) count.
    """
    rng, found = np.random.default_rng(0), []
    for seed in range(RUNS):
        scene = falling(friction, seed)
        simulation = wg.Simulation(scene)
        for _ in range(STEPS):
            simulation.advance(10)
            solutions = solved(scene, simulation.state(), rng)
            if solutions is not None:
                found.append(float(np.ptp(solutions, axis=0).max()))
    return np.array(found)


def solutions() -> Section:
    """Draw the spread of the solutions of each step over friction.

    Return the figure, the numbers of steps with several solutions, and the largest spreads.
    """
    (figure, axes), numbers = panels(), {}
    for friction in FRICTIONS:
        found = spreads(friction)
        axes.semilogy(np.full(len(found), friction), np.maximum(found, 1e-12), "o", color="C0", alpha=0.4)
        numbers[f"mu {friction:g}: steps solved from {STARTS} starts"] = len(found)
        numbers[f"mu {friction:g}: steps with several solutions"] = np.count_nonzero(found > 1e-5)
        numbers[f"mu {friction:g}: largest spread [m/s]"] = float(found.max())
    axes.set(xlabel="friction", ylabel="spread of the velocities [m/s]")
    return figure, numbers


def limited(name: str) -> wg.Scene:
    """Return a shipped scene whose steps end after `SWEEPS` sweeps at most.

    Its tolerance is `SHARE` of the speed that gravity gives a grain in a step. Without gravity, the tolerance
    is not changed.
    """
    scene = wg.Scene.load(name)
    tolerance = SHARE * float(np.hypot(*scene.gravity)) * scene.dt or scene.tolerance
    return scene.replace(method="accelerated", stop="residual", tolerance=tolerance, max_iterations=SWEEPS)


def short_steps(scene: wg.Scene, steps: int) -> tuple[int, list[State]]:
    """Simulate a number of steps, and find those that do not converge.

    Returns the number of steps that do not converge, and the states before up to `KEPT` of these.
    """
    simulation, before = wg.Simulation(scene), []
    for _ in range(steps):
        state = simulation.state()
        if not simulation.step().converged:
            before.append(state)
    kept = np.unique(np.linspace(0, len(before) - 1, KEPT).astype(int)) if before else []
    return len(before), [before[k] for k in kept]


def residuals(scene: wg.Scene, state: State, method: str) -> FloatArray:
    """Return the residual [m/s] of the step from `state` after each of `BUDGETS` sweeps of `Scene.method`."""
    found = []
    for sweeps in BUDGETS:
        simulation = wg.Simulation(scene.replace(method=method, tolerance=0.0, max_iterations=sweeps))
        simulation.restore(state)
        found.append(simulation.step().residual)
    return np.array(found)


def hard_steps() -> Section:
    """Draw the residual over the number of sweeps, for steps that do not converge within `SWEEPS`.

    Return the figure, the number of such steps in each scene, and the medians of the residuals.
    """
    numbers: Numbers = {}
    hard = []
    for name, steps in SCENES.items():
        scene = limited(name)
        numbers[f"{name}: short steps, of {steps}"], states = short_steps(scene, steps)
        hard += [(scene, state) for state in states]
    figure, both = panels(1, 2, sharey=True)
    for axes, method in zip(both, ("gauss-seidel", "accelerated"), strict=True):
        curves = np.array([residuals(scene, state, method) for scene, state in hard])
        median = np.median(curves, axis=0)
        axes.loglog(BUDGETS, curves.T, "-", color="C0", alpha=0.4)
        axes.loglog(BUDGETS, median, "ko-")
        axes.set(xlabel="iterations", title=method)
        for sweeps, value in zip(BUDGETS, median, strict=True):
            numbers[f"{method}, {sweeps} iterations: median residual [m/s]"] = float(value)
    both[0].set_ylabel("residual [m/s]")
    return figure, numbers


def timed(scene: wg.Scene, state: State, **changes: Any) -> tuple[float, float]:
    """Solve the step from a state three times, with the fields `changes`.

    Returns the shortest CPU time [ms] and the residual [m/s].
    """
    simulation, residual, taken = wg.Simulation(scene.replace(**changes), threads=1), np.nan, []
    for _ in range(3):
        simulation.restore(state)
        begun = process_time()
        residual = simulation.step().residual
        taken.append(1e3 * (process_time() - begun))
    return min(taken), residual


def exact_step() -> Section:
    """Draw the residual over the CPU time of each method, for a step of the drum that converges slowly.

    Return the figure and the residuals.
    """
    scene, (figure, axes), numbers = limited("rotating_drum"), panels(), {}
    state = short_steps(scene, SCENES["rotating_drum"])[1][KEPT // 2]
    ways: dict[str, list[dict[str, Any]]] = {
        method: [{"tolerance": 0.0, "max_iterations": sweeps} for sweeps in BUDGETS]
        for method in ("gauss-seidel", "accelerated")
    }
    ways["exact"] = [{"tolerance": tolerance, "exact_budget": 1e3} for tolerance in TOLERANCES]
    for method, changes in ways.items():
        found = [timed(scene, state, method=method, **one) for one in changes]
        axes.loglog(*np.transpose(found), "o-", label=method)
        for taken, residual in found:
            numbers[f"{method}, {taken:.3g} ms: residual [m/s]"] = residual
    axes.set(xlabel="processor time of the step [ms]", ylabel="residual [m/s]")
    axes.legend()
    return figure, numbers
