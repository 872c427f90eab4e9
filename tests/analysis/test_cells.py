"""Voronoi cells between the walls: against scipy's, against points at random, and against the whole."""

import numpy as np
import pytest
from moments import EPS, moment_of

from warpgrains import analysis
from warpgrains.scene.annulus import Annulus
from warpgrains.scene.layouts import random

HULL = 1e4 * EPS
"""Coordinates of the hull are up to (10 R)^2; facets lose some eps of that, and corners are their slopes."""


@pytest.mark.parametrize("radius_in", [0.0, 0.3])
@pytest.mark.parametrize("count", [1, 2, 3, 7, 300])
def test_cells_fill_the_space_between_the_walls(count, radius_in):
    walls = Annulus(radius_in, 1.0)
    now = moment_of(*random(walls, count=count, radius=[0.001, 0.02], seed=count), radius_in=radius_in)
    assert analysis.cell_areas(now).sum() == pytest.approx(np.pi * (1.0 - radius_in**2), rel=HULL)


def test_cells_of_unequal_discs_are_where_the_power_is_least():
    now = moment_of(*random(Annulus(0.3, 1.0), count=30, radius=[0.02, 0.12], seed=1), radius_in=0.3)
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (400_000, 2))
    points = points[(np.hypot(*points.T) < 1.0) & (np.hypot(*points.T) > 0.3)]
    power = ((points[:, np.newaxis] - now.position) ** 2).sum(axis=2) - now.scene.radius**2
    share = np.bincount(power.argmin(axis=1), minlength=now.n) / len(points)
    # a share of k points has a standard deviation of sqrt(p / k): five of them
    expected = analysis.cell_areas(now) / now.scene.annulus.area
    assert (np.abs(share - expected) < 5.0 * np.sqrt(expected / len(points))).all()


def test_cells_that_meet_at_the_origin():
    """Of a square lattice about it, in which all cells but the outermost are squares."""
    place = [(0.04 * i - 0.18, 0.04 * j - 0.1) for i in range(10) for j in range(6)]
    found = analysis.cell_areas(moment_of(place)).reshape(10, 6)
    assert found[1:-1, 1:-1] == pytest.approx(0.04**2, rel=HULL / 0.04**2)
    assert found.sum() == pytest.approx(np.pi, rel=HULL)
