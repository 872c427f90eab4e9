"""One step, solved with ever more iterations: its wall time and its true error, by every way to solve it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from statistics import median
from time import perf_counter
from typing import NamedTuple, TypeVar

import numpy as np

from warpgrains.analysis.exact import solve_exactly
from warpgrains.analysis.problem import StepProblem
from warpgrains.arrays import FloatArray
from warpgrains.report.c_reference import MOST_GRAINS, find_c_reference
from warpgrains.report.course import Moment
from warpgrains.report.options import Effort
from warpgrains.scene.scene import METHODS, ORDERS, Scene
from warpgrains.simulation.simulation import Simulation
from warpgrains.solver.statistics import StepReport

THREADS = (1, 2)
CONVERGED = 1e-12  # m/s: a residual that more iterations do not improve
CHECK_ITERATIONS = 30_000  # of the solution that the exact one is compared with

Result = TypeVar("Result")


class Way(NamedTuple):
    """A way to solve a step."""

    code: str
    """warpgrains, or C reference."""
    method: str
    order: str
    threads: int


@dataclass(frozen=True)
class StepRow:
    """One step by one way: a row of steps.csv.

    Attributes
    ----------
    scene, moment : str
    time : float
        Simulated time at which the step starts [s].
    grains, contacts : int
        Contacts that carry a correction after the step.
    code, method, order, threads
        The way it was solved, see `Way`.
    iterations : int
    wall_time : float
        Median of the repeats [s].
    error : float
        Largest difference of a velocity component from the exact solution [m/s].
    error_of_exact : float
        Difference of the exact solution from that of the accelerated method, converged as far as it goes:
        errors below it are not to be trusted [m/s].
    error_of_nothing : float
        Error of the free velocities, of a step without any contact [m/s].
    """

    scene: str
    moment: str
    time: float
    grains: int
    contacts: int
    code: str
    method: str
    order: str
    threads: int
    iterations: int
    wall_time: float
    error: float
    error_of_exact: float
    error_of_nothing: float

    @property
    def way(self) -> Way:
        """How it was solved."""
        return Way(self.code, self.method, self.order, self.threads)


class Try(NamedTuple):
    """A step with some budget of iterations."""

    iterations: int
    wall_time: float
    velocity: FloatArray
    done: bool
    """Whether more iterations would be of no use."""


def measure_steps(scene: Scene, moment: Moment, effort: Effort) -> Iterator[StepRow]:
    """Solve the step of a moment by every way and every budget of iterations."""
    problem = StepProblem(scene, moment.state.position, moment.state.velocity)
    converged = _converged(scene, moment)
    exact = solve_exactly(problem, converged).velocity
    error_of_exact = _difference(converged, exact)
    for way, solve in _ways(scene, moment, effort):
        for budget in effort.budgets:
            tried = solve(budget)
            yield StepRow(
                scene=scene.name,
                moment=moment.name,
                time=moment.state.steps * scene.dt,
                grains=scene.n,
                contacts=moment.contacts,
                **way._asdict(),
                iterations=tried.iterations,
                wall_time=tried.wall_time,
                error=_difference(tried.velocity, exact),
                error_of_exact=error_of_exact,
                error_of_nothing=_difference(problem.free_velocity, exact),
            )
            if tried.done or tried.iterations < budget or tried.wall_time > effort.longest:
                break


def _converged(scene: Scene, moment: Moment) -> FloatArray:
    """Return the velocities that the accelerated method finds when it goes on for long [m/s]."""
    simulation = Simulation(
        scene,
        method="accelerated",
        order="color",
        stop="residual",
        tolerance=CONVERGED,
        max_iterations=CHECK_ITERATIONS,
    )
    simulation.restore(moment.state)
    simulation.step()
    return simulation.velocity


def _difference(velocity: FloatArray, other: FloatArray) -> float:
    return float(np.abs(velocity - other).max())


def _ways(scene: Scene, moment: Moment, effort: Effort) -> Iterator[tuple[Way, Callable[[int], Try]]]:
    """Yield every way to solve a step, and what solves it with a budget of iterations."""
    for method in METHODS:
        for order in ORDERS:
            for threads in THREADS:
                way = Way("warpgrains", method, order, threads)
                yield way, partial(_solve, scene, moment, effort, way)
    if find_c_reference().start is not None and scene.n <= MOST_GRAINS:
        way = Way("C reference", "gauss-seidel", "sequential", 1)
        yield way, partial(_solve_in_c, scene, moment, effort)


def _solve(scene: Scene, moment: Moment, effort: Effort, way: Way, budget: int) -> Try:
    """Take the step with a simulation that does not stop before its budget is spent.

    Its solver takes the step: a simulation would go on to search for a proof that it has no solution.
    """
    simulation = Simulation(
        scene, threads=way.threads, method=way.method, order=way.order, tolerance=0.0, max_iterations=budget
    )

    def step() -> tuple[float, StepReport]:
        simulation.restore(moment.state)
        start = perf_counter()
        report = simulation._solver.solve()
        return perf_counter() - start, report

    step()  # once, so that the launches are captured
    wall_time, report = _median(step, effort)
    return Try(report.iterations, wall_time, simulation.velocity, report.residual <= CONVERGED)


def _solve_in_c(scene: Scene, moment: Moment, effort: Effort, budget: int) -> Try:
    """Take the step with the C reference, which does not tell how many iterations it did."""
    begin = find_c_reference().start
    assert begin is not None
    spending = scene.replace(tolerance=0.0, max_iterations=budget)

    def step() -> tuple[float, FloatArray]:
        reference = begin(spending, moment.state)
        start = perf_counter()
        reference.update()
        return perf_counter() - start, reference.velocity

    return Try(budget, *_median(step, effort), done=False)


def _median(step: Callable[[], tuple[float, Result]], effort: Effort) -> tuple[float, Result]:
    """Return the median of the times of a step, and what it gave; one that takes too long is taken once."""
    taken = [step()]
    while len(taken) < effort.repeats and taken[0][0] <= effort.longest:
        taken.append(step())
    return median(time for time, _ in taken), taken[0][1]
