"""The exact method against accelerated sweeps on single steps, and to the end of every shipped scene: CSV.

    python -m tests.bench.exact -o tests/bench/results/exact.csv

Times are those of the processor, of one thread, so that the machine may be busy. Piles are the shipped one on
other scales, of equal radii or of radii 1:1.5, after 0.8 s (settling), 2 s (creeping) and 4 s (resting), with
300 sweeps a step at most; they take minutes and are kept for the next run. A step is the one after three
exact ones, five in a row. Errors are max |v - v_exact| over that of the free velocities. v_exact is what the
method leaves with no tolerance; how far clarabel's is from it is said, with what clarabel proves of its own.
"""

import argparse
import resource
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from math import ceil
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from warpgrains import Scene, Simulation, State
from warpgrains.accuracy.exact_step import StepProblem, solve_exactly
from warpgrains.arrays import FloatArray
from warpgrains.scene.toml import shipped_scenes

from .flow import kept_state
from .rows import SPEEDUP, Subject, command_line, publish, row, say

MARKS = {"settling": 0.8, "creeping": 2.0, "resting": 4.0}  # s
SWEEPS = 300  # of a step until then
WITNESSED = 3000  # grains up to which clarabel is asked
MOST = 50_000  # sweeps


class Step(NamedTuple):
    """A step to be solved: from where, and to what velocities [m/s]."""

    scene: Scene
    start: State
    exact: FloatArray
    error_of_nothing: float

    def error(self, velocity: FloatArray) -> float:
        return float(np.abs(velocity - self.exact).max()) / self.error_of_nothing


def pile(radii: str, n: int) -> Scene:
    """Return the shipped pile on another scale."""
    radius = 0.014 * (1000 / n) ** 0.5
    scene = Scene.load("pile", [f"grains.count={n}", f"grains.radius={radius!r}", f"grains.mass={1.0 / n!r}"])
    dt = 0.005 * (radius / 0.014) ** 0.5
    changes: dict[str, Any] = {"drag": 1.0 / n, "dt": dt, "max_iterations": SWEEPS, "tolerance": 1e-5}
    if radii == "poly":
        factor = np.random.default_rng(n).uniform(0.7, 1.05, n)
        changes |= {"radius": radius * factor, "mass": factor**2 / n}
    return scene.replace(**changes)


def state(radii: str, n: int, mark: str, cache: Path) -> tuple[Scene, State]:
    """Return a pile at a time of its history: from the cache, or made and put there."""
    scene = pile(radii, n)

    def reach() -> Simulation:
        simulation = Simulation(scene, threads=1)
        simulation.run(steps=ceil(MARKS[mark] / scene.dt))
        return simulation

    return scene, kept_state(cache / f"{radii}-{n}-{mark}.npz", reach)


def steps_of(radii: str, n: int, mark: str, options: argparse.Namespace) -> Iterator[Step]:
    """Yield steps in a row, after three exact ones."""
    scene, start = state(radii, n, mark, options.cache)
    simulation = Simulation(scene.replace(**EXACT, tolerance=1e-10), threads=1)
    simulation.restore(start)
    simulation.advance(3)
    witness = Simulation(scene.replace(**EXACT, tolerance=1e-14), threads=1)
    for _ in range(options.repeats):
        before = simulation.state()
        witness.restore(before)
        witness.step()
        problem = StepProblem(scene, before.position, before.velocity, before.staggered)
        nothing = float(np.abs(problem.free_velocity - witness.velocity).max())
        if n <= WITNESSED:
            other = solve_exactly(problem, witness.velocity)
            difference = float(np.abs(other.velocity - witness.velocity).max())
            say(
                f"{mark}: clarabel is {difference / nothing:.1e} away, and proves {other.error / nothing:.1e}"
            )
        yield Step(scene, before, witness.velocity, nothing)
        simulation.step()


EXACT: dict[str, Any] = {"method": "exact", "order": "color", "max_iterations": MOST}


def exactly(step: Step, error: float) -> tuple[float, int]:
    """Return time [ms] and factorizations of the exact method, with the largest tolerance that will do."""
    for tolerance in 10.0 ** -np.arange(4.0, 14.0):
        simulation = Simulation(step.scene.replace(**EXACT, tolerance=tolerance), threads=1)
        taken, factorizations = _take(simulation, step)
        if step.error(simulation.velocity) <= error:
            return min(taken, _take(simulation, step)[0]), factorizations
    raise RuntimeError(f"no tolerance gives a relative error of {error}")


def by_sweeps(step: Step, error: float) -> tuple[float, int]:
    """Return time [ms] and number of the accelerated sweeps that an error takes, to within a fifth."""
    sweeps = 20
    while True:
        changes = {"method": "accelerated", "order": "color", "tolerance": 0.0, "max_iterations": sweeps}
        simulation = Simulation(step.scene.replace(**changes), threads=1)
        taken, _ = _take(simulation, step)
        if step.error(simulation.velocity) <= error or sweeps > MOST:
            return taken, sweeps
        sweeps += sweeps // 5


def _take(simulation: Simulation, step: Step) -> tuple[float, int]:
    simulation.restore(step.start)
    begun = process_time()
    report = simulation.step()
    return 1e3 * (process_time() - begun), report.factorizations


def against_sweeps(
    radii: str, n: int, mark: str, errors: tuple[float, float], target: str, options: argparse.Namespace
) -> Iterator[dict[str, str]]:
    """Time of a step by both methods, each to its error, and what they do in it."""
    ours, theirs = zip(
        *(
            (exactly(step, errors[0]), by_sweeps(step, errors[1]))
            for step in steps_of(radii, n, mark, options)
        ),
        strict=True,
    )
    subject = Subject(f"{mark} pile, radii {radii}, exact to {errors[0]:g}", n, "color")
    other = f"accelerated to {errors[1]:g}"
    times, counts = ([[float(one[k]) for one in part] for part in (ours, theirs)] for k in (0, 1))
    yield row(subject, times[0], "ms a step", other, times[1], SPEEDUP, target)
    yield row(subject, counts[0], "factorizations", f"{other}, sweeps", counts[1])


def largest(options: argparse.Namespace) -> Iterator[dict[str, str]]:
    """Time of a step of the largest pile, and the memory that the process has taken."""
    n = options.largest
    taken = [exactly(step, 1e-6)[0] / 1e3 for step in steps_of("poly", n, "creeping", options)]
    yield row(
        Subject("creeping pile, radii poly, exact to 1e-06", n, "color"), taken, "s a step", target="<= 15"
    )
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    yield row(Subject("memory of the process", n, "color"), [used], "GB", target="<= 4")


def shipped(options: argparse.Namespace) -> Iterator[dict[str, str]]:
    """Steps of every shipped scene without friction or driven walls that are not solved to 1e-9 m/s."""
    for name in shipped_scenes():
        scene = Scene.load(name)
        if scene.has_friction or scene.has_driven_walls:
            continue
        scene = scene.replace(**EXACT, stop="default", tolerance=1e-9)
        steps = min(scene.steps, options.steps)
        done = Simulation(scene, threads=1).run(steps=steps)
        say(f"{name}: {done}")
        subject = Subject(f"{name}, {done.steps} steps to 1e-9 m/s", scene.n, "color")
        yield row(subject, [done.unconverged], "steps not there", target="<= 0")


def with_friction(options: argparse.Namespace) -> Iterator[dict[str, str]]:
    """Steps short of their tolerance in runs of the shipped scenes with friction, and their times."""
    for name, tolerance in product(("rotating_drum", "couette", "hopper", "collapse"), (1e-4, 1e-6)):
        scene = Scene.load(name).replace(tolerance=tolerance)
        steps = min(scene.steps, options.steps)
        short: list[int] = []
        taken: list[float] = []
        for method in ("exact", "accelerated"):
            simulation = Simulation(scene.replace(method=method), threads=1)
            simulation.compile()
            begun = process_time()
            short.append(simulation.advance(steps).unconverged)
            taken.append(process_time() - begun)
        subject = Subject(f"{name}, {steps} steps to {tolerance:g} m/s", scene.n, scene.order)
        most = f"<= {steps // 500}" if tolerance == 1e-6 else ""
        yield row(subject, [short[0]], "steps not there", "accelerated", [short[1]], target=most)
        yield row(subject, [taken[0]], "s", "accelerated", [taken[1]])


PARTS: dict[str, Callable[[argparse.Namespace], Iterator[dict[str, str]]]] = {
    "small": partial(against_sweeps, "poly", 1_000, "resting", (1e-9, 1e-6), ">= 5"),
    "crystal": partial(against_sweeps, "mono", 1_000, "resting", (1e-9, 1e-6), ""),
    "middle": partial(against_sweeps, "poly", 3_000, "resting", (1e-9, 1e-6), ""),
    "creeping": partial(against_sweeps, "poly", 10_000, "creeping", (1e-9, 1e-6), ""),
    "resting": partial(against_sweeps, "poly", 10_000, "resting", (1e-9, 1e-6), ""),
    "settling": partial(against_sweeps, "poly", 10_000, "settling", (1e-6, 1e-6), ">= 0.91"),
    "largest": largest,
    "shipped": shipped,
    "friction": with_friction,
}


def main(arguments: list[str] | None = None) -> None:
    parser = command_line("exact", __doc__)
    parser.add_argument("--steps", type=int, default=1_000_000, help="of a shipped scene at most")
    parser.add_argument("--largest", type=int, default=100_000, help="grains of the largest pile")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), help="what to measure")
    options = parser.parse_args(arguments)
    publish((cells for part in options.only for cells in PARTS[part](options)), options.output)


if __name__ == "__main__":
    main()
