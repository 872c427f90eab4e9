"""The hard set: every step reaches the residual asked for."""

import numpy as np
import pytest
from cases import CASES
from invariants import checked_step
from schemes import MIXED, SCHEMES

from warpgrains import Simulation, SimulationError
from warpgrains.scene.fields import METHODS

TOLERANCE = 1e-8  # m/s, of the residual
MAX_ITERATIONS = 500_000


def simulate(scene, **changes):
    solver = {"method": "accelerated", "stop": "residual", "max_iterations": MAX_ITERATIONS}
    return Simulation(scene, tolerance=TOLERANCE, **{**solver, **changes})


def take(simulation, steps):
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
def test_hard_case(case, order, scheme):
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
        simulation = Simulation(simulation.scene.replace(**case.then), state=simulation.state())
        take(simulation, steps)
    case.outcome(simulation)


HARD = [case for case in CASES if case.is_hard]


# by methods in turn; the exact one solves them
@pytest.mark.parametrize(("case", "method"), [*zip(HARD, METHODS[:2] * 3, strict=True)])
def test_what_is_only_hard_is_not_named(case, method):
    simulation, unconverged = simulate(case.scene(), method=method, max_iterations=20), 0
    for _ in range(30):
        unconverged += not simulation.step().converged
        assert simulation.infeasible_grains() == ()
    assert unconverged >= 15
