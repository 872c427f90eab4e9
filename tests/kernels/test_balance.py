"""The wall forces against the weight: what the walls take is what the grains lose."""

import numpy as np
import pytest
from same_bits import at_annulus
from schemes import SCHEMES

from warpgrains import Scene, Simulation
from warpgrains.arrays import FloatArray
from warpgrains.scene.fields import METHODS

EPS = np.finfo(float).eps


def settling(radius_in: float, **changes: object) -> Scene:
    """Forty grains of different radii and masses that fall through a syrup into a pile."""
    rng = np.random.default_rng(3)
    x, y = np.meshgrid(np.arange(8) - 3.5, np.arange(5))
    return Scene(
        position=np.stack([0.13 * x.ravel(), 0.13 * y.ravel() + 0.3], axis=1),
        radius=rng.uniform(0.03, 0.06, 40),
        mass=rng.uniform(0.05, 0.2, 40),
        radius_in=radius_in,
        radius_out=1.0,
        drag=0.8,
        dt=0.01,
        tolerance=1e-7,
        max_iterations=100_000,
    ).replace(**changes)


def step_and_balance(simulation: Simulation) -> tuple[FloatArray, FloatArray, float]:
    """Advance by one step. Return what walls, and what gravity and drag less motion, give in it, over dt [N].

    All grains together: M (v - v_0) = t (M g - drag u) - dt wall forces. In the text's scheme, t = dt and
    u = v_0; in the leapfrog u = (v_0 + v) / 2, but at first t = dt / 2 and u = v.
    """
    scene, x0, v0 = simulation.scene, simulation.position, simulation.velocity
    halving = scene.scheme == "leapfrog" and not simulation.state().staggered
    report = simulation.step()
    v, walls = simulation.velocity, at_annulus(simulation)
    wall_force = walls.force @ (x0 / np.hypot(*x0.T)[:, None])
    kick = 0.5 if halving else 1.0
    dragged = v0 if scene.scheme == "text" else v if halving else 0.5 * (v0 + v)
    others = scene.mass.sum() * np.array(scene.gravity) - scene.drag * dragged.sum(axis=0)
    left = kick * others - scene.mass @ (v - v0) / scene.dt
    # A pair's correction changes both momenta alike but for the rounding of n, dv, the shares and the
    # velocities; no contact is corrected more often than once an iteration.
    numbers = (v0, v, walls.correction, simulation.contacts().correction)
    largest = max(np.abs(array).max(initial=0.0) for array in numbers)
    corrections = (report.iterations + 1) * report.candidates
    rounding = corrections * 5.0 * EPS * 2.0 * scene.mass.max() * largest / scene.dt
    return wall_force, left, rounding


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("max_iterations", [1, 5, 100_000])
@pytest.mark.parametrize("radius_in", [0.0, 0.2])
def test_momentum_balance(radius_in: float, max_iterations: int, scheme: dict[str, str]) -> None:
    """It holds in every step, converged or not."""
    simulation = Simulation(settling(radius_in, max_iterations=max_iterations, **scheme))
    for _ in range(150):
        wall_force, left, rounding = step_and_balance(simulation)
        assert np.abs(left - wall_force).max() <= rounding
    assert np.abs(wall_force).max() > 0.0


def assert_weight_is_carried(simulation: Simulation) -> None:
    """The walls carry the weight in the next step, up to what the grains still move."""
    scene, v0 = simulation.scene, simulation.velocity
    weight = scene.mass.sum() * np.array(scene.gravity)
    wall_force, _, rounding = step_and_balance(simulation)
    change, speed = np.abs(simulation.velocity - v0), np.maximum(np.abs(v0), np.abs(simulation.velocity))
    moving = scene.mass @ change / scene.dt + scene.drag * speed.sum(axis=0)
    assert (moving <= 1e-4 * np.abs(weight).max()).all(), "it does not rest yet"
    assert (np.abs(wall_force - weight) <= moving + rounding).all()


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("radius_in", [0.0, 0.2])
def test_walls_carry_a_resting_pile(radius_in: float, scheme: dict[str, str]) -> None:
    simulation = Simulation(settling(radius_in, **scheme))
    simulation.run(steps=1500)
    assert_weight_is_carried(simulation)


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
