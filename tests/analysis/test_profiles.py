"""Profiles and the radial distribution: closed forms, totals, and freud."""

import numpy as np
import pytest
from moments import EPS, moment_of

from warpgrains import analysis
from warpgrains.scene.annulus import Annulus
from warpgrains.scene.layouts import random
from warpgrains.scene.region import Region


@pytest.fixture(scope="module")
def scattered():
    """Centres anywhere between the walls; overlaps do not matter."""
    rng = np.random.default_rng(4)
    position = rng.uniform(-1.0, 1.0, (4000, 2))
    rho = np.hypot(*position.T)
    position = position[(rho > 0.301) & (rho < 0.999)]
    velocity = rng.normal(0.0, 2.0, position.shape)
    return moment_of(position, 0.001, radius_in=0.3, velocity=velocity)


def test_radial_distribution_of_two_and_of_one():
    two = moment_of([[0.5, 0.0], [0.61, 0.0]])
    found = analysis.radial_distribution(two, bins=10, reach=0.2)
    assert found.pairs.tolist() == [0, 0, 0, 0, 0, 1, 0, 0, 0, 0]
    single = analysis.radial_distribution(moment_of([[0.5, 0.0]]))
    assert not single.g.any()


@pytest.mark.parametrize("profile", [analysis.height_profile, analysis.radial_profile])
def test_velocity_of_a_shear_and_of_a_rigid_rotation(profile):
    """Which have none along the profile; a rotation has no temperature."""
    position, radius = random(Region(Annulus(0.3, 1.0)), count=2000, radius=0.005, seed=5)
    velocity = np.column_stack([3.0 * position[:, 1], np.zeros(len(position))])
    if rotates := profile is analysis.radial_profile:
        velocity = 3.0 * np.stack([-position[:, 1], position[:, 0]], axis=1)
    found = profile(moment_of(position, radius, radius_in=0.3, velocity=velocity), bins=10)
    middle = 0.5 * (found.edges[1:] + found.edges[:-1])
    assert np.abs(found.velocity[:, 0]).max() <= (64 * EPS if rotates else 0.0)
    half = np.diff(found.edges)[0] / 2.0 + 0.005  # where in the slice the grains are, or reach into it from
    across = found.velocity[:, 1] * (1.0 if rotates else -1.0)
    assert np.abs(across - 3.0 * middle).max() < 3.0 * half
    assert not rotates or found.temperature.max() < 0.5 * (3.0 * half) ** 2


def test_temperature_of_random_velocities(scattered):
    """<v_x^2> = 4 m2/s2; the mean of k grains is known to about sqrt(1 / k) of itself."""
    assert analysis.granular_temperature(scattered) == pytest.approx(4.0, rel=5.0 / np.sqrt(scattered.n))
    found = analysis.radial_profile(scattered, bins=4)
    assert found.temperature == pytest.approx(4.0, rel=5.0 / np.sqrt(scattered.n / 10))


def test_empty_slices_have_no_mean():
    found = analysis.height_profile(moment_of([[0.0, -0.8]], 0.05), bins=4)
    assert found.packing_fraction[1:].tolist() == [0.0, 0.0, 0.0]
    assert np.isnan(found.velocity[1:]).all()
    assert found.packing_fraction[0] > 0.0
