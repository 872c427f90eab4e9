"""Steps that lead grains to rest under gravity.

At first, grains fall and slide with a large time step. Every few steps, all velocities are multiplied by the
same factor, so that light and heavy grains are damped alike. Momentum carries the grains through one
rearrangement after another, until the packing hardly sinks any further. The first such fall has a large
tolerance, the next one a small tolerance, because residuals shake the grains.

Then every step begins at rest, and the method "exact" solves it. Such a step minimizes the potential energy
of the grains, plus a term in their displacements, among the positions that the frozen normals allow
(MODEL.md, eq. 10). Near a packing at rest about twenty steps suffice, because a displacement x along a
contact opens a gap proportional to x^2 only. If they do not suffice, grains still rearrange, and fall again.
"""

from dataclasses import replace
from math import exp, fsum, hypot, sqrt
from typing import Any, NamedTuple

import numpy as np

from warpgrains.base.arrays import FloatArray
from warpgrains.base.console import Progress
from warpgrains.base.errors import SimulationError
from warpgrains.scene.energy import TOLERANCES
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import Corrections, State, first_state
from warpgrains.simulation.simulation import Simulation
from warpgrains.space.geometry import distance

ITERATIONS = 3000  # largest number of iterations of a step in which grains fall
DAMPING = 9.0  # time in which damping divides a speed by e, in sqrt(d / g)
DAMPED = 10  # number of steps after which velocities are damped; it divides the steps in WATCHED
WATCHED = 10.0  # time over which the sinking is measured, in sqrt(d / g)
# Steps that balance forces:
FIRST = 1.0  # first dt, in sqrt(d / g)
SLIDING = 0.7  # longest dt, in sqrt(R / g), the time in which a packing slides in a wall of radius R
EXACT = 1e-7  # tolerance, in g dt
BALANCED = 1e-6  # unbalanced acceleration [g] at which these steps end
TRIED = 20  # largest number of steps with adapted dt, and of those with falling dt
NEAR, FAR = 1e-3, 1e-2  # largest displacement [d]: dt is increased below NEAR, and decreased above FAR
LONGER = 1.5  # factor of this change of dt
SHORTER = 3.0  # factor by which dt falls in each of the last steps, down to that of the scene
ENERGY = 1e-9  # largest mean kinetic energy of a grain at rest, in m g d
TESTED = 10  # number of steps with the scene's settings, after each of which the grains must be at rest


class Fall(NamedTuple):
    """Parameters of steps in which grains fall and slide."""

    dt: float
    """Time step, in sqrt(d / g)."""
    tolerance: float
    """Tolerance, in g dt."""
    still: float
    """The fall ends when grains sink or rise in the time WATCHED by at most this mean distance [d]."""


FALLS = Fall(dt=0.2, tolerance=1e-2, still=1e-3), Fall(dt=0.5, tolerance=1e-4, still=1e-5)


class Settling:
    """Grains without friction that settle by gravity between walls at rest, in at most `most_steps` steps.

    Lengths are in mean diameters d, accelerations in g [m/s2], energies in m g d. At rest, the mean kinetic
    energy of a grain is at most `most_energy`: 1e-9, or that at a speed of 30 tolerances if it is larger.
    """

    def __init__(self, scene: Scene, most_steps: int, threads: int | None, bar: Progress):
        self.gravity, self.diameter = hypot(*scene.gravity), 2.0 * float(scene.radius.mean())
        at_tolerance = 0.5 * (TOLERANCES * scene.tolerance) ** 2 / (self.gravity * self.diameter)
        self.most_energy = max(ENERGY, at_tolerance)
        self.steps = self.iterations = 0
        self._scene, self._most_steps, self._bar = scene, most_steps, bar
        self._tolerance, dt = FALLS[0].tolerance, FALLS[0].dt * self._time
        start = scene.replace(
            velocity=np.zeros((scene.n, 2)),
            scheme="euler",
            wall="tangent",
            stop="residual",
            max_iterations=ITERATIONS,
            on_unconverged="report",
            dt=dt,
            tolerance=self._tolerance * self.gravity * dt,
            drag=0.0,
            method="accelerated",
        )
        self._simulation = Simulation(start, threads=threads)

    @property
    def _time(self) -> float:
        return sqrt(self.diameter / self.gravity)

    def settle(self) -> None:
        """Let grains fall (again, if they have fallen before) until they hardly sink and forces balance."""
        for fall in FALLS[-1:] if self.steps else FALLS:
            self._fall(fall)
        while not self._balance():
            self._fall(FALLS[-1])

    def _fall(self, fall: Fall) -> None:
        """Let grains fall and slide until they hardly sink any further."""
        self._change(fall.dt * self._time, fall.tolerance, "accelerated")
        sunk, steps = np.inf, round(WATCHED / fall.dt)
        slower = exp(-DAMPED * fall.dt / DAMPING)
        while abs(sunk) > fall.still * self.diameter:
            before = self._depth()
            self._take(steps)
            for _ in range(steps // DAMPED):
                self.iterations += self._simulation.advance(DAMPED).iterations
                self._slow(slower)
            sunk = self._depth() - before
            self._show(f"grains sank by {sunk / self.diameter:.1e} diameters", steps)

    def _balance(self) -> bool:
        """Do steps that balance the forces; return whether the grains would rest for `TESTED` steps."""
        first, longest = FIRST * self._time, SLIDING * sqrt(0.5 * self._scene.widest / self.gravity)
        dt = first
        for _ in range(TRIED):
            self._change(dt, EXACT, "exact")
            unbalanced, furthest = self._step()
            if unbalanced <= BALANCED:
                break
            if furthest < NEAR:
                dt = max(dt, min(LONGER * dt, longest))
            elif furthest > FAR:
                dt = max(dt / LONGER, first)
        slow = sqrt(2.0 * self.most_energy * self.gravity * self.diameter) / TESTED
        for _ in range(TRIED):
            dt = max(dt / SHORTER, self._scene.dt)
            self._change(dt, EXACT, "exact")
            unbalanced, _ = self._step()
            if dt == self._scene.dt and unbalanced * self.gravity * dt <= slow:
                return True
        return False

    def state(self) -> State:
        """Return the initial state of the scene, with the grains at rest where they are now."""
        now, scene = self._simulation.state(), self._scene
        i, j = now.corrections.pair.T
        # contact masses include the scene's drag (MODEL.md, eq. 17b), so equal forces need other corrections
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

    def _depth(self) -> float:
        """Return the coordinate of the center of mass along gravity [m], which grows as grains sink.

        Its bits do not depend on the order of the grains.
        """
        (x, y), (gx, gy), mass = self._simulation.position.T, self._scene.gravity, self._scene.mass
        return fsum(mass * (gx * x + gy * y)) / (self.gravity * fsum(mass))

    def _take(self, steps: int) -> None:
        """Count steps before they are done; raise SimulationError if they exceed `most_steps`."""
        if self.steps + steps > self._most_steps:
            raise SimulationError(
                f"the grains are not at rest after {self.steps} steps: give more than {self._most_steps}, or"
                " place them more densely"
            )
        self.steps += steps

    def _step(self) -> tuple[float, float]:
        """Do a step from rest; return (RMS unbalanced acceleration [g], largest displacement [d])."""
        self._take(1)
        self._slow(0.0)
        simulation = self._simulation
        self.iterations += simulation.step().iterations
        velocity, dt = simulation.velocity, simulation.scene.dt
        unbalanced = float(np.sqrt(2.0 * (velocity**2).mean())) / (self.gravity * dt)
        unbalanced = float(f"{unbalanced:.2e}")  # the same bits in any order of summation
        self._show(f"forces balance to {unbalanced:.1e} weights", 1)
        return unbalanced, dt * float(distance(velocity).max()) / self.diameter

    def _slow(self, factor: float) -> None:
        state = self._simulation.state()
        self._simulation.restore(replace(state, velocity=factor * state.velocity))

    def _show(self, what: str, steps: int) -> None:
        self._bar.set_postfix_str(what)
        self._bar.update(steps)

    def _change(self, dt: float, tolerance: float, method: str) -> None:
        """Change time step [s], tolerance [g dt] and method, and scale corrections so that forces stay."""
        simulation = self._simulation
        if (dt, tolerance, method) == (simulation.scene.dt, self._tolerance, simulation.scene.method):
            return
        self._tolerance = tolerance
        longer, state = dt / simulation.scene.dt, simulation.state()
        simulation.change(dt=dt, tolerance=tolerance * self.gravity * dt, method=method)
        corrections = _scaled(state.corrections, longer, longer)
        simulation.restore(replace(state, corrections=corrections, last_scene=None))


def _scaled(corrections: Corrections, pairs: float | FloatArray, walls: float | FloatArray) -> Corrections:
    """Return corrections, multiplied by the factors `pairs` and `walls` (numbers, or arrays by contact)."""
    scaled: dict[str, Any] = {
        "pair_correction": pairs * corrections.pair_correction,
        "wall_correction": walls * corrections.wall_correction,
    }
    return replace(corrections, **scaled)
