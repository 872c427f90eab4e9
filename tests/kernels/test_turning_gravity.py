"""Gravity that turns (eq. 31): closed forms, how scenes hold it, and what is refused."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from warpgrains import Recording, Scene, Segment, Simulation, analysis
from warpgrains.scene.gravity import TurningGravity
from warpgrains.scene.toml import parameters_text, read_parameters

G, RATE = complex(3.0, -9.0), -2.5
TURNING = {"vector": (G.real, G.imag), "rotate": RATE}


def grain(**changes: Any) -> Scene:
    """Return one grain in a wide domain, at rest at first."""
    fields = {"position": [[0.5, 0.25]], "radius": 0.25, "mass": 0.5, "radius_out": 90.0, "gravity": TURNING}
    return Scene(**{**fields, **changes})


@pytest.mark.parametrize(("scheme", "order"), [("text", 1.0), ("leapfrog", 2.0)])
@pytest.mark.parametrize(("turning", "rate"), [(RATE, 0.0), (RATE, 3.0), (0.0, 2.0), (0.0, 30.0)])
def test_free_flight_has_the_order_of_the_scheme(
    turning: float, rate: float, scheme: str, order: float
) -> None:
    """v = (v_0 - A) exp(-k t) + A exp(i w t), A = G / (k + i w), with drag at a rate k."""
    v0, end, turn = 1.0 + 0.5j, 0.2 if rate > 10.0 else 1.0, 1j * turning
    forced = G / (rate + turn)
    exact = (v0 - forced) * integral(-rate, end) + forced * integral(turn, end)
    given = {"velocity": [[v0.real, v0.imag]], "drag": 0.5 * rate, "scheme": scheme}
    given["gravity"] = {"vector": (G.real, G.imag), "rotate": turning}
    errors = []
    for steps in (100, 200):
        flight = Simulation(grain(dt=end / steps, **given))
        flight.advance(steps)
        moved = flight.position[0] - flight.scene.position[0]
        errors.append(abs(complex(*moved) - exact))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1)


def integral(rate: complex, time: float) -> complex:
    """Return that of exp(rate t)."""
    return (np.exp(rate * time) - 1.0) / rate if rate else time


@pytest.mark.parametrize("scheme", ["text", "leapfrog"])
def test_walls_carry_a_grain_at_rest(scheme: str) -> None:
    """A grain in a corner weighs on both walls with the components of m g, until g leaves the corner."""
    corner = [Segment((-5.0, 0.0), (5.0, 0.0)), Segment((0.75, -5.0), (0.75, 5.0))]
    turning = {"vector": (0.0, -8.0), "rotate": 1.0}
    scene = grain(walls=corner, scheme=scheme, tolerance=1e-13, gravity=turning)
    simulation = Simulation(scene)
    for step in range(1, 150):
        simulation.step()
        start = (step - 1) * scene.dt
        found = simulation.wall_contacts()
        if step > 1:
            assert found.force == pytest.approx(4.0 * np.array([np.cos(start), np.sin(start)]), rel=1e-12)
            assert found.wall[:, 1].tolist() == [2, 3]
    assert np.abs(simulation.position - scene.position).max() < 1e-14
    simulation.advance(30)  # past a quarter turn, g lifts it
    assert simulation.position[0, 1] > 0.25


def test_heights_and_energies_follow_gravity() -> None:
    scene = grain(gravity={"vector": (0.0, -8.0), "rotate": np.pi / 2.0}, drag=49.0, dt=0.01)
    simulation = Simulation(scene)
    simulation.advance(100)
    assert scene.gravity_at(simulation.time) == pytest.approx((8.0, 0.0))
    (x, _), now = simulation.position[0], analysis.snapshot(simulation)
    assert analysis.heights(now) == pytest.approx([-x])
    assert analysis.potential_energy(now) == pytest.approx(-0.5 * 8.0 * x)
    assert analysis.height_profile(now).velocity.any()


def test_a_scene_keeps_it(tmp_path: Path) -> None:
    """In text, copies and recordings; `vector` is that of the Earth by default, and 0 rad/s is constant."""
    scene = Scene.load("annulus", ["physics.gravity={rotate = 0.05}"])
    assert scene.gravity == TurningGravity((0.0, -9.81), 0.05)
    assert scene.summary()["gravity"] == "(0, -9.81) m/s2, turning at 0.05 rad/s"
    assert pickle.loads(pickle.dumps(scene)).gravity == scene.gravity
    assert scene.replace(drag=0.1).gravity == scene.gravity
    read = read_parameters(parameters_text(scene))
    assert scene.replace(gravity=read["gravity"]).gravity == scene.gravity
    Simulation(scene).run(steps=4, record=tmp_path / "run.usdc")
    assert Recording(tmp_path / "run.usdc").scene.gravity == scene.gravity
    constant = scene.replace(gravity={"vector": (1.0, 2.0), "rotate": 0.0})
    assert constant.gravity == (1.0, 2.0)
    assert constant.gravity_at(5.0) is constant.gravity
