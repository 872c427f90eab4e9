"""The hard set: every step reaches the residual asked for."""

from typing import Any

import numpy as np
import pytest
from cases import CASES, Case
from invariants import checked_step
from schemes import MIXED, SCHEMES

from warpgrains import Scene, Simulation, SimulationError

TOLERANCE = 1e-8  # m/s, of the residual
MAX_ITERATIONS = 500_000


def simulate(scene: Scene, **changes: Any) -> Simulation:
    solver = {"method": "accelerated", "stop": "residual", "max_iterations": MAX_ITERATIONS}
    return Simulation(scene, tolerance=TOLERANCE, **{**solver, **changes})


def take(simulation: Simulation, steps: int) -> None:
    for step in range(steps):
        report = checked_step(simulation)
        assert report.converged, f"step {step}: {report}"


EVERY = [("sequential", scheme) for scheme in (*SCHEMES, *MIXED)] + [("color", scheme) for scheme in SCHEMES]
WAYS = [
    pytest.param(
        case,
        order,
        *scheme.values,
        id=f"{order}, {case.name}, {scheme.id}",
        marks=[pytest.mark.slow] * ((order, scheme) != EVERY[k % 2]),
    )
    for k, case in enumerate(CASES)
    for order, scheme in EVERY
]
"""Cases by the two schemes in turn, and behind `slow` in every way."""


@pytest.mark.parametrize(("case", "order", "scheme"), WAYS)
def test_hard_case(case: Case, order: str, scheme: dict[str, str]) -> None:
    """Those in color order take more steps. A case runs once more if something changes on the way."""
    simulation = simulate(case.scene(), order=order, **scheme)
    if case.refused and scheme["wall"] == "round":
        with pytest.raises(SimulationError, match=r"step 1, .*: grain \d+ .* leaves the circle of"):
            simulation.step()
        assert np.array_equal(simulation.position, simulation.scene.position)
        return
    steps = case.steps if order == "sequential" else case.long_steps
    take(simulation, steps)
    if case.then:
        state = simulation.state()
        simulation = Simulation(simulation.scene.replace(**case.then))
        simulation.restore(state)
        take(simulation, steps)
    case.outcome(simulation)


HARD = [case for case in CASES if case.is_hard]
IN_TURN = [(case, ("gauss-seidel", "accelerated")[k % 2]) for k, case in enumerate(HARD)]
"""By methods in turn; the exact one solves them."""


@pytest.mark.parametrize(("case", "method"), IN_TURN)
def test_what_is_only_hard_is_not_named(case: Case, method: str) -> None:
    simulation, unconverged = simulate(case.scene(), method=method, max_iterations=20), 0
    for _ in range(60):
        unconverged += not simulation.step().converged
        assert simulation.infeasible_grains() == ()
    assert unconverged >= 30
