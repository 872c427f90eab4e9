"""Friction and resistance to rolling: closed forms, and the laws in NumPy (MODEL.md, "Friction")."""

import closed_forms
import numpy as np
import pytest
from walled_scenes import ROLLING, cloud

from warpgrains import Scene, Simulation


@pytest.mark.parametrize(
    ("tangent_of_slope", "friction", "rolling"),
    [
        *((tangent, 0.3, 0.0) for tangent in (0.3, 0.8, 1.2, 2.0)),
        *((tangent, 0.6, 0.2) for tangent in (0.19, 0.21, 1.3, 1.5)),
        *((tangent, 0.3, 2.0) for tangent in (0.29, 0.4)),
    ],
)
def test_disc_on_a_slope(tangent_of_slope: float, friction: float, rolling: float) -> None:
    """It rests, rolls with 2/3 g (sin - mu_r cos), or slides; the moment is at its bound where it rolls."""
    simulation = closed_forms.on_a_slope(tangent_of_slope, friction, rolling)
    expected = closed_forms.acceleration_on_a_slope(tangent_of_slope, friction, rolling)
    # velocities of the leapfrog are those half a step earlier
    speed = expected * (simulation.time - simulation.scene.dt / 2)
    assert simulation.velocity[0, 0] == pytest.approx(speed, rel=1e-6, abs=1e-9)
    slope, turns = np.arctan(tangent_of_slope), tangent_of_slope > rolling
    carried, kept, weight = simulation.wall_contacts(), simulation.state().corrections, 9.81 * np.cos(slope)
    assert carried.force == pytest.approx([weight], rel=1e-5)  # and v^2 / radius of the bowl
    slides = tangent_of_slope > (3.0 * friction - 2.0 * rolling if turns else friction)
    assert carried.slides.tolist() == [slides]
    held = friction * weight if slides else 9.81 * np.sin(slope) - expected
    assert carried.tangential_force == pytest.approx([held], rel=1e-5)
    bound = rolling * kept.wall_correction
    assert not rolling or (np.abs(kept.wall_rolling) == pytest.approx(bound, rel=1e-9)) == turns
    assert (abs(simulation.spin[0]) > 0.01) == turns
    assert (
        slides or not turns or simulation.spin[0] == pytest.approx(-simulation.velocity[0, 0] / 0.5, rel=1e-6)
    )


def test_three_discs() -> None:
    """One on two stands if mu >= tan(15 deg) = 0.26795; the slope of the bowl changes that by 1e-4."""
    simulation, fallen = closed_forms.three_discs(0.27)
    assert fallen < 1e-4
    contacts, half = simulation.contacts(), 9.81 / 2.0  # of a weight
    assert contacts.pair.tolist() == [[0, 2], [1, 2]]
    assert contacts.force == pytest.approx([half, half], rel=1e-3)
    # both contacts of a lower disc have the same tangential force
    expected = half * np.tan(np.radians(15.0)) * np.array([1.0, -1.0])
    assert contacts.tangential_force == pytest.approx(expected, rel=1e-3)
    assert not contacts.slides.any()


@pytest.mark.parametrize("method", ["gauss-seidel", "accelerated"])
def test_rolling_corrections_turn_grains_and_solve_their_law(method: str) -> None:
    """Eqs. 37 and 38 in NumPy: spins are those of the corrections, and no residual is above eta."""
    common = {"method": method, "stop": "residual", "tolerance": 1e-4, "max_iterations": 3000}
    simulation = Simulation(cloud(spin_drag=0.0, **ROLLING, **common))
    simulation.advance(99)
    before, report = simulation.spin.copy(), simulation.step()
    assert report.converged
    scene, kept = simulation.scene, simulation.state().corrections
    (i, j), (grain, wall), r, m = kept.pair.T, kept.wall.T, scene.radius, scene.mass
    share, part = m[j] / (m[i] + m[j]), r[j] / (r[i] + r[j])
    spin = np.array([scene.angular_velocity_out, scene.angular_velocity_in, 0.0, 0.0])[wall]
    rim, turned = r * simulation.spin, np.zeros(scene.n)
    np.add.at(turned, i, 2.0 * share * (kept.pair_friction + part * kept.pair_rolling))
    np.add.at(turned, j, 2.0 * (1.0 - share) * (kept.pair_friction - (1.0 - part) * kept.pair_rolling))
    np.add.at(turned, grain, 2.0 * (kept.wall_friction + kept.wall_rolling))
    assert np.abs(r * before - turned - rim).max() <= 1e-13  # rim speeds up to 5 m/s, of some 10 sums
    compliance = 2.0 * (part**2 * share + (1.0 - part) ** 2 * (1.0 - share))
    rolls = part * rim[i] - (1.0 - part) * rim[j], rim[grain] - r[grain] * spin
    for vr, k, dv, dvr, mu in (
        (rolls[0], compliance, kept.pair_correction, kept.pair_rolling, scene.rolling_friction),
        (rolls[1], 2.0, kept.wall_correction, kept.wall_rolling, scene.wall_rolling_friction),
    ):
        left = k * np.abs(np.clip(dvr + vr / k, -mu * dv, mu * dv) - dvr)
        assert left.max() <= np.max(1.0 + k * mu) * report.residual  # a = dv_c + e_c in (38)
        held = np.abs(dvr) < (1.0 - 1e-6) * mu * dv
        assert held.any()
        assert not held.all()


def test_contacts_know_which_of_them_slide() -> None:
    """No tangential force exceeds Coulomb's bound, and those that reach it do so to rounding."""
    simulation = Simulation(cloud(max_iterations=2000))
    simulation.advance(100)
    for contacts, friction in ((simulation.contacts(), 0.5), (simulation.wall_contacts(), 0.3)):
        share = np.abs(contacts.tangential_force) / (friction * contacts.force)
        assert share.max() <= 1.0 + 1e-14
        assert contacts.slides.any()
        assert not contacts.slides.all()
        assert (share[contacts.slides] >= 1.0 - 1e-14).all()
        assert (share[~contacts.slides] < 1.0 - 1e-12).all()
    smooth = Simulation(Scene.load("annulus"))
    smooth.advance(100)
    for carried in (smooth.contacts(), smooth.wall_contacts()):
        assert carried.slides.all()
        assert not carried.tangential_force.any()
