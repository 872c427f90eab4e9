"""Regions: areas in closed form and against points at random; sums over regions that fill the whole."""

from dataclasses import replace
from itertools import pairwise
from math import acos, dist, pi, sqrt
from typing import ClassVar

import numpy as np
import pytest
from moments import EPS, moment_of

from warpgrains import Disc, Scene, Simulation, analysis
from warpgrains.described import described
from warpgrains.scene import checks
from warpgrains.scene.annulus import Annulus
from warpgrains.scene.geometry import Circle
from warpgrains.scene.layouts import random
from warpgrains.scene.region import Region
from warpgrains.scene.wall import Wall, kind_of_wall
from warpgrains.scene.wall_kinds import WRITTEN_KINDS

INSIDE = [Disc((0.0, -0.6), 0.15), Disc((0.1, 0.1), 0.9, inside=True)]
KITE = [(-0.9, -0.8), (0.9, -0.7), (0.8, 0.9), (-0.7, 0.6)]


def of(position=((0.6, 0.0),), radius=0.02, **fields):
    return moment_of(position, radius, **{"radius_in": 0.3, **fields})


def cap(radius, height):
    """Return the area of a disc beyond a line at a distance from its center."""
    return radius**2 * acos(height / radius) - height * sqrt(radius**2 - height**2)


@pytest.mark.parametrize(
    ("region", "area"),
    [
        ({}, pi * 0.91),
        ({"angle": (0.3, 1.0), "distance": (0.5, 0.7)}, 0.35 * (0.49 - 0.25)),
        ({"angle": (-1.0, 4.0)}, 2.5 * 0.91),
        ({"angle": (0.0, 2.0 * pi)}, pi * 0.91),
        ({"below": -0.5}, cap(1.0, 0.5)),
        ({"below": -0.5, "angle": (-pi / 2, 0.0)}, cap(1.0, 0.5) / 2.0),
        ({"polygon": [(0.5, 0.1), (0.5, -0.1), (0.7, -0.1), (0.7, 0.1)]}, 0.04),
        ({"polygon": [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]}, pi * 0.91 / 4.0),
        ({"polygon": [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]}, pi * 0.91),
        ({"polygon": [(0, 0.5), (0, -0.5), (2, -0.5), (2, 0.5)], "x": (0.4, 0.5), "y": (-0.3, 0.9)}, 0.08),
    ],
)
def test_area_in_closed_form(region, area):
    found = analysis.region_of(of(), region)
    assert found.area == pytest.approx(area, rel=64 * EPS)


@pytest.mark.parametrize(
    "region",
    [
        {},
        {"x": (-0.5, 0.5)},
        {"angle": (-2.2, -1.0)},
        {"angle": (-2.0, 3.0), "y": (-0.7, 0.8)},
        {"polygon": KITE},
        {"polygon": KITE[::-1], "angle": (1.0, 5.0), "below": 0.3},
        {"below": "surface"},
    ],
)
def test_area_without_walls_is_that_of_points_at_random(region):
    position, radius = random(
        Region(Annulus(0.3, 1.0)),
        count=60,
        radius=[0.02, 0.03],
        seed=1,
        region={"y": [-0.9, 0.4]},
        walls=INSIDE,
    )
    found = analysis.region_of(of(position, radius, walls=INSIDE), region)
    share = found.area / 4.0
    deviation = sqrt(share * (1.0 - share) / 400_000)
    points = np.random.default_rng(3).uniform(-1.0, 1.0, (400_000, 2))
    assert found.contains(points).mean() == pytest.approx(share, abs=4.0 * deviation)
    assert 0.05 < found.area < 2.2


@kind_of_wall
class Post(Wall):
    """A kind of wall that fills an area, as a file of its own would add it."""

    kind: ClassVar[str] = "post"
    kind_number: ClassVar[int] = 9
    center: tuple[float, float] = described("Center [m].", check=checks.vector)
    middle = property(lambda self: self.center)
    numbers = property(lambda self: self.center)
    border = property(lambda self: Circle(*self.center, 0.1, False))

    def farthest(self, point):
        return dist(self.center, point)

    def side(self, position, radius):
        return Disc(self.center, 0.1).side(position, radius)


@pytest.mark.parametrize("steps", [0, 10])
def test_a_kind_of_wall_alone_decides_what_area_it_fills(steps, monkeypatch):
    monkeypatch.setitem(WRITTEN_KINDS, "post", Post)
    place, moves = (0.65, 0.0), {"velocity": (0.0, 0.5)}
    walls = Post(place, **moves), Disc(place, 0.1, **moves)
    post, disc = (replace(of(walls=[wall], position=[(-0.6, 0.0)]), steps=steps) for wall in walls)
    assert post.scene.area == disc.scene.area < post.scene.annulus.area
    assert analysis.packing_fraction(post) == analysis.packing_fraction(disc)
    beside = {"x": (0.6, 1.0), "y": (-0.1, 0.1)}
    assert analysis.region_of(post, beside).area == analysis.region_of(disc, beside).area < 0.065


@pytest.fixture(scope="module")
def settling():
    """A pile that still moves, with friction, on a disc."""
    walls = [Disc((0.0, -0.5), 0.15)]
    layout = {"count": 120, "radius": [0.02, 0.05], "region": {"y": [-0.8, 0.5]}, "walls": walls}
    position, radius = random(Region(Annulus(0.2, 1.0)), seed=2, **layout)
    fields = {"mass": 0.2, "radius_in": 0.2, "radius_out": 1.0, "friction": 0.3, "dt": 5e-3}
    simulation = Simulation(Scene(position=position, radius=radius, walls=walls, **fields))
    simulation.advance(60)
    return analysis.snapshot(simulation)


SECTORS = [{"angle": ends} for ends in pairwise((-2.5, -1.7, -1.3, 0.5, 2.0 * pi - 2.5))]
HALVES = [
    {"polygon": [(-9, -9), (0, -9), (0.1, 9), (-9, 9)]},
    {"polygon": [(0, -9), (9, -9), (9, 9), (0.1, 9)]},
]
LEVELS = [{"below": -0.8}, {"y": (-0.8, 9.0)}]


@pytest.mark.parametrize("parts", [SECTORS, HALVES, LEVELS])
def test_parts_add_up_to_the_whole(settling, parts):
    """Stress, grains, contacts and forces of regions that fill the space between the walls."""
    regions = [analysis.region_of(settling, part) for part in parts]
    area = np.array([region.area for region in regions])
    total = settling.scene.area
    assert area.sum() == pytest.approx(total, rel=64 * EPS)
    inside = np.array([analysis.grains_in(settling, part) for part in parts])
    assert (inside.sum(axis=0) == 1).all()
    assert inside.any(axis=1).sum() >= 2
    stress = sum(a * analysis.mean_stress(settling, part) for a, part in zip(area, parts, strict=True))
    assert stress / total == pytest.approx(analysis.mean_stress(settling), rel=1e-12)
    pressure = [analysis.pressure(settling, part) for part in regions]
    assert area @ pressure / total == pytest.approx(analysis.pressure(settling), rel=1e-12)
    filled = [analysis.packing_fraction(settling, part) for part in parts]
    # less than all grains, because in a step they overlap the tangents of walls
    whole = analysis.packing_fraction(settling, {}) * total
    assert area @ filled == pytest.approx(whole, rel=1e-12)
    assert whole == pytest.approx(pi * (settling.scene.radius**2).sum(), rel=1e-5)
    held = ~analysis.rattlers(settling)
    for without, counted in ((False, inside), (True, inside & held)):
        contacts = [analysis.coordination_number(settling, 0.0, without, part) for part in parts]
        whole = analysis.coordination_number(settling, without_rattlers=without)
        assert contacts @ counted.sum(axis=1) / counted.sum() == pytest.approx(whole, rel=1e-12)
    forces = [analysis.force_statistics(settling, part) for part in parts]
    assert sum(force.contacts for force in forces) == len(settling.force)
    assert max(force.largest for force in forces if force.contacts) == settling.force.max()
    fabric = sum(
        force.contacts * analysis.fabric_tensor(settling, part)
        for force, part in zip(forces, parts, strict=True)
        if force.contacts
    )
    assert fabric / len(settling.force) == pytest.approx(analysis.fabric_tensor(settling), rel=1e-12)


@pytest.mark.parametrize("profile", [analysis.height_profile, analysis.radial_profile])
def test_profiles_of_parts_add_up(settling, profile):
    """Packing fractions and velocities, weighted by the slices' areas in each part."""
    whole, found = profile(settling, 7, {}), [profile(settling, 7, part) for part in SECTORS]
    up, spaces = np.array([0.0, 1.0]), []
    for part in [{}, *SECTORS]:
        region = analysis.region_of(settling, part)
        slices = [
            region.between(up, *ends) if profile is analysis.height_profile else region.distances(*ends)
            for ends in pairwise(whole.edges)
        ]
        spaces.append([one.area for one in slices])
    assert np.sum(spaces, axis=1)[0] == pytest.approx(settling.scene.area, rel=1e3 * EPS)
    assert np.sum(spaces[1:], axis=0) == pytest.approx(np.array(spaces[0]), abs=1e3 * EPS)
    filled = [
        np.nan_to_num(one.packing_fraction * space) for one, space in zip(found, spaces[1:], strict=True)
    ]
    expected = whole.packing_fraction * spaces[0]
    assert sum(filled) == pytest.approx(expected, rel=1e-12)
    filling = analysis.packing_fraction(settling, {}) * settling.scene.area
    assert expected.sum() == pytest.approx(filling, rel=1e-12)
    weighted = sum(
        np.nan_to_num(one.velocity) * part[:, np.newaxis] for one, part in zip(found, filled, strict=True)
    )
    assert weighted == pytest.approx(np.nan_to_num(whole.velocity) * expected[:, np.newaxis], abs=1e-12)


@pytest.mark.parametrize("gravity", [(0.0, -9.81), (9.81, 0.0)])
@pytest.mark.parametrize("in_flight", [False, True])
def test_below_the_surface_of_steps(gravity, in_flight):
    """Layers of 4 and 8 grains: the region ends a diameter below the uppermost centers."""
    layers = [4] * 16 + [8] * 16  # between -0.32 and 0.32 m, in columns of two grains
    centers = [(0.02 * k - 0.31, -0.5 + 0.02 * one) for k, top in enumerate(layers) for one in range(top)]
    position = np.array(centers + [(0.1, 0.8)] * in_flight)
    pair = np.array([[k, k + 1] for k in range(len(centers) - 1)], np.int32)
    turn = np.eye(2) if gravity[0] == 0.0 else np.array([[0.0, 1.0], [-1.0, 0.0]])
    pile = of(position @ turn, 0.01, radius_in=0.0, radius_out=0.96, gravity=gravity)
    pile = replace(pile, pair=pair, force=np.ones(len(pair)), tangential_force=np.zeros(len(pair)))
    floor = {"y": (-0.51, 1.0)} if gravity[0] == 0.0 else {"x": (-1.0, 0.51)}
    region = analysis.region_of(pile, {"below": "surface", **floor})
    assert region.area == pytest.approx(0.32 * (0.05 + 0.13), rel=64 * EPS)
    points = np.array([(x, -0.5 + 0.02 * one + 0.001) for x in (-0.33, -0.2, 0.2, 0.33) for one in range(10)])
    assert region.contains(points @ turn).reshape(4, 10).sum(axis=1).tolist() == [0, 2, 6, 0]


def test_shares_of_circles_are_those_of_points_on_them():
    """With a polygon, a sector, discs, and the walls."""
    region = analysis.region_of(of(walls=INSIDE), {"polygon": KITE, "angle": (-2.5, 1.5)})
    center = np.random.default_rng(7).uniform(-1.0, 1.0, (60, 2))
    angle = 2.0 * pi * np.arange(4_000) / 4_000
    for r in (0.03, 0.2, 0.7):
        found = region.angles(center, np.full(60, r)) / (2.0 * pi)
        points = center[:, np.newaxis] + r * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        assert found == pytest.approx(region.contains(points).mean(axis=1), abs=20 / len(angle))  # of 20 arcs
