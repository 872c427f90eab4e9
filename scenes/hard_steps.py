"""Steps with friction that do not converge: how many there are, and what more sweeps achieve."""

from pathlib import Path

import numpy as np

import warpgrains as wg
from warpgrains.arrays import FloatArray
from warpgrains.scene.state import State
from warpgrains.scenes.exhibits import Numbers
from warpgrains.scenes.style import panels

SCENES = {"heap": 400, "rotating_drum": 800, "couette": 2000}
"""Scenes, and the number of their steps that are counted."""
SWEEPS = 500
"""Sweeps that a step may take before it counts as short."""
SHARE = 0.02
"""Its residual must be within this part of the speed that gravity gives in a step."""
BUDGETS = (50, 100, 200, 500, 1000, 2000, 5000, 10_000)
"""Sweeps after which the residual of a short step is drawn."""
KEPT = 8
"""Short steps that are solved again."""


def limited(name: str) -> wg.Scene:
    """Return a scene whose steps end within the share of gravity, or after `SWEEPS` sweeps.

    Without gravity they end within the tolerance of the scene.
    """
    scene = wg.Scene.load(name)
    tolerance = SHARE * float(np.hypot(*scene.gravity)) * scene.dt or scene.tolerance
    return scene.replace(method="accelerated", stop="residual", tolerance=tolerance, max_iterations=SWEEPS)


def short_steps(scene: wg.Scene, steps: int) -> tuple[int, list[State]]:
    """Return how many steps are short, and the states before some of them, evenly spread."""
    simulation, before = wg.Simulation(scene), []
    for _ in range(steps):
        state = simulation.state()
        if not simulation.step().converged:
            before.append(state)
    kept = np.unique(np.linspace(0, len(before) - 1, KEPT).astype(int)) if before else []
    return len(before), [before[k] for k in kept]


def residuals(scene: wg.Scene, state: State, method: str) -> FloatArray:
    """Return the residual of a step [m/s] after each budget of sweeps."""
    found = []
    for sweeps in BUDGETS:
        simulation = wg.Simulation(scene.replace(method=method, tolerance=0.0, max_iterations=sweeps))
        simulation.restore(state)
        found.append(simulation.step().residual)
    return np.array(found)


def draw(path: Path) -> Numbers:
    """Count the short steps of each scene, and draw the residual of some of them over their sweeps."""
    numbers: Numbers = {}
    hard = []
    for name, steps in SCENES.items():
        scene = limited(name)
        count, states = short_steps(scene, steps)
        numbers[f"{name}: short steps, of {steps}"] = float(count)
        hard += [(scene, state) for state in states]
    figure, both = panels(1, 2, sharey=True)
    for axes, method in zip(both, ("gauss-seidel", "accelerated"), strict=True):
        curves = np.array([residuals(scene, state, method) for scene, state in hard])
        axes.loglog(BUDGETS, curves.T, "-", color="C0", alpha=0.4)
        axes.loglog(BUDGETS, np.median(curves, axis=0), "ko-")
        axes.set(xlabel="sweeps", title=method)
        for sweeps, median in zip(BUDGETS, np.median(curves, axis=0), strict=True):
            numbers[f"{method}, {sweeps} sweeps: median residual [m/s]"] = float(median)
    figure.axes[0].set_ylabel("residual [m/s]")
    figure.savefig(path)
    return numbers
