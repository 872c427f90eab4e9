"""Every hard case reaches the residual asked for in every step, and every step keeps the invariants."""

import pytest
from cases import CASES, Case
from invariants import checked_step

from warpgrains import Simulation

MAX_ITERATIONS = 200_000


def run(case: Case, steps: int, order: str) -> None:
    """Run a case, and once more if something changes on the way."""
    scene = case.scene().replace(
        order=order,
        method="accelerated",
        stop="residual",
        tolerance=case.tolerance,
        max_iterations=MAX_ITERATIONS,
    )
    simulation = Simulation(scene)
    take(simulation, steps)
    if case.then:
        state = simulation.state()
        simulation = Simulation(scene.replace(**case.then))
        simulation.restore(state)
        take(simulation, steps)
    case.outcome(simulation)


def take(simulation: Simulation, steps: int) -> None:
    for step in range(steps):
        report = checked_step(simulation)
        assert report.converged, f"step {step}: {report}"


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_hard_case(case: Case) -> None:
    run(case, case.steps, "sequential")


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_hard_case_for_long(case: Case) -> None:
    run(case, case.long_steps, "color")
