"""Solutions of difficult steps of a scene by every method, with more and more iterations.

The wall time of each solution is measured, and its error with respect to the exact one.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from statistics import median
from time import perf_counter
from typing import Any, NamedTuple, TypeVar

import numpy as np

from warpgrains.accuracy.exact_step import StepProblem, solve_exactly
from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import InputError
from warpgrains.reference.reference import MOST_GRAINS, find_c_reference
from warpgrains.report.rows import ACCURATE, SWEEPING, Budget, Configuration, StepRow
from warpgrains.scene.fields import ORDERS
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import State
from warpgrains.simulation.simulation import Simulation
from warpgrains.solver.statistics import StepReport

THREADS = (1, 2)
CONVERGED = 1e-12  # m/s; smaller residuals do not improve with more iterations
EXACT: dict[str, Any] = {"method": "exact", "order": "color", "max_iterations": 30_000}
TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)  # m/s, of the exact method

Result = TypeVar("Result")


class HistoryStep(NamedTuple):
    """A step of a simulation: its name ("onset", "hardest" or "end"), and the state before it."""

    name: str
    state: State
    contacts: int
    """Contacts that carry a correction after the step."""


@dataclass(frozen=True)
class History:
    """States of a simulation before its difficult steps, at which measurements start."""

    first: State
    """State before the first step with an active contact."""
    hardest: State
    """State before the step with the most iterations."""
    snapshots: list[HistoryStep]
    """Three steps in order, fewer if they coincide.

    They are onset, the first step with half of the largest number of contacts; hardest, the step with the
    most iterations; and end, the last step.
    """


class Measurement(NamedTuple):
    """A solution of a step, with few or many iterations, and its wall time."""

    iterations: int
    wall_time: float
    """Wall time of the step, median of its repetitions [s]."""
    velocity: FloatArray
    """Velocities after the step [m/s], shape (n, 2)."""
    done: bool
    """True if more iterations cannot improve the result."""


def follow_history(scene: Scene, longest: int) -> History:
    """Simulate up to `longest` steps of a scene with an accurate solver, and return the difficult ones.

    Raises InputError if no contact ever carries a correction.
    """
    simulation = Simulation(scene, **ACCURATE)
    records: list[HistoryStep] = []  # steps with more contacts than any earlier one
    hardest = end = HistoryStep("", simulation.state(), 0)
    most_iterations = 0
    for _ in range(min(scene.steps, longest)):
        state = simulation.state()
        report = simulation.step()
        end = HistoryStep("end", state, report.contacts)
        if report.contacts > (records[-1].contacts if records else 0):
            records.append(HistoryStep("onset", state, report.contacts))
        if report.contacts and report.iterations > most_iterations:
            most_iterations = report.iterations
            hardest = HistoryStep("hardest", state, report.contacts)
    if not records:
        raise InputError(
            f"scene '{scene.name}' has no contacts in {end.state.steps + 1} steps: choose one with contacts"
        )
    onset = next(record for record in records if 2 * record.contacts >= records[-1].contacts)
    by_step = {snapshot.state.steps: snapshot for snapshot in (end, hardest, onset) if snapshot.contacts}
    return History(records[0].state, hardest.state, [by_step[step] for step in sorted(by_step)])


def measure_steps(scene: Scene, snapshot: HistoryStep, budget: Budget) -> Iterator[StepRow]:
    """Solve a step in every configuration, with more and more iterations; yield a row for each solution."""
    state = snapshot.state
    now = scene.time_after(state.steps)
    problem = StepProblem(scene, state.position, state.velocity, state.staggered, time=now)
    accurate = Simulation(scene.replace(**EXACT, stop="default", tolerance=CONVERGED))
    accurate.restore(snapshot.state)
    accurate.step()
    converged = accurate.velocity
    exact = solve_exactly(problem, converged).velocity
    error_of_exact = _difference(converged, exact)
    for configuration, measurements in _configurations(scene, snapshot, budget):
        for measured in measurements:
            yield StepRow(
                scene=scene.name,
                moment=snapshot.name,
                time=now,
                grains=scene.n,
                contacts=snapshot.contacts,
                **configuration._asdict(),
                iterations=measured.iterations,
                wall_time=measured.wall_time,
                error=_difference(measured.velocity, exact),
                error_of_exact=error_of_exact,
                error_of_nothing=_difference(problem.free_velocity, exact),
            )
            if measured.done or measured.wall_time > budget.longest:
                break


def _difference(velocity: FloatArray, other: FloatArray) -> float:
    return float(np.abs(velocity - other).max())


def _configurations(
    scene: Scene, snapshot: HistoryStep, budget: Budget
) -> Iterator[tuple[Configuration, Iterator[Measurement]]]:
    """Yield every configuration with an iterator of its solutions of a step, from few iterations to many."""
    unlimited = scene.replace(stop="default", tolerance=0.0)
    for method, order, threads in product(SWEEPING, ORDERS, THREADS):
        solving = [
            unlimited.replace(method=method, order=order, max_iterations=limit) for limit in budget.iterations
        ]
        configuration = Configuration("warpgrains", method, order, threads)
        yield configuration, (_solve(one, threads, snapshot, budget) for one in solving)
    solving = [unlimited.replace(**EXACT).replace(tolerance=tolerance) for tolerance in TOLERANCES]
    configuration = Configuration("warpgrains", "exact", "color", 1)
    yield configuration, (_solve(one, 1, snapshot, budget) for one in solving)
    if find_c_reference().start is not None and scene.n <= MOST_GRAINS:
        configuration = Configuration("C reference", "gauss-seidel", "sequential", 1)
        yield configuration, (_solve_in_c(scene, snapshot, budget, limit) for limit in budget.iterations)


def _solve(scene: Scene, threads: int, snapshot: HistoryStep, budget: Budget) -> Measurement:
    """Solve a step by a simulation of `scene`, which gives the method, tolerance and limit of iterations."""
    simulation = Simulation(scene, threads=threads)

    def step() -> tuple[float, StepReport]:
        simulation.restore(snapshot.state)
        start = perf_counter()
        report = simulation.step()
        return perf_counter() - start, report

    step()  # warm-up: builds the list and compiles the kernels
    wall_time, report = _median(step, budget)
    iterations = report.iterations + report.factorizations
    useless = scene.tolerance == 0.0 and iterations < scene.max_iterations
    done = useless or report.residual <= CONVERGED
    return Measurement(iterations, wall_time, simulation.velocity, done)


def _solve_in_c(scene: Scene, snapshot: HistoryStep, budget: Budget, limit: int) -> Measurement:
    """Solve a step with the C reference, which always does `limit` iterations."""
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
    """Call `step` repeatedly; return the median of the times that it returns [s], and its first result.

    If the first call takes longer than the budget allows, it is the only one.
    """
    taken = [step()]
    while len(taken) < budget.repeats and taken[0][0] <= budget.longest:
        taken.append(step())
    return median(time for time, _ in taken), taken[0][1]
