"""Where grains start: between the walls, clear of each other, the same on every call."""

from functools import partial

import numpy as np
import pytest

from warpgrains import Box, Disc, Scene
from warpgrains.scene.annulus import Annulus
from warpgrains.scene.layouts import column, lattice, random, rows
from warpgrains.scene.placing import place_at_random
from warpgrains.scene.region import Region


def overlaps(placement, radius_in, radius_out):
    position, radius = placement
    scene = Scene(position=position, radius=radius, mass=1.0, radius_in=radius_in, radius_out=radius_out)
    return scene.count_overlaps()


def test_rows_as_wide_as_the_outer_wall():
    position, radius = rows(Region(Annulus(0.2, 1.0)), count=60, radius=0.05)
    heights = np.unique(position[:, 1])
    assert np.array_equal(heights, np.arange(len(heights)) * 0.05 * 2.5 + 2.0 * 0.05 + 0.2)
    lowest = position[position[:, 1] == heights[0], 0]
    assert len(lowest) == 1 + 2 * np.floor(np.sqrt(0.95**2 - 0.3**2) / 0.125)
    assert np.allclose(np.diff(lowest), 0.125, rtol=0, atol=1e-15)
    assert overlaps((position, radius), 0.2, 1.0) == (0, 0, 0.0)


def test_rows_wider_than_the_count():
    position, _ = rows(Region(Annulus(0.5, 2.0)), count=2, radius=0.1, columns=5)
    assert np.array_equal(position, rows(Region(Annulus(0.5, 2.0)), count=15, radius=0.1, columns=5)[0][:2])
    assert len(rows(Region(Annulus(0.5, 2.0)), count=2, radius=0.1, columns=10**9)[0]) == 2


def test_lattice_fills_from_the_bottom():
    filled, _ = lattice(Region(Annulus(0.3, 1.0)), radius=0.05)
    position, radius = lattice(Region(Annulus(0.3, 1.0)), radius=0.05, count=50)
    assert np.array_equal(position, filled[:50])
    assert (np.diff(filled[:, 1]) >= 0.0).all()
    assert overlaps((filled, np.full(len(filled), 0.05)), 0.3, 1.0) == (0, 0, 0.0)
    dense = len(filled) * 0.05**2 / (1.0 - 0.3**2)
    assert dense > 0.7
    assert len(radius) == 50


def test_lattice_fills_the_origin():
    position, _ = lattice(Region(Annulus(0.0, 0.25 + 0.5 * 3.0**0.5)), radius=0.25, spacing=2.0)
    assert (position == 0.0).all(axis=1).sum() == 1


def test_random_is_the_same_for_the_same_seed():
    arguments = {"count": 200, "radius": [0.01, 0.05]}
    first, again, other = (random(Region(Annulus(0.3, 1.0)), seed=seed, **arguments) for seed in (3, 3, 4))
    assert np.array_equal(first[0], again[0])
    assert np.array_equal(first[1], again[1])
    assert not np.array_equal(first[0], other[0])
    assert first[1].min() >= 0.01
    assert first[1].max() <= 0.05
    assert overlaps(first, 0.3, 1.0) == (0, 0, 0.0)


def one_after_the_other(walls, radius, generator):
    """What `place_at_random` returns, by a plain loop over all discs before."""
    position = np.full((len(radius), 2), np.nan)
    placed = []
    for i in np.argsort(-radius, kind="stable"):
        while np.isnan(position[i, 0]):
            x = walls.radius_out * (2.0 * generator.random(2) - 1.0)
            d, reach = position[placed] - x, radius[placed] + radius[i]
            clear = (d[:, 0] * d[:, 0] + d[:, 1] * d[:, 1] >= reach * reach).all()
            if clear and walls.contains(x[np.newaxis], radius[i : i + 1]).all():
                position[i] = x
        placed.append(i)
    return position


@pytest.mark.parametrize(
    ("walls", "radii"),
    [
        (Annulus(0.3, 1.0), np.linspace(0.02, 0.1, 80)),
        (Annulus(0.0, 1.0), np.full(150, 0.05)),  # 0.375 of the area
        (Annulus(0.0, 1.0), np.array([0.9])),
        (Annulus(0.9, 1.0), np.array([0.01, 0.04])),
        (Annulus(0.0, 3.0), np.geomspace(1e-3, 1.0, 60)),  # ten levels
        (Annulus(0.0, 1e-9), np.full(20, 1e-10)),
    ],
)
def test_random_places_are_those_of_a_plain_loop(walls, radii):
    radii = np.random.default_rng(1).permutation(radii)
    places = place_at_random(Region(walls), radii, np.random.default_rng(5))
    assert np.array_equal(places, one_after_the_other(walls, radii, np.random.default_rng(5)))


def test_random_comes_near_its_limit():
    # equal discs that are added one by one fill at most 0.547 of a plane
    radius = np.sqrt(0.5 * (1.0 - 0.1**2) / 5000)
    assert overlaps(random(Region(Annulus(0.1, 1.0)), count=5000, radius=radius), 0.1, 1.0) == (0, 0, 0.0)
    more = np.full(500, np.sqrt(0.55 / 500))
    assert np.isnan(place_at_random(Region(Annulus(0.0, 1.0)), more, np.random.default_rng(0))).any()
    # which the layout grows, then
    assert overlaps(random(Region(Annulus(0.0, 1.0)), count=500, radius=more[0]), 0.0, 1.0) == (0, 0, 0.0)


POST = Disc((0.95, 2.4), 0.15)
FILLED = {
    "lattice": partial(lattice, radius=0.03),
    "touching": partial(lattice, radius=0.03, spacing=2.0),
    "loose": partial(random, radius=[0.02, 0.03], packing_fraction=0.5),
    "dense": partial(random, radius=[0.02, 0.03], packing_fraction=0.66, seed=1),
}


@pytest.mark.parametrize("periodic", ["", "x", "y", "xy"])
@pytest.mark.parametrize("layout", FILLED)
def test_boxes_are_filled_to_the_sides(layout, periodic):
    """And beyond periodic ones, clear of images, of a post that is near one, and of a rough side."""
    rough = {} if "y" in periodic else {"bottom": {"roughness": {"radius": 0.05, "spacing": 0.1}}}
    box = Box((-0.5, 1.0), (2.0, 2.8), periodic=periodic, **rough)
    position, radius = FILLED[layout](box.space, box.among([POST]))
    assert np.pi * (radius**2).sum() > (0.65 if layout in ("lattice", "touching") else 0.48) * 1.2
    x, r = np.append(position, [POST.center], axis=0), np.append(radius, POST.radius)
    d = x - x[:, np.newaxis]
    for way, (low, high) in enumerate((box.x, box.y)):
        if "xy"[way] in periodic:
            d[..., way] -= (high - low) * np.rint(d[..., way] / (high - low))
            assert low <= position[:, way].min() < low + 0.02
            assert high - 0.06 < position[:, way].max() < high
        else:
            to_sides = np.minimum(position[:, way] - low, high - position[:, way]) - radius
            assert to_sides.min() >= -1e-15  # rounding of 2.8 m
    apart = np.hypot(*d.T) - r - r[:, np.newaxis] + np.diag(np.full(len(r), np.inf))
    assert apart.min() >= -1e-15
    scene = Scene(position=position, radius=radius, mass=1.0, domain=box, walls=[POST])
    assert scene.count_overlaps() == (0, 0, 0.0)


def test_rows_and_columns_in_a_box():
    space = Box((-0.5, 1.0), (2.0, 2.8), periodic="x").space
    position, _ = rows(space, count=40, radius=0.05)
    assert len(np.unique(position[:12, 0])) == 12  # of 0.125 m
    assert np.unique(position[:, 1]) == pytest.approx([2.1, 2.225, 2.35, 2.475])
    assert position[:12, 0].mean() == pytest.approx(0.25)
    position, _ = column(space, count=2, radius=0.05, spacing=3.0)
    assert position == pytest.approx(np.array([(0.25, 2.1), (0.25, 2.25)]))


def test_column_stands_a_little_apart_on_the_outer_wall():
    position, _ = column(Region(Annulus(0.5, 2.0)), count=3, radius=0.25, spacing=2.5)
    assert np.array_equal(position, [[0.0, -1.625], [0.0, -1.0], [0.0, -0.375]])
