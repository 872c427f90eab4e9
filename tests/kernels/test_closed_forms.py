"""Motions whose answer is known in closed form."""

from fractions import Fraction

import numpy as np
import pytest
from same_bits import at_annulus
from schemes import SCHEMES

from warpgrains import Scene, Simulation
from warpgrains.arrays import FloatArray

EPS = np.finfo(float).eps  # twice what one operation rounds by, so that higher orders are covered


def sideways(normal: FloatArray) -> FloatArray:
    return np.array([-normal[1], normal[0]])


def test_free_fall_with_drag() -> None:
    """v_k = w + (v_0 - w) q^k, x_k = x_0 + dt (k w + (v_0 - w) (q + ... + q^k)), q = 1 - dt drag / m."""
    x0, v0, g, mass, drag, dt, steps = (0.3, 5.0), (1.5, -0.5), (0.4, -9.81), 0.3, 0.7, 0.01, 150
    scene = Scene(
        position=[x0], velocity=[v0], radius=0.1, mass=mass, radius_out=90.0, gravity=g, drag=drag, dt=dt
    )
    fall = Simulation(scene)
    # A step rounds each part of the acceleration twice, their sum, its product with dt, and v; x likewise.
    # Errors of v shrink by q in every step.
    v_max = x_max = 20.0
    v_error = steps * EPS * (dt * (4.0 * drag / mass * v_max + 2.0 * 9.81) + v_max)
    x_error = steps * (EPS * (dt * v_max + x_max) + dt * v_error)
    q = 1 - Fraction(dt) * Fraction(drag) / Fraction(mass)
    for k in range(1, steps + 1):
        assert fall.step().contacts == 0
        for axis in range(2):
            start, v_start = Fraction(x0[axis]), Fraction(v0[axis])
            w = Fraction(mass) * Fraction(g[axis]) / Fraction(drag)
            v = w + (v_start - w) * q**k
            x = start + Fraction(dt) * (k * w + (v_start - w) * q * (1 - q**k) / (1 - q))
            assert abs(Fraction(fall.velocity[0, axis]) - v) <= v_error
            assert abs(Fraction(fall.position[0, axis]) - x) <= x_error


def test_nothing_acts() -> None:
    """Without walls near, drag and gravity, velocities stay as they are, and x_k = x_0 + k dt v."""
    rng = np.random.default_rng(0)
    n, dt, steps = 5, 0.01, 100
    x0, v = np.arange(1, n + 1)[:, None] * [3.0, 4.0], rng.normal(0.0, 0.5, (n, 2))
    scene = Scene(position=x0, velocity=v, radius=0.5, mass=2.0, radius_out=1e3, gravity=(0, 0), dt=dt)
    simulation = Simulation(scene)
    x_error = EPS * np.abs(x0).max()  # a step rounds once in x and once in the much smaller dt v
    for k in range(1, steps + 1):
        assert simulation.step().contacts == 0
        assert np.array_equal(simulation.velocity, v)
        assert np.abs(simulation.position - (x0 + k * dt * v)).max() <= (k + 1) * x_error


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize(
    ("position", "gravity", "sign"),
    [
        ((0.0, -1.75), (0.0, -9.81), 1.0),
        ((1.75, 0.0), (9.81, 0.0), 1.0),
        ((0.0, 0.75), (0.0, -9.81), -1.0),
        ((-0.75, 0.0), (9.81, 0.0), -1.0),
    ],
)
def test_wall_carries_a_grain(
    position: tuple[float, float], gravity: tuple[float, float], sign: float, scheme: dict[str, str]
) -> None:
    """A grain at rest on a wall weighs on it with m g, exactly: all other numbers are powers of two.

    In the leapfrog it is given half a kick first, and so is its wall.
    """
    place = {"position": [position], "radius": 0.25, "mass": 0.5, "radius_in": 0.5, "radius_out": 2.0}
    simulation = Simulation(Scene(**place, gravity=gravity, dt=1.0 / 128.0, **scheme))
    is_text = scheme["scheme"] == "text"
    for kick, iterations in ((1.0 if is_text else 0.5, 2), (1.0, 1 if is_text else 2), (1.0, 1), (1.0, 1)):
        report = simulation.step()
        assert (report.iterations, report.zeta, report.contacts) == (iterations, 0.0, 1)
        assert np.array_equal(simulation.position, [position])
        assert np.array_equal(simulation.velocity, [(0.0, 0.0)])
        assert at_annulus(simulation).correction[0] == sign * kick * 9.81 / 128.0
        assert at_annulus(simulation).force[0] == sign * kick * 0.5 * 9.81


@pytest.mark.parametrize("masses", [(1.0, 1.0), (3.0, 0.7), (1e3, 1e-3), (1e-6, 1.0)])
@pytest.mark.parametrize("angle", [0.0, 1.0, 4.0])
def test_collision_is_perfectly_inelastic_and_frictionless(masses: tuple[float, float], angle: float) -> None:
    """The first step just closes the gap, the second one stops the approach; nothing else changes."""
    mass, radius, gap, slip, dt = np.array(masses), 0.25, 0.004, 0.01, 0.01
    normal, middle = np.array([np.cos(angle), np.sin(angle)]), np.array([0.1, 0.2])
    v = np.array([2.0 * normal + slip * sideways(normal), -1.0 * normal])
    x = np.array([middle - radius * normal, middle + (radius + gap) * normal])
    scene = Scene(
        position=x, velocity=v, radius=radius, mass=mass, radius_out=9.0, gravity=(0, 0), dt=dt, tolerance=0.0
    )
    simulation = Simulation(scene)
    momentum, v_max, corrections = mass @ v, np.abs(v).max(), 0
    v_error = 8.0 * EPS * (1.0 / dt + v_max)  # a gap is the difference of lengths < 1 m
    opened = np.hypot(2.0 * radius, slip * dt) - 2.0 * radius
    for closed in (gap, opened):
        before = v[0] - v[1]
        corrections += simulation.step().iterations + 1
        v = simulation.velocity
        after, n = v[0] - v[1], simulation.contacts().normal[0]
        assert abs(after @ n - closed / dt) <= v_error
        assert abs((after - before) @ sideways(n)) <= v_error
        # A correction rounds n, dv <= 2 v_max, both shares of it, and both velocities.
        assert np.abs(mass @ v - momentum).max() <= corrections * 5.0 * EPS * mass.sum() * v_max
