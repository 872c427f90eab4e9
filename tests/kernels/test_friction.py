"""Friction against the C reference, in every way to run, and against closed forms (MODEL.md, "Friction")."""

import closed_forms
import numpy as np
import pytest
from walled_scenes import cloud

from warpgrains import Scene, Simulation


@pytest.mark.parametrize("tangent_of_slope", [0.3, 0.8, 1.2, 2.0])
def test_disc_on_a_slope_rolls_or_slides(tangent_of_slope: float) -> None:
    """It rolls with 2/3 g sin(theta) if tan(theta) <= 3 mu, and else slides with g (sin - mu cos)."""
    slope, friction = np.arctan(tangent_of_slope), 0.3
    simulation = closed_forms.on_a_slope(tangent_of_slope, friction)
    expected = closed_forms.acceleration_on_a_slope(tangent_of_slope, friction)
    # velocities of the leapfrog are those half a step earlier
    assert simulation.velocity[0, 0] == pytest.approx(
        expected * (simulation.time - simulation.scene.dt / 2), rel=1e-6
    )
    carried, weight, rolls = simulation.wall_contacts(), 9.81 * np.cos(slope), tangent_of_slope <= 0.9
    assert carried.force == pytest.approx([weight], rel=1e-5)  # and v^2 / radius of the bowl
    assert carried.slides.tolist() == [not rolls]
    assert carried.tangential_force == pytest.approx(
        [9.81 * np.sin(slope) / 3.0 if rolls else friction * weight], rel=1e-5
    )


@pytest.mark.parametrize(("friction", "stands"), [(0.27, True), (0.265, False)])
def test_three_discs(friction: float, stands: bool) -> None:
    """One on two stands if mu >= tan(15 deg) = 0.26795; the slope of the bowl changes that by 1e-4."""
    simulation, fallen = closed_forms.three_discs(friction)
    assert (fallen < 1e-4) == stands
    assert stands or fallen > 1e-3
    if not stands:
        return
    contacts = simulation.contacts()
    assert contacts.pair.tolist() == [[0, 2], [1, 2]]
    half = 9.81 / 2.0  # of a weight; both contacts of a lower disc have the same tangential force
    assert contacts.force == pytest.approx([half, half], rel=1e-3)
    expected = half * np.tan(np.radians(15.0)) * np.array([1.0, -1.0])
    assert contacts.tangential_force == pytest.approx(expected, rel=1e-3)
    assert not contacts.slides.any()


def test_contacts_know_which_of_them_slide() -> None:
    """No tangential force exceeds Coulomb's bound, and those that reach it do so to rounding."""
    simulation = Simulation(cloud(max_iterations=2000))
    simulation.advance(150)
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
