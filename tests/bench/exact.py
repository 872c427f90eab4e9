"""The exact method compared with accelerated sweeps in single steps, and in runs of shipped scenes.

Times are CPU times of one thread, so the machine may be busy. Piles are the shipped pile on other scales,
with radii 1:1.5, after 4 s with at most 300 sweeps per step; they take minutes and are cached. Several steps
in a row are measured, after three exact steps. Errors are max |v - v_exact|, divided by the same error of the
free velocities, where v_exact is the result of the exact method with tolerance 1e-14.
"""

import argparse
from collections.abc import Iterator
from itertools import product
from math import ceil
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from warpgrains import Scene, Simulation, State
from warpgrains.accuracy.exact_step import StepProblem
from warpgrains.base.arrays import FloatArray
from warpgrains.scene.toml import shipped_scenes

from .flow import continued, flowing, kept_state
from .rows import SPEEDUP, Row, Subject, row

AT_REST = 4.0  # s
SWEEPS = 300  # most per step until then
EXACT_ERROR, SWEPT_ERROR = 1e-9, 1e-6
MOST = 50_000  # sweeps
EXACT: dict[str, Any] = {"method": "exact", "order": "color", "max_iterations": MOST}


class Step(NamedTuple):
    """A step to be solved, with the state before it and the exact velocities after it [m/s].

    `error_of_nothing` is the error of the free velocities [m/s], by which other errors are divided.
    """

    scene: Scene
    start: State
    exact: FloatArray
    error_of_nothing: float

    def error(self, velocity: FloatArray) -> float:
        return float(np.abs(velocity - self.exact).max()) / self.error_of_nothing


def pile(n: int) -> Scene:
    """Return the shipped pile with n grains, scaled so that their total area stays the same."""
    radius = 0.014 * (1000 / n) ** 0.5
    scene = Scene.load("pile", [f"grains.count={n}", f"grains.radius={radius!r}", f"grains.mass={1.0 / n!r}"])
    dt, factor = 0.005 * (radius / 0.014) ** 0.5, np.random.default_rng(n).uniform(0.7, 1.05, n)
    changes: dict[str, Any] = {"drag": 1.0 / n, "dt": dt, "max_iterations": SWEEPS, "tolerance": 1e-5}
    return scene.replace(**changes, radius=radius * factor, mass=factor**2 / n)


def steps_of(n: int, options: argparse.Namespace) -> Iterator[Step]:
    """Yield successive steps of a pile of n grains, after three exact steps."""
    scene = pile(n)
    start = kept_state(options.cache / f"poly-{n}-resting.npz", scene, ceil(AT_REST / scene.dt))
    simulation = continued(scene, start, **EXACT, tolerance=1e-10)
    witness = Simulation(scene.replace(**EXACT, tolerance=1e-14), threads=1)
    for _ in range(options.repeats):
        before = simulation.state()
        witness.restore(before)
        witness.step()
        problem = StepProblem(scene, before.position, before.velocity, before.staggered)
        nothing = float(np.abs(problem.free_velocity - witness.velocity).max())
        yield Step(scene, before, witness.velocity, nothing)
        simulation.step()


def exactly(step: Step) -> tuple[float, int]:
    """Return time [ms] and number of factorizations of the exact method for an error of `EXACT_ERROR`.

    The tolerance is the largest power of ten that gives this error.
    """
    for tolerance in 10.0 ** -np.arange(4.0, 14.0):
        simulation = Simulation(step.scene.replace(**EXACT, tolerance=tolerance), threads=1)
        taken, factorizations = _take(simulation, step)
        if step.error(simulation.velocity) <= EXACT_ERROR:
            return min(taken, _take(simulation, step)[0]), factorizations
    raise RuntimeError(f"no tolerance gives a relative error of {EXACT_ERROR}")


def by_sweeps(step: Step) -> tuple[float, int]:
    """Return time [ms] and number of accelerated sweeps for an error of `SWEPT_ERROR`.

    The number exceeds the least sufficient one by up to 20 %.
    """
    sweeps = 20
    while True:
        changes = {"method": "accelerated", "order": "color", "tolerance": 0.0, "max_iterations": sweeps}
        simulation = Simulation(step.scene.replace(**changes), threads=1)
        taken, _ = _take(simulation, step)
        if step.error(simulation.velocity) <= SWEPT_ERROR or sweeps > MOST:
            return taken, sweeps
        sweeps += sweeps // 5


def _take(simulation: Simulation, step: Step) -> tuple[float, int]:
    simulation.restore(step.start)
    begun = process_time()
    report = simulation.step()
    return 1e3 * (process_time() - begun), report.factorizations


def piles(options: argparse.Namespace) -> Iterator[Row]:
    """Yield rows for piles: times of a step by both methods, then its factorizations and sweeps."""
    for n in options.grains:
        steps = list(steps_of(n, options))
        times, counts = zip(*(exactly(step) for step in steps), strict=True)
        its_times, its_sweeps = zip(*(by_sweeps(step) for step in steps), strict=True)
        subject = Subject(f"resting pile, exact to {EXACT_ERROR:g}", n, "color")
        other = f"accelerated to {SWEPT_ERROR:g}"
        yield row(subject, times, "ms a step", other, its_times, SPEEDUP, ">= 5")
        yield row(subject, counts, "factorizations", f"{other}, iterations", its_sweeps)


def shipped(options: argparse.Namespace) -> Iterator[Row]:
    """Yield a row for each shipped scene without friction: the number of steps not solved to 1e-9 m/s."""
    for name in shipped_scenes():
        scene = Scene.load(name)
        if scene.has_friction:
            continue
        scene = scene.replace(**EXACT, stop="default", tolerance=1e-9)
        steps = min(scene.steps, options.steps or scene.steps)
        done = Simulation(scene, threads=1).run(steps=steps)
        subject = Subject(f"{name}, {done.steps} steps to 1e-9 m/s", scene.n, "color")
        yield row(subject, [done.unconverged], "steps not converged", target="<= 0")


def with_friction(options: argparse.Namespace) -> Iterator[Row]:
    """Yield rows for runs of scenes with friction by both methods: steps that do not converge, and times."""
    scenes = [Scene.load(name) for name in ("rotating_drum", "couette", "hopper", "collapse")]
    flow = flowing(1_000, friction=0.5, order="color", max_iterations=10_000)
    for scene, tolerance in (*product(scenes, (1e-4, 1e-6)), (flow, 1e-4)):
        scene = scene.replace(tolerance=tolerance)
        steps = min(scene.steps, options.steps or scene.steps)
        short, taken = [], []
        for method in ("exact", "accelerated"):
            simulation = Simulation(scene.replace(method=method), threads=1)
            simulation.compile()
            begun = process_time()
            short.append(simulation.advance(steps).unconverged)
            taken.append(process_time() - begun)
        subject = Subject(f"{scene.name}, {steps} steps to {tolerance:g} m/s", scene.n, scene.order)
        most = f"<= {steps // 500}" if tolerance == 1e-6 else ""
        swept = subject._replace(name=f"{subject.name}, accelerated")
        yield row(subject, short[:1], "steps not converged", target=most)
        yield row(swept, short[1:], "steps not converged")
        yield row(subject, [taken[0]], "s", "accelerated", [taken[1]])
