"""The hard set: every step satisfies the invariants, and reaches the residual asked for."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import pytest
from hard_scenes import heap, heavy_top, jam, past_the_origin, random_masses, sizes, stack
from invariants import checked_step
from sample_scenes import bullet, explosion, falling_cloud, squeezed_light_grains
from schemes import MIXED, SCHEMES

from warpgrains import Scene, Simulation, SimulationError
from warpgrains.scene.fields import METHODS

TOLERANCE = 1e-8  # m/s, of the residual
MAX_ITERATIONS = 500_000


@dataclass(frozen=True)
class Case:
    """A scene, how long it runs, and what is expected of it beside the invariants of every step."""

    name: str
    scene: Callable[[], Scene]
    steps: int
    long_steps: int  # of the run behind the marker `slow`
    outcome: Callable[[Simulation], None] = lambda simulation: None  # asserts what is expected at the end
    is_hard: bool = False  # most of its first 30 steps need more than 20 iterations
    refused: bool = False  # a round wall refuses its first step: grains that are parted leave its circle
    then: dict[str, Any] = field(default_factory=dict)  # changes after these steps, followed by as many


def rests_upright(simulation):
    """On the axis every normal is (0, 1) or (0, -1), and every number off it is a product with 0.

    At rest, each contact closes at eta at most, from a gap of dt eta at most: 2 eta a contact below.
    """
    scene, v = simulation.scene, simulation.velocity
    assert (simulation.position[:, 0] == 0.0).all()
    assert (np.abs(v[:, 1]) <= 2.0 * np.arange(1, scene.n + 1) * scene.tolerance).all()


def flies_on(simulation):
    """It has not come near the wall."""
    assert np.array_equal(simulation.velocity, simulation.scene.velocity)


def stops_at_the_wall(simulation):
    """It hits it within 1e-9 m of straight on, keeps as little of its 1 m/s, and stays to within dt eta."""
    scene = simulation.scene
    room = scene.radius_out - scene.radius[0]
    assert np.abs(simulation.velocity).max() <= 2.0 * scene.tolerance + 1e-9 / room
    assert abs(simulation.position[0, 0] - room) <= scene.dt * scene.tolerance


def has_fallen_up(simulation):
    """Its centre of mass is in the upper half."""
    assert simulation.scene.mass @ simulation.position[:, 1] > 0.0


ONE_TO_FIVE = np.random.default_rng(3).uniform(0.015, 0.075, 150)
ONE_TO_A_HUNDRED = np.repeat([0.2, 0.02, 0.002], [6, 60, 300])

CASES = (
    Case("column of 50", partial(stack, 50), 100, 400, rests_upright, is_hard=True),
    Case("column of 200", partial(stack, 200), 50, 300, rests_upright),
    Case("masses 1:100, random", partial(random_masses, 100, 1e2), 60, 200, is_hard=True),
    Case("masses 1:10,000, random", partial(random_masses, 100, 1e4), 60, 150, is_hard=True),
    Case("masses 1:100, heavy top", partial(heavy_top, 100, 1e2), 60, 200),
    Case("masses 1:10,000, heavy top", partial(heavy_top, 100, 1e4), 11, 30),
    Case("jam filled to 80%", jam, 15, 30, is_hard=True),
    Case("radii 1:5", partial(sizes, ONE_TO_FIVE), 80, 300, is_hard=True),
    Case("radii 1:100", partial(sizes, ONE_TO_A_HUNDRED), 80, 150, is_hard=True),
    Case("bullet into a pile", bullet, 40, 200),
    Case("cloud falling on a pile", falling_cloud, 40, 200),
    Case("masses 1:1,000,000, squeezed", squeezed_light_grains, 40, 200),
    Case("thirty grains in one place", explosion, 40, 200),
    Case("deep overlap", partial(heap, 60, spacing=1.0), 40, 200, refused=True),
    Case("overlap", partial(heap, 60, spacing=1.8), 40, 200),
    Case("small grain past the origin", partial(past_the_origin, 0.1), 20, 20, flies_on),
    Case("large grain past the origin", partial(past_the_origin, 0.8), 60, 60, stops_at_the_wall),
    Case("tight grain past the origin", partial(past_the_origin, 0.98), 60, 60, stops_at_the_wall),
    Case("gravity off", partial(heap, 60), 80, 300, then={"gravity": (0.0, 0.0)}),
    Case("gravity reversed", partial(heap, 60), 80, 300, has_fallen_up, then={"gravity": (0, 9.81)}),
    *(
        Case(f"dt {dt:g}", partial(heap, 60, spacing=2.0, dt=dt), 100, 400)
        for dt in (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
    ),
)


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
