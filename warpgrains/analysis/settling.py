"""Steps that lead grains to rest under gravity.

A step that begins at rest moves grains to the minimum of their potential energy, up to a term in their
displacements, among the places that the frozen normals allow (MODEL.md, eq. 10). Many such steps with a large
time step end in a packing. At first sweeps solve them loosely, and ever better as forces balance, and some
velocity is kept. When grains hardly change their places, the method "exact" balances the forces.
"""

from __future__ import annotations

from dataclasses import replace
from math import hypot, log, sqrt
from typing import Any

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.console import Progress
from warpgrains.errors import SimulationError
from warpgrains.scene.geometry import distance
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import Corrections, State, first_state
from warpgrains.simulation.simulation import Simulation

FIRST, LONGEST = 0.5, 2.0  # first and longest dt while sweeps solve the steps, in sqrt(d / g)
KEPT = 0.4  # share of the velocity with which the next of these steps begins: grains fall and slide further
LOOSE, TIGHT = 1e-2, 1e-4  # first and last tolerance of these steps, in g dt
SHARE = 0.2  # of the unbalanced acceleration: a tolerance that suffices
ITERATIONS = 3000  # of such a step, at most
SETTLED, HELD = 1e-3, 3  # unbalanced acceleration [g], and steps in a row below it, at which they end
EXACT = 1e-7  # tolerance of the steps that balance forces, in g dt
SLIDING = 0.7  # their longest dt, in sqrt(R / g), the time in which a packing slides in the outer wall
BALANCED = 1e-6  # unbalanced acceleration [g] at their end
LAST_STEPS = 10  # at most, with the time step of the scene
FAR, NEAR = 0.3, 0.1  # displacements [d] above which the next dt is shorter, and below which it is longer


class Settling:
    """Grains that settle.

    Parameters
    ----------
    scene : Scene
        Grains without friction, with gravity, and walls at rest.
    most_steps : int
    threads : int, optional
        See `Simulation`.
    bar : Progress
        Bar of a hundred units.

    Attributes
    ----------
    diameter, gravity : float
        Mean diameter d [m], and g [m/s2].
    steps, iterations : int
        Steps done, and their iterations.
    """

    def __init__(self, scene: Scene, most_steps: int, threads: int | None, bar: Progress):
        self.gravity, self.diameter = hypot(*scene.gravity), 2.0 * float(scene.radius.mean())
        self.steps = self.iterations = self._percent = 0
        self._scene, self._most_steps, self._bar = scene, most_steps, bar
        self._tolerance, dt = LOOSE, FIRST * self._time
        damped = scene.replace(
            velocity=np.zeros((scene.n, 2)),
            drag=0.0,
            scheme="text",
            wall="tangent",
            method="accelerated",
            stop="residual",
            max_iterations=ITERATIONS,
            on_unconverged="report",
            dt=dt,
            tolerance=LOOSE * self.gravity * dt,
        )
        self._simulation = Simulation(damped, threads=threads)

    @property
    def _time(self) -> float:
        return sqrt(self.diameter / self.gravity)

    def settle(self) -> None:
        """Let grains settle until they hardly change their places."""
        held, dt = 0, FIRST * self._time
        while held < HELD:
            unbalanced, furthest = self._step(KEPT)
            held = held + 1 if unbalanced < SETTLED else 0
            wanted = min(self._tolerance, max(TIGHT, SHARE * unbalanced))
            dt = _next_dt(dt, furthest, FIRST * self._time, LONGEST * self._time)
            self._change(dt, wanted if wanted < 0.7 * self._tolerance else self._tolerance)

    def balance(self) -> None:
        """Let the forces of settled grains balance, at last with the time step of the scene."""
        self._simulation.change(method="exact")
        first, longest = (FIRST * self._time, SLIDING * sqrt(self._scene.radius_out / self.gravity))
        dt, unbalanced, last = self._simulation.scene.dt, np.inf, np.inf
        while unbalanced > BALANCED:
            self._change(dt, EXACT)
            unbalanced, furthest = self._step()
            # a packing that slides to and fro, further every time, needs a shorter dt
            dt, last = _next_dt(dt, FAR if furthest > 2.0 * last else furthest, first, longest), furthest
        self._change(self._scene.dt, EXACT)
        for _ in range(LAST_STEPS):
            if self._step()[0] <= BALANCED:
                break

    def state(self) -> State:
        """Return the state of the grains at rest, at time 0, for the settings of the scene."""
        now, scene = self._simulation.state(), self._scene
        i, j = now.corrections.pair.T
        # contacts act on masses that drag increases (MODEL.md, eq. 17b): the same force, another correction
        light, heavy = 1.0 / scene.mass, 1.0 / scene.contact_mass
        pairs = (heavy[i] + heavy[j]) / (light[i] + light[j])
        grain = now.corrections.wall[:, 0]
        return replace(
            first_state(scene),
            position=now.position,
            velocity=np.zeros((scene.n, 2)),
            corrections=_scaled(now.corrections, pairs, heavy[grain] / light[grain]),
            staggered=scene.scheme == "leapfrog",
        )

    def _step(self, kept: float = 0.0) -> tuple[float, float]:
        """Do a step that begins with a share of the velocity, or at rest.

        Returns
        -------
        Root of the mean square of the unbalanced acceleration [g], and largest displacement [d].
        """
        if self.steps == self._most_steps:
            raise SimulationError(
                f"the grains are not at rest after {self.steps} steps: give more steps, or place them more"
                " densely"
            )
        simulation, state = self._simulation, self._simulation.state()
        before = kept * state.velocity
        simulation.restore(replace(state, velocity=before))
        report = simulation.step()
        self.steps, self.iterations = self.steps + 1, self.iterations + report.iterations
        velocity, dt = simulation.velocity, simulation.scene.dt
        unbalanced = float(np.sqrt(2.0 * ((velocity - before) ** 2).mean())) / (self.gravity * dt)
        unbalanced = float(f"{unbalanced:.2e}")  # the same bits in any order of summation
        self._show(unbalanced)
        return unbalanced, dt * float(distance(velocity).max()) / self.diameter

    def _show(self, unbalanced: float) -> None:
        """Show the powers of ten by which the forces balance better than at first."""
        percent = 100.0 * log(max(unbalanced, BALANCED)) / log(BALANCED)
        more = max(0, int(percent) - self._percent)
        self._percent += more
        self._bar.set_postfix_str(f"step {self.steps}, forces balance to {unbalanced:.1e} weights")
        self._bar.update(more)

    def _change(self, dt: float, tolerance: float) -> None:
        """Change time step [s] and tolerance [g dt]. Forces stay as they are."""
        simulation = self._simulation
        if (dt, tolerance) == (simulation.scene.dt, self._tolerance):
            return
        self._tolerance = tolerance
        longer, state = dt / simulation.scene.dt, simulation.state()
        simulation.change(dt=dt, tolerance=tolerance * self.gravity * dt)
        corrections = _scaled(state.corrections, longer, longer)
        simulation.restore(replace(state, corrections=corrections, velocity=longer * state.velocity))


def _next_dt(dt: float, furthest: float, least: float, most: float) -> float:
    """Return the next time step [s] after one with a largest displacement [d]."""
    if furthest >= FAR:
        return max(0.7 * dt, least)
    return max(dt, min(1.3 * dt, most)) if furthest < NEAR else dt


def _scaled(corrections: Corrections, pairs: float | FloatArray, walls: float | FloatArray) -> Corrections:
    """Return corrections times factors of the pairs and of the wall contacts."""
    scaled: dict[str, Any] = {
        "pair_correction": pairs * corrections.pair_correction,
        "wall_correction": walls * corrections.wall_correction,
    }
    return replace(corrections, **scaled)
