"""Voronoi cells between the walls: against scipy's, against points at random, and against the whole."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull, Voronoi

from warpgrains import Scene, analysis
from warpgrains.scene.layouts import lattice, random
from warpgrains.scene.state import first_state
from warpgrains.scene.walls import Annulus

EPS = np.finfo(np.float64).eps
HULL = 1e4 * EPS
"""Coordinates of the hull are up to (10 R)^2; facets lose some eps of that, and corners are their slopes."""


def scene_of(placement, walls=Annulus(0.3, 1.0)):  # noqa: B008
    position, radius = placement
    return Scene(position=position, radius=radius, mass=1.0, **walls._asdict())


def areas(scene):
    found = analysis.cell_areas(analysis.snapshot(scene, first_state(scene)))
    assert found.shape == (scene.n,)
    return found


@pytest.mark.parametrize("radius_in", [0.0, 0.3])
@pytest.mark.parametrize("count", [1, 2, 3, 7, 300])
def test_cells_fill_the_space_between_the_walls(count, radius_in):
    walls = Annulus(radius_in, 1.0)
    scene = scene_of(random(walls, count=count, radius=[0.001, 0.02], seed=count), walls)
    assert areas(scene).sum() == pytest.approx(np.pi * (1.0 - radius_in**2), rel=HULL)


def test_cells_of_equal_discs_are_scipys():
    """Away from the walls, where no cell is cut."""
    scene = scene_of(random(Annulus(0.0, 1.0), count=400, radius=0.01, seed=3), Annulus(0.0, 1.0))
    found, voronoi = areas(scene), Voronoi(scene.position)
    compared = 0
    for grain, region in enumerate(voronoi.point_region):
        corners = voronoi.vertices[voronoi.regions[region]]
        if -1 in voronoi.regions[region] or (np.hypot(*corners.T) > 1.0).any():
            continue
        assert found[grain] == pytest.approx(ConvexHull(corners).volume, rel=HULL / 0.01)
        compared += 1
    assert compared > 300


def test_cells_of_unequal_discs_are_where_the_power_is_least():
    scene = scene_of(random(Annulus(0.3, 1.0), count=30, radius=[0.02, 0.12], seed=1))
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (400_000, 2))
    points = points[(np.hypot(*points.T) < 1.0) & (np.hypot(*points.T) > 0.3)]
    power = ((points[:, np.newaxis] - scene.position) ** 2).sum(axis=2) - scene.radius**2
    share = np.bincount(power.argmin(axis=1), minlength=scene.n) / len(points)
    # a share of k points has a standard deviation of sqrt(p / k): five of them
    expected = areas(scene) / scene.annulus.area
    assert (np.abs(share - expected) < 5.0 * np.sqrt(expected / len(points))).all()


def test_cells_that_meet_at_the_origin():
    """Of a square lattice about it, in which all cells but the outermost are squares."""
    place = [(0.04 * i - 0.18, 0.04 * j - 0.1) for i in range(10) for j in range(6)]
    walls = Annulus(0.0, 1.0)
    found = areas(scene_of((np.array(place), 0.02), walls)).reshape(10, 6)
    assert found[1:-1, 1:-1] == pytest.approx(0.04**2, rel=HULL / 0.04**2)
    assert found.sum() == pytest.approx(np.pi, rel=HULL)


def test_cells_of_a_lattice_are_hexagons():
    walls = Annulus(0.0, 1.0)
    scene = scene_of(lattice(walls, radius=0.05, spacing=2.0), walls)
    found = analysis.local_packing_fractions(analysis.snapshot(scene, first_state(scene)))
    inner = np.hypot(*scene.position.T) < 0.8
    assert inner.sum() > 100
    assert found[inner] == pytest.approx(np.pi / np.sqrt(12.0), rel=HULL / 0.05**2)
