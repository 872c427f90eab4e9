"""Voronoi cells between the walls: against freud's, against points at random, and against the whole."""

from dataclasses import replace

import freud
import numpy as np
import pytest
from moments import EPS, far_away, moment_of, random_moment

from warpgrains import Box, Disc, analysis

HULL = 1e4 * EPS
"""Coordinates of the hull are up to (10 R)^2; facets lose some eps of that, and corners are their slopes."""


@pytest.mark.parametrize("radius_in", [0.0, 0.3])
@pytest.mark.parametrize("count", [1, 2, 3, 7, 300])
def test_cells_fill_the_space_between_the_walls(count, radius_in):
    now = random_moment(radius_in, count=count, radius=[0.001, 0.02], seed=count)
    assert analysis.cell_areas(now).sum() == pytest.approx(np.pi * (1.0 - radius_in**2), rel=HULL)


BUMPY = {"roughness": {"radius": 0.01, "spacing": 0.05}}
ROUGH = {"top": BUMPY, "bottom": BUMPY | {"velocity": (0.03, 0.0)}}


@pytest.mark.parametrize(
    ("count", "periodic", "sides"),
    [
        (200, "", {}),
        (2, "", ROUGH),
        (2, "x", {}),
        (200, "x", ROUGH),
        (1, "y", {}),
        (50, "y", {}),
        (1, "xy", {}),
        (50, "xy", {}),
    ],
)
def test_cells_fill_a_box(count, periodic, sides):
    """Wherever its grains have gone, and around a disc on its left side that cuts cells on both."""
    box = Box((0.0, 1.2), (-0.4, 0.4), periodic=periodic, **sides)
    disc = Disc((0.05, 0.0), 0.1 if "x" in periodic else 0.04)
    places = np.random.default_rng(count).uniform((0.0, -0.39), (1.2, 0.39), (count, 2))
    places = places[~disc.covers(places) & ~disc.covers(places - (1.2, 0.0))]
    now = replace(moment_of(places, 0.001, domain=box, walls=[disc]), time=0.7)
    bumps = 2 * 24 * np.pi * 0.01**2 / 2.0 if sides else 0.0
    space = 1.2 * 0.8 - np.pi * disc.radius**2 - bumps
    assert now.container.region.area == pytest.approx(space, rel=64 * EPS)
    assert analysis.cell_areas(far_away(now)).sum() == pytest.approx(space, rel=HULL)


def test_cells_in_a_periodic_box_are_freuds():
    """To the rounding of its float32 coordinates, 6e-8 of a length of 1.2 m, times the height of a cell."""
    places = np.random.default_rng(2).uniform((0.0, 0.0), (1.2, 0.8), (300, 2))
    now = moment_of(places, 0.01, domain=Box((0.0, 1.2), (0.0, 0.8), periodic="xy"))
    voronoi = freud.locality.Voronoi()
    voronoi.compute((freud.box.Box(1.2, 0.8), np.column_stack([places - (0.6, 0.4), np.zeros(300)])))
    assert analysis.cell_areas(far_away(now)) == pytest.approx(voronoi.volumes, abs=6e-8)


def test_cells_of_unequal_discs_are_where_the_power_is_least():
    now = random_moment(0.3, count=30, radius=[0.02, 0.12], seed=1)
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (100_000, 2))
    points = points[(np.hypot(*points.T) < 1.0) & (np.hypot(*points.T) > 0.3)]
    power = ((points[:, np.newaxis] - now.position) ** 2).sum(axis=2) - now.scene.radius**2
    share = np.bincount(power.argmin(axis=1), minlength=now.n) / len(points)
    # a share of k points has a standard deviation of sqrt(p / k): five of them
    expected = analysis.cell_areas(now) / now.container.region.area
    assert (np.abs(share - expected) < 5.0 * np.sqrt(expected / len(points))).all()
