"""Contacts that bounce (35): impacts of pairs, rows of grains, energy, and the list's proof."""

from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from moments import energy_balance
from schemes import SCHEMES

from warpgrains import Box, Scene, Segment, Simulation, random_layout
from warpgrains.analysis import kinetic_energy
from warpgrains.scene.fields import METHODS

EPS = np.finfo(float).eps
FREE: dict[str, Any] = {"radius_out": 9.0, "gravity": (0.0, 0.0), "dt": 1e-3, "tolerance": 0.0}
FLOOR = Segment((-5.0, 0.0), (5.0, 0.0))


def row(velocity: list[float], gap: float, **fields: Any) -> Scene:
    """Return grains along x, of these velocities, a gap [m] apart."""
    x = (0.2 + gap) * np.arange(len(velocity)) - 0.3
    position, v = (np.stack([own, np.zeros(len(velocity))], axis=1) for own in (x, np.array(velocity)))
    return Scene(**{"position": position, "velocity": v, "radius": 0.1, "mass": 0.5, **FREE, **fields})


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize(("e", "mu"), [(0.0, 0.2), (0.3, 0.2), (1.0, 0.2), (1.0, 0.5)])
@pytest.mark.parametrize("masses", [(1.0, 1.0), (1e-6, 1.0)])
def test_unlike_discs_that_meet_obliquely(
    masses: tuple[float, float], e: float, mu: float, scheme: dict[str, str]
) -> None:
    """They part at e vn, and slip by 3 min(mu (1 + e) vn, vt / 3) less; those of e = 0 touch already."""
    mass, radius, n = np.array(masses), np.array([0.1, 0.25]), np.array([0.6, 0.8])
    v, spin, t = np.array([[2.0, 1.0], [-1.0, 0.5]]), np.array([30.0, 8.0]), np.array([-0.8, 0.6])
    position = [(0.0, 0.0), (0.35 + 5e-4 * (e > 0.0)) * n]
    laws = {"restitution": e, "friction": mu}
    grains = {"position": position, "velocity": v, "spin": spin, "radius": radius, "mass": mass}
    simulation = Simulation(Scene(**grains, **laws, **FREE | scheme))
    simulation.advance(2)
    reduced, vn, rim = mass.prod() / mass.sum(), (v[0] - v[1]) @ n, radius * spin
    dv = (1.0 + e) * vn
    dvt = min(mu * dv, ((v[0] - v[1]) @ t + rim.sum()) / 3.0)
    assert (dvt < mu * dv) == (mu == 0.5)
    impulse = reduced * (dv * n + dvt * t)
    expected = v + np.outer([-1.0, 1.0], impulse) / mass[:, np.newaxis]
    largest = np.abs([*v.ravel(), *expected.ravel()]).max() + (0.1 / FREE["dt"] if e == 0.0 else 0.0)
    rounding = 20.0 * EPS * largest  # of gap / dt, too, if it counts
    assert np.abs(simulation.velocity - expected).max() <= rounding
    assert np.abs(radius * simulation.spin - (rim - 2.0 * reduced * dvt / mass)).max() <= rounding


def test_slow_contacts_and_those_at_rest_do_not_bounce() -> None:
    for speed, least, after in ((1.0, 0.99, -0.5), (1.0, 1.0, 0.0), (0.0, 0.0, 0.0)):
        simulation = Simulation(row([speed, 0.0], 0.0, restitution=0.5, restitution_speed=least))
        simulation.step()
        assert abs(-np.diff(simulation.velocity[:, 0])[0] - after) <= 4.0 * EPS


@pytest.mark.parametrize("k", [1, 4])
def test_grains_in_touch_leave_together(k: int) -> None:
    """A grain of speed v returns from k at rest at v (k - 1) / (k + 1) for e = 1, with all the energy."""
    simulation = Simulation(row([1.0] + [0.0] * k, 0.0, restitution=1.0, tolerance=1e-14))
    assert simulation.step().converged
    expected = np.array([(1.0 - k) / (1.0 + k)] + [2.0 / (1.0 + k)] * k)
    # an error of eta a contact is one of at most k^2 eta in a row of k
    assert np.abs(simulation.velocity[:, 0] - expected).max() <= k**2 * 1e-14 + 8.0 * EPS
    assert kinetic_energy(simulation) == pytest.approx(0.25, rel=1e-12, abs=0.0)


def test_grains_apart_hand_on_the_speed() -> None:
    """Newton's cradle: each is hit in a step of its own, up to the wall, and back again, to the bit."""
    simulation = Simulation(row([1.0, 0.0, 0.0, 0.0], 1.5e-2, restitution=1.0, dt=2.0**-7, radius_out=1.0))
    met = set()
    for _ in range(500):
        simulation.step()
        speed = simulation.velocity[:, 0]
        assert sorted(np.abs(speed).tolist()) == [0.0, 0.0, 0.0, 1.0]
        met.add((int(np.abs(speed).argmax()), bool(speed.sum() > 0.0)))
    assert len(met) == 8


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_ball_that_loses_nothing_keeps_its_energy(scheme: dict[str, str]) -> None:
    """m (v^2 / 2 - g . x + dt g . v / 2), for 20 bounces and more."""
    g, dt, y = -9.81, 1.0 / 128.0, 0.30123
    scene = Scene(position=[(0.0, y)], radius=0.1, mass=1.0, walls=[FLOOR], restitution=1.0, **FREE)
    simulation = Simulation(scene.replace(gravity=(0.0, g), dt=dt, **scheme))
    kept, bounces, steps = [], 0, 1300
    for _ in range(steps):
        before = simulation.velocity[0, 1]
        simulation.step()
        v, x = simulation.velocity[0, 1].item(), simulation.position[0, 1].item()
        bounces += before < 0.0 < v
        kept.append(0.5 * v * v - g * x + 0.5 * dt * g * v)
    assert bounces > 20
    # a step rounds the sum, at most 6 J, a few times; each bounce takes v to -v
    assert np.ptp(kept) <= steps * 4.0 * EPS * 6.0


@pytest.mark.parametrize(("e", "grows"), [(0.0, False), (1.0, True)])
def test_energy_may_grow_with_friction(e: float, grows: bool) -> None:
    """Kane's paradox, where a grain meets a heavy one and the floor at once; the energy balance says so."""
    grains = {"position": [(0.0, 0.1), (0.16, 0.22)], "velocity": [(1.0, -1.0), (0.0, 0.0)]}
    grains |= {"spin": [12.0, 0.0], "radius": 0.1, "mass": [1.0, 10.0]}
    how = FREE | {"max_iterations": 1000, "tolerance": 1e-13}
    simulation = Simulation(Scene(**grains, walls=[FLOOR], friction=0.8, restitution=e, **how))
    before, balance = kinetic_energy(simulation), energy_balance(simulation, 1)
    gained = kinetic_energy(simulation) - before
    assert (gained > 0.0) == grows
    assert abs(gained + balance.contact_loss) <= 100.0 * EPS * (before + abs(gained))


def test_grains_without_room_to_bounce_are_named() -> None:
    """A grain must leave one wall at 1 m/s and must not reach the next, 1 mm away, in a step of 10 ms."""
    walls = [Segment((-1.0, y), (1.0, y)) for y in (0.0, 0.201)]
    fields: dict[str, Any] = {**FREE, "dt": 0.01, "max_iterations": 50}
    scene = Scene(position=[(0.0, 0.1)], velocity=[(0.0, -1.0)], radius=0.1, mass=1.0, walls=walls, **fields)
    later = replace(Simulation(scene).state(), steps=1)  # in the first step it would not bounce
    simulation = Simulation(scene, state=later, restitution=1.0)
    assert not simulation.step().converged
    assert simulation.infeasible_grains() == (0,)
    assert Simulation(scene, state=later, restitution=0.1).step().converged


@pytest.mark.parametrize("e", [0.5, 1.0])
@pytest.mark.parametrize("fraction", [0.3, 0.75])
def test_the_first_step_gains_no_energy(fraction: float, e: float) -> None:
    """Grains placed at random part from places that they cannot have come from; the scene says so."""
    n = 100
    side = (n * np.pi / 4.0 / fraction) ** 0.5
    shut = 0
    for seed, periodic in enumerate(("", "x", "xy") * (4 if fraction < 0.5 else 1)):
        box = Box((0.0, side), (0.0, side), periodic=periodic)
        position, radius = random_layout(box.space, radius=0.5, count=n, seed=seed)
        fields: dict[str, Any] = {"velocity": np.random.default_rng(seed).normal(size=(n, 2))}
        fields |= {"gravity": (0.0, 0.0), "tolerance": 1e-10, "max_iterations": 100_000}
        scene = Scene(
            position=position, radius=radius, mass=1.0, domain=box, restitution=e, dt=0.01, **fields
        )
        part = not scene.bounces_at_start
        assert scene.replace(velocity=0.0 * scene.velocity).bounces_at_start
        shut += part
        with pytest.warns(UserWarning, match="nothing bounces") if part else nullcontext():
            simulation = Simulation(scene)
        before, report = kinetic_energy(simulation), simulation.step()
        # velocities are those of free ones that differ by the residual, at each of at most 6 n contacts
        off = report.residual * 6.0 * n * np.abs(scene.velocity).max()
        assert kinetic_energy(simulation) <= before + off + n * 4.0 * EPS * before
    assert shut > 0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("start", [[-0.1, 0.1], [0.85]], ids=["pair", "wall"])
def test_contacts_are_listed_that_only_the_velocity_before_the_step_closes(
    start: list[float], method: str
) -> None:
    """Drag takes 97 % of 12 m/s in a step, so that no gap of 0.1 m would close, and yet grains bounce."""
    position = np.stack([start, np.zeros(len(start))], axis=1)
    fields: dict[str, Any] = FREE | {"dt": 0.01, "radius_out": 1.0, "tolerance": 1e-9, "method": method}
    velocity = -12.0 * np.sign(position) if len(start) > 1 else [(12.0, 0.0)]
    scene = Scene(position=position, velocity=velocity, radius=0.05, mass=1.0, drag=97.0, **fields)
    simulation = Simulation(scene, restitution=0.5)
    simulation.step()
    assert simulation.velocity[:, 0] == pytest.approx(-6.0 * np.sign(scene.velocity[:, 0]), abs=1e-8)
