"""One step, solved with ever more iterations: its wall time and its true error, in every configuration."""

from collections.abc import Callable, Iterator
from functools import partial
from statistics import median
from time import perf_counter
from typing import NamedTuple, TypeVar

import numpy as np

from warpgrains.analysis.exact import solve_exactly
from warpgrains.analysis.problem import StepProblem
from warpgrains.arrays import FloatArray
from warpgrains.reference.reference import MOST_GRAINS, find_c_reference
from warpgrains.report.history import Snapshot
from warpgrains.report.rows import Budget, Configuration, StepRow
from warpgrains.scene.scene import METHODS, ORDERS, Scene
from warpgrains.simulation.simulation import Simulation
from warpgrains.solver.statistics import StepReport

THREADS = (1, 2)
CONVERGED = 1e-12  # m/s: a residual that more iterations do not improve
CHECK_ITERATIONS = 30_000  # of the solution that the exact one is compared with

Result = TypeVar("Result")


class Measurement(NamedTuple):
    """A step with some limit on its iterations."""

    iterations: int
    wall_time: float
    velocity: FloatArray
    done: bool
    """Whether more iterations would be of no use."""


def measure_steps(scene: Scene, snapshot: Snapshot, budget: Budget) -> Iterator[StepRow]:
    """Solve the step after a snapshot in every configuration, with ever more iterations."""
    problem = StepProblem(scene, snapshot.state.position, snapshot.state.velocity)
    converged = _converged(scene, snapshot)
    exact = solve_exactly(problem, converged).velocity
    error_of_exact = _difference(converged, exact)
    for configuration, solve in _configurations(scene, snapshot, budget):
        for limit in budget.iterations:
            measured = solve(limit)
            yield StepRow(
                scene=scene.name,
                moment=snapshot.name,
                time=snapshot.state.steps * scene.dt,
                grains=scene.n,
                contacts=snapshot.contacts,
                **configuration._asdict(),
                iterations=measured.iterations,
                wall_time=measured.wall_time,
                error=_difference(measured.velocity, exact),
                error_of_exact=error_of_exact,
                error_of_nothing=_difference(problem.free_velocity, exact),
            )
            if measured.done or measured.iterations < limit or measured.wall_time > budget.longest:
                break


def _converged(scene: Scene, snapshot: Snapshot) -> FloatArray:
    """Return the velocities that the accelerated method finds when it goes on for long [m/s]."""
    simulation = Simulation(
        scene,
        method="accelerated",
        order="color",
        stop="residual",
        tolerance=CONVERGED,
        max_iterations=CHECK_ITERATIONS,
    )
    simulation.restore(snapshot.state)
    simulation.step()
    return simulation.velocity


def _difference(velocity: FloatArray, other: FloatArray) -> float:
    return float(np.abs(velocity - other).max())


def _configurations(
    scene: Scene, snapshot: Snapshot, budget: Budget
) -> Iterator[tuple[Configuration, Callable[[int], Measurement]]]:
    """Yield every configuration, and what solves a step in it with a limit on the iterations."""
    for method in METHODS:
        for order in ORDERS:
            for threads in THREADS:
                configuration = Configuration("warpgrains", method, order, threads)
                yield configuration, partial(_solve, scene, snapshot, budget, configuration)
    if find_c_reference().start is not None and scene.n <= MOST_GRAINS:
        configuration = Configuration("C reference", "gauss-seidel", "sequential", 1)
        yield configuration, partial(_solve_in_c, scene, snapshot, budget)


def _solve(
    scene: Scene, snapshot: Snapshot, budget: Budget, configuration: Configuration, limit: int
) -> Measurement:
    """Take the step with a simulation that does not stop before its limit.

    Its solver takes the step: a simulation would go on to search for a proof that it has no solution.
    """
    simulation = Simulation(
        scene,
        threads=configuration.threads,
        method=configuration.method,
        order=configuration.order,
        tolerance=0.0,
        max_iterations=limit,
    )

    def step() -> tuple[float, StepReport]:
        simulation.restore(snapshot.state)
        start = perf_counter()
        report = simulation.step()
        return perf_counter() - start, report

    step()  # once, so that the launches are captured
    wall_time, report = _median(step, budget)
    return Measurement(report.iterations, wall_time, simulation.velocity, report.residual <= CONVERGED)


def _solve_in_c(scene: Scene, snapshot: Snapshot, budget: Budget, limit: int) -> Measurement:
    """Take the step with the C reference, which does not tell how many iterations it did."""
    begin = find_c_reference().start
    assert begin is not None
    spending = scene.replace(tolerance=0.0, max_iterations=limit)

    def step() -> tuple[float, FloatArray]:
        reference = begin(spending, snapshot.state)
        start = perf_counter()
        reference.update()
        return perf_counter() - start, reference.velocity

    return Measurement(limit, *_median(step, budget), done=False)


def _median(step: Callable[[], tuple[float, Result]], budget: Budget) -> tuple[float, Result]:
    """Return the median of the times of a step, and what it gave; one that takes too long is taken once."""
    taken = [step()]
    while len(taken) < budget.repeats and taken[0][0] <= budget.longest:
        taken.append(step())
    return median(time for time, _ in taken), taken[0][1]
