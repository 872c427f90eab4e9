"""Regions: areas in closed form and against points at random; sums over regions that fill the whole."""

from dataclasses import replace
from functools import partial
from itertools import pairwise
from math import acos, pi, sqrt

import numpy as np
import pytest
from moments import EPS, moment_of
from walled_scenes import chained, on_circle

from warpgrains import Disc, analysis
from warpgrains.scene.layouts import random_layout
from warpgrains.space.outline import Part
from warpgrains.walls.annulus import Annulus

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


@pytest.fixture(scope="module")
def pile():
    """Grains clear of a disc, within a ring."""
    layout = {"count": 60, "radius": [0.02, 0.03], "seed": 1, "region": {"y": [-0.9, 0.4]}}
    made = of(*random_layout(Annulus(0.3, 1.0).space, **layout, walls=INSIDE), walls=INSIDE)
    assert made.scene.count_overlaps() == (0, 0, 0.0)
    return made


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
def test_areas_and_shares_of_circles_are_those_of_points(pile, region):
    """Areas of the region, and of what is in it of discs of all sizes anywhere."""
    found, rng = analysis.region_of(pile, region), np.random.default_rng(3)
    points = rng.uniform(-1.0, 1.0, (100_000, 2))
    share = found.area / 4.0
    # four standard deviations of a share of so many points, or five and one point
    deviation = np.sqrt(share * (1.0 - share) / len(points))
    assert found.contains(points).mean() == pytest.approx(share, abs=4.0 * deviation)
    assert 0.05 < found.area < 2.2
    center, circle = points[:20], on_circle(2.0 * pi * np.arange(2_000) / 2_000)
    disc = np.sqrt(rng.random((2_000, 1))) * circle
    for r in (0.03, 0.2, 0.7):
        along, inside = (center[:, np.newaxis] + r * place for place in (circle, disc))
        share = found.angles(center, np.full(20, r)) / (2.0 * pi)
        assert share == pytest.approx(found.contains(along).mean(axis=1), abs=20 / 2_000)  # of 20 arcs
        share = found.areas(center, np.full(20, r)) / (pi * r**2)
        deviation = 5.0 * np.sqrt(np.clip(share * (1.0 - share), 0.0, 1.0) / 2_000) + 1.0 / 2_000
        assert (np.abs(found.contains(inside).mean(axis=1) - share) <= deviation).all()
        assert r < 0.1 or ((share > 0.01) & (share < 0.99)).sum() > 5


def test_areas_of_discs_that_touch():
    """Walls and corners that only touch cut nothing, in any direction."""
    corner = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    turn = np.array([[np.cos(0.4), np.sin(0.4)], [-np.sin(0.4), np.cos(0.4)]])
    part = Part(0.2 * corner @ turn, ())
    touching = np.array([(0.1, 0.1), (-0.1, 0.1), (0.1, 0.0), (0.0, 0.1), (0.3, 0.0), (0.0, 0.0)]) @ turn
    found = part.areas(touching, np.array([0.1, 0.1, 0.1, 0.1, 0.1, 0.2]))
    assert found == pytest.approx(pi * np.array([0.01, 0.01, 0.01, 0.01, 0.0, 0.04]), abs=1e-15)
    depth = 1e-5  # by which a disc of radius 1 sticks out
    cap = np.arccos(1.0 - depth) - (1.0 - depth) * sqrt(depth * (2.0 - depth))
    square = Part(np.minimum(2.0 * corner, (2.0, 1.0 - depth)), ())
    assert square.areas(np.zeros((1, 2)), np.ones(1)) == pytest.approx(pi - cap, rel=64 * EPS)
    ring = Part(2.0 * corner, Annulus(0.5, 1.0).space.discs)
    along = on_circle(2.0 * pi * np.arange(16) / 16)
    for distance in (0.6, 0.9):
        assert ring.areas(distance * along, np.full(16, 0.1)) == pytest.approx(pi * 0.01, rel=1e-12)


SECTORS = [{"angle": ends} for ends in pairwise((-2.5, -1.7, -1.3, 0.5, 2.0 * pi - 2.5))]
HALVES = [
    {"polygon": [(-9, -9), (0, -9), (0.1, 9), (-9, 9)]},
    {"polygon": [(0, -9), (9, -9), (9, 9), (0.1, 9)]},
]
LEVELS = [{"below": 0.0}, {"y": (0.0, 9.0)}]


@pytest.fixture(scope="module")
def now(rolling):
    return analysis.snapshot(rolling)


@pytest.mark.parametrize("parts", [SECTORS, HALVES, LEVELS])
def test_parts_add_up_to_the_whole(now, parts):
    """Stress, grains, contacts and forces of regions that fill the space between the walls."""
    area = np.array([analysis.region_of(now, part).area for part in parts])
    assert area.sum() == pytest.approx(now.scene.area, rel=64 * EPS)
    inside = np.array([analysis.grains_in(now, part) for part in parts])
    assert (inside.sum(axis=0) == 1).all()
    assert inside.any(axis=1).sum() >= 2
    filled = analysis.packing_fraction(now, {}) * now.scene.area
    # less than all grains, because in a step they overlap the tangents of walls
    assert filled == pytest.approx(pi * (now.scene.radius**2).sum(), rel=1e-5)
    for measure in (partial(analysis.mean_stress, part="contacts"), analysis.packing_fraction):
        shares = sum(own * measure(now, part) for own, part in zip(area, parts, strict=True))
        assert shares / now.scene.area == pytest.approx(measure(now, {}), rel=1e-12)
    held = ~analysis.rattlers(now)
    for without, counted in ((False, inside), (True, inside & held)):
        contacts = [analysis.coordination_number(now, 0.0, without, part) for part in parts]
        whole = analysis.coordination_number(now, without_rattlers=without)
        assert contacts @ counted.sum(axis=1) / counted.sum() == pytest.approx(whole, rel=1e-12)
    forces = [analysis.force_statistics(now, part) for part in parts]
    assert sum(force.contacts for force in forces) == len(now.force)
    assert max(force.largest for force in forces if force.contacts) == now.force.max()
    fabrics = [np.nan_to_num(analysis.fabric_tensor(now, part)) for part in parts]
    fabric = sum(force.contacts * own for force, own in zip(forces, fabrics, strict=True))
    assert fabric / len(now.force) == pytest.approx(analysis.fabric_tensor(now), rel=1e-12)


@pytest.mark.parametrize("profile", [analysis.height_profile, analysis.radial_profile])
def test_profiles_of_parts_add_up(now, profile):
    """Packing fractions and velocities, weighted by the slices' areas in each part."""
    found, spaces = [profile(now, 5, part) for part in [{}, *SECTORS]], []
    for part in [{}, *SECTORS]:
        region, ends = analysis.region_of(now, part), pairwise(found[0].edges)
        if profile is analysis.height_profile:
            slices = [region.between(np.array([0.0, 1.0]), *of_slice) for of_slice in ends]
        else:
            slices = [region.distances(*of_slice) for of_slice in ends]
        spaces.append([one.area for one in slices])
    assert np.sum(spaces[0]) == pytest.approx(now.scene.area, rel=1e3 * EPS)
    assert np.sum(spaces[1:], axis=0) == pytest.approx(np.array(spaces[0]), abs=1e3 * EPS)
    filled = np.nan_to_num([one.packing_fraction for one in found]) * spaces
    assert filled[1:].sum(axis=0) == pytest.approx(filled[0], rel=1e-12)
    filling = analysis.packing_fraction(now, {}) * now.scene.area
    assert filled[0].sum() == pytest.approx(filling, rel=1e-12)
    weighted = np.nan_to_num([one.velocity for one in found]) * filled[..., np.newaxis]
    assert weighted[1:].sum(axis=0) == pytest.approx(weighted[0], abs=1e-12)


@pytest.mark.parametrize("in_flight", [False, True])
@pytest.mark.parametrize("turn", [np.eye(2), np.array([[0.0, 1.0], [-1.0, 0.0]])])
def test_below_the_surface_of_steps(in_flight, turn):
    """Layers of 4 and 8 grains in a box: the region ends a diameter below the uppermost centers."""
    layers = [4] * 16 + [8] * 16  # between -0.32 and 0.32 m, in columns of two grains
    centers = [(0.02 * k - 0.31, -0.5 + 0.02 * one) for k, top in enumerate(layers) for one in range(top)]
    position = np.array(centers + [(0.1, 0.8)] * in_flight)
    pair = np.array([[k, k + 1] for k in range(len(centers) - 1)], np.int32)
    box = np.array([(-0.32, 0.85), (-0.32, -0.51), (0.32, -0.51), (0.32, 0.85)])
    fields = {"radius_in": 0.0, "radius_out": 0.96, "walls": chained(box @ turn)}
    pile = of(position @ turn, 0.01, **fields, gravity=np.array([0.0, -9.81]) @ turn)
    pile = replace(pile, pair=pair, force=np.ones(len(pair)), tangential_force=np.zeros(len(pair)))
    region = analysis.region_of(pile, {"below": "surface"})
    assert region.area == pytest.approx(0.32 * (0.05 + 0.13), rel=64 * EPS)
    points = np.array([(x, -0.5 + 0.02 * one + 0.001) for x in (-0.33, -0.2, 0.2, 0.33) for one in range(10)])
    assert region.contains(points @ turn).reshape(4, 10).sum(axis=1).tolist() == [0, 2, 6, 0]
