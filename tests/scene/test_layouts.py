"""Where grains start: between the walls, clear of each other, the same on every call."""

from functools import partial

import numpy as np
import pytest
from matplotlib.path import Path

from warpgrains import Box, Disc, InputError, Polyline, Scene
from warpgrains.scene.layouts import column, lattice, random_layout, rows
from warpgrains.scene.placing import place_at_random
from warpgrains.walls.annulus import Annulus
from warpgrains.walls.kinds import checked_walls


def space(radius_in, radius_out):
    return Annulus(radius_in, radius_out).space


def require_clear(placement, radius_in, radius_out):
    position, radius = placement
    scene = Scene(position=position, radius=radius, mass=1.0, radius_in=radius_in, radius_out=radius_out)
    assert scene.count_overlaps() == (0, 0, 0.0)


def test_rows_are_as_wide_as_the_outer_wall():
    position, radius = rows(space(0.2, 1.0), count=60, radius=0.05)
    heights = np.unique(position[:, 1])
    assert np.array_equal(heights, np.arange(len(heights)) * 0.05 * 2.5 + 2.0 * 0.05 + 0.2)
    lowest = position[position[:, 1] == heights[0], 0]
    assert len(lowest) == 1 + 2 * np.floor(np.sqrt(0.95**2 - 0.3**2) / 0.125)
    assert np.allclose(np.diff(lowest), 0.125, rtol=0, atol=1e-15)
    require_clear((position, radius), 0.2, 1.0)
    position, _ = rows(space(0.5, 2.0), count=2, radius=0.1, columns=5)
    assert np.array_equal(position, rows(space(0.5, 2.0), count=15, radius=0.1, columns=5)[0][:2])


def test_lattice_fills_from_the_bottom():
    filled, radius = lattice(space(0.3, 1.0), radius=0.05)
    position, _ = lattice(space(0.3, 1.0), radius=0.05, count=50)
    assert np.array_equal(position, filled[:50])
    assert (np.diff(filled[:, 1]) >= 0.0).all()
    require_clear((filled, radius), 0.3, 1.0)
    assert len(filled) * 0.05**2 / (1.0 - 0.3**2) > 0.7
    position, _ = lattice(space(0.3, 1.0), radius=0.05, region={"x": [0.0, 0.52], "y": [-0.3, 0.3]})
    assert len(position) > 10
    assert (position >= (0.05, -0.25)).all()
    assert (position <= (0.47, 0.25)).all()
    position, _ = lattice(space(0.0, 0.25 + 0.5 * 3.0**0.5), radius=0.25, spacing=2.0)
    assert (position == 0.0).all(axis=1).sum() == 1  # at the origin, too


def one_after_the_other(walls, radius, generator):
    """What `place_at_random` returns, by a plain loop over all discs before."""
    position = np.full((len(radius), 2), np.nan)
    placed = []
    for i in np.argsort(-radius, kind="stable"):
        while np.isnan(position[i, 0]):
            x = walls.radius_out * (2.0 * generator.random(2) - 1.0)
            d, reach = position[placed] - x, radius[placed] + radius[i]
            clear = (d[:, 0] * d[:, 0] + d[:, 1] * d[:, 1] >= reach * reach).all()
            rho, inner = np.hypot(*x), walls.radius_in + radius[i] if walls.radius_in else 0.0
            if clear and inner <= rho <= walls.radius_out - radius[i]:
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
    places = place_at_random(walls.space, radii, np.random.default_rng(5))
    assert np.array_equal(places, one_after_the_other(walls, radii, np.random.default_rng(5)))


POST = Disc((0.95, 2.4), 0.15)
LATTICE = partial(lattice, radius=0.03)
TOUCHING = partial(lattice, radius=0.03, spacing=2.0)
LOOSE = partial(random_layout, radius=[0.02, 0.03], packing_fraction=0.5)
DENSE = partial(random_layout, radius=[0.02, 0.03], packing_fraction=0.66, seed=1)


@pytest.mark.parametrize(
    ("layout", "periodic", "fraction"),
    [
        *((LATTICE, "", 0.65), (LATTICE, "xy", 0.65), (TOUCHING, "x", 0.65), (TOUCHING, "y", 0.65)),
        *((LOOSE, "x", 0.48), (LOOSE, "xy", 0.48), (DENSE, "", 0.64), (DENSE, "y", 0.64)),
    ],
)
def test_boxes_are_filled_to_the_sides(layout, periodic, fraction):
    """And beyond periodic ones, clear of images, of a post that is near one, and of a rough side."""
    rough = {} if "y" in periodic else {"bottom": {"roughness": {"radius": 0.05, "spacing": 0.1}}}
    box = Box((-0.5, 1.0), (2.0, 2.8), periodic=periodic, **rough)
    position, radius = layout(box.space, [POST, *box.walls])
    assert np.pi * (radius**2).sum() > fraction * 1.2
    for way, (low, high) in enumerate((box.x, box.y)):
        place = position[:, way]
        if "xy"[way] in periodic:
            assert low <= place.min() < low + 0.02
            assert high - 0.06 < place.max() < high
        else:
            assert (np.minimum(place - low, high - place) - radius).min() >= -1e-15  # rounding of 2.8 m
    scene = Scene(position=position, radius=radius, mass=1.0, domain=box, walls=[POST])
    assert scene.count_overlaps() == (0, 0, 0.0)
    x, r = np.append(position, [POST.center], axis=0), np.append(radius, POST.radius)
    d, period = x - x[:, np.newaxis], box.period.lengths
    d -= period * np.rint(d / np.where(period > 0.0, period, 1.0))
    apart = np.hypot(*d.T) - r - r[:, np.newaxis] + np.diag(np.full(len(r), np.inf))
    assert apart.min() >= -1e-15


def test_rows_and_columns_in_a_box():
    box = Box((-0.5, 1.0), (2.0, 2.8), periodic="x").space
    position, _ = rows(box, count=40, radius=0.05)
    assert len(np.unique(position[:12, 0])) == 12  # of 0.125 m
    assert np.unique(position[:, 1]) == pytest.approx([2.1, 2.225, 2.35, 2.475])
    assert position[:12, 0].mean() == pytest.approx(0.25)
    position, _ = column(box, count=2, radius=0.05, spacing=3.0)
    assert position == pytest.approx(np.array([(0.25, 2.1), (0.25, 2.25)]))


def test_column_stands_a_little_apart_on_the_outer_wall():
    position, _ = column(space(0.5, 2.0), count=3, radius=0.25, spacing=2.5)
    assert np.array_equal(position, [[0.0, -1.625], [0.0, -1.0], [0.0, -0.375]])


STAR = [
    (np.cos(a), np.sin(a)) * np.array([0.8, 0.9]) * (1.0, 0.45)[k % 2]
    for k, a in enumerate(np.arange(10) * np.pi / 5)
]
POLYGONS = {
    "bowl": ((-0.5, 0.4), (-0.3, -0.5), (0.3, -0.5), (0.5, 0.4)),
    "star": tuple(map(tuple, STAR)),
    "rectangle": ((-0.2, -0.3), (0.5, -0.3), (0.5, 0.4), (-0.2, 0.4)),
    "hourglass": ((-0.5, -0.6), (0.5, -0.6), (0.1, 0.0), (0.5, 0.6), (-0.5, 0.6), (-0.1, 0.0)),
}


@pytest.mark.parametrize(
    ("layout", "fraction"),
    [(LATTICE, 0.5), (LOOSE, 0.49), (partial(DENSE, packing_fraction=0.6), 0.59)],
    ids=["lattice", "loose", "dense"],
)
@pytest.mark.parametrize("name", POLYGONS)
@pytest.mark.parametrize("way", [1, -1])
def test_a_closed_polyline_is_filled(layout, fraction, name, way):
    """Also one that is not convex; no grain is outside of it."""
    corner = np.array(POLYGONS[name][::way])
    around = Polyline([(-0.9, 0.0), (0.0, -0.9), (0.9, 0.0), (0.0, 0.9)], closed=True)
    walls = checked_walls("walls", [around, Polyline(POLYGONS[name][::way], closed=True, name=name)])
    position, radius = layout(space(0.0, 1.0), walls, region=name)
    x, y = corner.T
    area = 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert np.pi * (radius**2).sum() > fraction * area
    assert Path(corner).contains_points(position).all()
    scene = Scene(position=position, radius=radius, mass=1.0, radius_out=1.0, walls=walls)
    assert scene.count_overlaps()[0] == 0
    sides = np.stack([corner, np.roll(corner, -1, axis=0)], axis=1)
    for start, end in sides:
        share = np.clip((position - start) @ (end - start) / ((end - start) @ (end - start)), 0.0, 1.0)
        apart = np.hypot(*(position - start - share[:, np.newaxis] * (end - start)).T)
        assert (apart - radius).min() >= -1e-15


@pytest.mark.parametrize(
    ("points", "region", "complaint"),
    [
        (None, "bowl", "grains.region is 'bowl': it must be a table, because no wall is a closed polyline"),
        (POLYGONS["bowl"], "bowel", "did you mean 'bowl'"),
        (POLYGONS["bowl"], True, "it must be a table of ranges"),
        (
            ((-0.5, 0.0), (0.5, 0.4), (0.5, 0.0), (-0.5, 0.4)),
            "bowl",
            "sides of this polygon cross between y = 0",
        ),
        (((2.0, 0.0), (2.5, 0.0), (2.5, 0.4)), "bowl", "no point of this polyline lies in the domain"),
    ],
)
def test_what_is_no_closed_polyline_is_refused(points, region, complaint):
    walls = [] if points is None else [Polyline(points, closed=True, name="bowl")]
    walls += [Polyline([(-0.9, 0.0), (0.0, -0.9), (0.9, 0.0)], name="open")]
    with pytest.raises(InputError, match=complaint):
        LATTICE(space(0.0, 1.0), checked_walls("walls", walls), region=region)
