"""Half steps and a round wall: orders in dt, the circle, what contacts carry, and what is refused."""

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from same_bits import at_annulus
from schemes import SCHEMES, SECOND_ORDER, TEXTS
from scipy.integrate import solve_ivp

from warpgrains import Batch, Scene, Simulation, SimulationError
from warpgrains.arrays import FloatArray
from warpgrains.scene.fields import METHODS

GRAVITY = 9.81


def orders(errors: list[float]) -> FloatArray:
    """Orders in dt of errors at steps each half as long as the one before."""
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


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


def test_a_sliding_grain_is_carried() -> None:
    """The wall's force on a pendulum with drag, m (g cos(angle) + l angle'^2), is of second order."""
    length, rate = 0.9, 1.5  # m, 1/s

    def law(_: float, state: FloatArray) -> list[float]:
        return [state[1], -GRAVITY / length * np.sin(state[0]) - rate * state[1]]

    exact = solve_ivp(law, (0.0, 2.0), [1.0, 0.0], rtol=1e-12, atol=1e-12, dense_output=True).sol
    errors = []
    for dt in (0.02, 0.01, 0.005, 0.0025):
        simulation = Simulation(pendulum(dt), drag=rate * 0.2)
        simulation.step()
        worst = 0.0
        for step in range(1, round(1.9 / dt)):
            simulation.step()
            angle, speed = exact(step * dt)
            force = 0.2 * (GRAVITY * np.cos(angle) + length * speed**2)
            worst = max(worst, abs(at_annulus(simulation).force[0] - force))
        errors.append(worst)
    assert (orders(errors) >= 1.9).all()


def test_a_state_says_of_which_moment_its_velocities_are() -> None:
    scene = Scene.load("annulus").replace(**SECOND_ORDER)
    simulation = Simulation(scene)
    start = simulation.state()
    assert not start.staggered
    simulation.advance(70)
    kept = simulation.state()
    assert kept.staggered
    simulation.advance(30)
    wrong = Simulation(scene)
    wrong.restore(replace(kept, staggered=False))
    wrong.advance(30)
    assert not np.array_equal(wrong.position, simulation.position)
    assert not Simulation(scene, **TEXTS).state().staggered


def test_a_first_step_that_fails_leaves_the_first_kick_to_be_done() -> None:
    scene = Scene.load("no_inner_wall").replace(max_iterations=1, on_unconverged="raise", **SECOND_ORDER)
    simulation = Simulation(scene.replace(velocity=np.random.default_rng(0).normal(0.0, 3.0, (60, 2))))
    with pytest.raises(SimulationError, match="not converged"):
        simulation.step()
    assert not simulation.state().staggered


def fast(**changes: Any) -> Scene:
    """A grain at the wall, along which it would move by more than the circle of its centre is wide."""
    return Scene(
        position=[[0.0, 0.0001], [0.0, -0.9]],
        velocity=[[0.0, 0.0], [95.0, 0.0]],
        radius=0.1,
        mass=1.0,
        radius_out=1.0,
        gravity=(0.0, 0.0),
        **changes,
    )


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
    Simulation(fast(**TEXTS)).step()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        summaries = Batch([fast(**SECOND_ORDER), Scene.load("annulus").replace(duration=0.1)]).run()
    assert "leaves the circle" in summaries[0].error
    assert summaries[1].error is None


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_contacts_of_a_column_carry_what_is_above(scheme: dict[str, str], method: str) -> None:
    """Grains of different masses at rest; a leapfrog's first step gives half a kick, and so do contacts."""
    mass, radius = np.array([0.3, 0.1, 0.05, 0.2]), np.array([0.1, 0.05, 0.0625, 0.08])
    y = np.cumsum(2.0 * radius) - radius - 1.0
    grains = {"position": np.stack([np.zeros(4), y], axis=1), "radius": radius, "mass": mass}
    solver = {"method": method, "tolerance": 1e-12, "max_iterations": 100_000}
    simulation = Simulation(Scene(**grains, radius_out=1.0, drag=0.9 * 0.05 / 0.01, **solver, **scheme))
    carried = 9.81 * np.cumsum(mass[::-1])[::-1]
    for kick in (0.5 if scheme["scheme"] == "leapfrog" else 1.0, 1.0, 1.0):
        simulation.step()
        force = np.append(at_annulus(simulation).force[0], simulation.contacts().force)
        # a residual of 1e-12 m/s is that of a mass of a kg at most, over dt, four times passed on
        assert force == pytest.approx(kick * carried, abs=4.0 * 1e-12 / 0.01)
