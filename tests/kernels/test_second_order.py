"""Half steps and a round wall: the circle, the first kick, and what is refused."""

import warnings
from typing import Any

import numpy as np
import pytest
from schemes import EULER, SECOND_ORDER

from warpgrains import Batch, Scene, Simulation, SimulationError


def pendulum(dt: float) -> Scene:
    """A grain in an empty bowl, at rest 1 rad from its lowest point, 0.9 m from the centre."""
    grain = {"position": [[0.9 * np.sin(1.0), -0.9 * np.cos(1.0)]], "radius": 0.1, "mass": 0.2}
    return Scene(**grain, radius_out=1.0, dt=dt, tolerance=1e-13, **SECOND_ORDER)


@pytest.mark.parametrize("dt", [1e-1, 1e-2, 1e-3])
def test_a_sliding_grain_stays_on_the_circle(dt: float) -> None:
    simulation = Simulation(pendulum(dt))
    steps = round(3.0 / dt)
    statistics = simulation.advance(steps)
    assert statistics.unconverged == 0
    assert statistics.overlap <= 1e-12 * 0.1
    assert abs(np.hypot(*simulation.position[0]) - 0.9) <= 1e-12 * 0.1


def test_a_first_step_that_fails_leaves_the_first_kick_to_be_done() -> None:
    scene = Scene.load("no_inner_wall").replace(max_iterations=1, on_unconverged="raise", **SECOND_ORDER)
    simulation = Simulation(scene.replace(velocity=np.random.default_rng(0).normal(0.0, 3.0, (60, 2))))
    with pytest.raises(SimulationError, match="not converged"):
        simulation.step()
    assert not simulation.state().staggered


def fast(**changes: Any) -> Scene:
    """Return a grain at the wall, along which it would move by more than the circle of its center is wide."""
    grains = {"position": [[0.0, 0.0001], [0.0, -0.9]], "velocity": [[0.0, 0.0], [95.0, 0.0]], "radius": 0.1}
    return Scene(**grains, mass=1.0, radius_out=1.0, gravity=(0.0, 0.0), **changes)


@pytest.mark.parametrize("iterations", [1, 1000])
def test_a_grain_that_leaves_the_circle_is_refused(iterations: int) -> None:
    """One iteration does not converge, which changes nothing."""
    simulation = Simulation(fast(**SECOND_ORDER, max_iterations=iterations))
    refusal = (
        r"step 1, from t = 0.0 s: grain 1 reached a velocity of \[95.0, .*\] m/s along the round wall:"
        r" in a step of 0.01 s, it leaves the circle of 0.9 m"
    )
    for _ in range(2):
        with pytest.raises(SimulationError, match=refusal):
            simulation.step()
        assert np.array_equal(simulation.position, simulation.scene.position)
        assert not simulation.state().staggered
    Simulation(fast(**EULER)).step()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        summaries = Batch([fast(**SECOND_ORDER), Scene.load("annulus").replace(duration=0.1)]).run()
    assert "leaves the circle" in summaries[0].error
    assert summaries[1].error is None
