"""The wall forces against the weight: what the walls take is what the grains lose."""

import numpy as np
import pytest

from warpgrains import Scene, Simulation
from warpgrains.arrays import FloatArray

EPS = np.finfo(float).eps


def settling(radius_in: float) -> Scene:
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
    )


def step_and_balance(simulation: Simulation) -> tuple[FloatArray, FloatArray, float]:
    """Advance by one step. Return the force on the walls, that of the motion, and how far they may round [N].

    All grains together: M (v - v_0) / dt = M g - drag v_0 - wall forces.
    """
    scene, x0, v0 = simulation.scene, simulation.position, simulation.velocity
    report = simulation.step()
    v, walls = simulation.velocity, simulation.wall_contacts()
    wall_force = walls.force @ (x0 / np.hypot(*x0.T)[:, None])
    motion_force = scene.mass @ (v - v0) / scene.dt + scene.drag * v0.sum(axis=0)
    # A pair's correction changes both momenta alike but for the rounding of n, dv, the shares and the
    # velocities; no contact is corrected more often than once an iteration.
    numbers = (v0, v, walls.correction, simulation.contacts().correction)
    largest = max(np.abs(array).max(initial=0.0) for array in numbers)
    corrections = (report.iterations + 1) * report.candidates
    rounding = corrections * 5.0 * EPS * 2.0 * scene.mass.max() * largest / scene.dt
    return wall_force, motion_force, rounding


@pytest.mark.parametrize("max_iterations", [1, 5, 100_000])
@pytest.mark.parametrize("radius_in", [0.0, 0.2])
def test_momentum_balance(radius_in: float, max_iterations: int) -> None:
    """It holds in every step, converged or not."""
    scene = settling(radius_in).replace(max_iterations=max_iterations)
    weight = scene.mass.sum() * np.array(scene.gravity)
    simulation = Simulation(scene)
    for _ in range(150):
        wall_force, motion_force, rounding = step_and_balance(simulation)
        assert np.abs(weight - motion_force - wall_force).max() <= rounding
    assert np.abs(wall_force).max() > 0.0


@pytest.mark.parametrize("radius_in", [0.0, 0.2])
def test_walls_carry_a_resting_pile(radius_in: float) -> None:
    """Together they carry its weight, up to what the grains still move."""
    simulation = Simulation(settling(radius_in))
    scene = simulation.scene
    weight = scene.mass.sum() * np.array(scene.gravity)
    simulation.run(steps=1500)
    v0 = simulation.velocity
    wall_force, _, rounding = step_and_balance(simulation)
    moving = scene.mass @ (np.abs(simulation.velocity - v0) / scene.dt) + scene.drag * np.abs(v0).sum(axis=0)
    assert (moving <= 1e-4 * np.abs(weight).max()).all(), "it does not rest yet"
    assert (np.abs(wall_force - weight) <= moving + rounding).all()
