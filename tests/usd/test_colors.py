"""Colors of grains and their scales, marks, walls, and force chains that are cut: what all pictures share."""

import matplotlib
import numpy as np
import pytest
from numpy.testing import assert_allclose
from recordings import (
    RADIUS,
    make_frames,
    make_scene,
    moment,
)
from walled_scenes import BOXES, boxed

from warpgrains import Box, Disc, Segment
from warpgrains.drawing.chains import ChainScale, cut
from warpgrains.drawing.colorings import (
    COLORINGS,
    mobilized,
    pressure,
    pressure_scale,
    speed_scale,
    spin_scale,
)
from warpgrains.drawing.colors import CATEGORIES, LEVELS, GrainColors, colormap
from warpgrains.drawing.looks import COLORS
from warpgrains.drawing.shapes import disc, drawn_walls, mark, moved_walls, sphere


@pytest.mark.parametrize("name", sorted(own.colormap for own in COLORINGS.values()))
def test_colormaps_are_those_of_matplotlib(name):
    share = np.linspace(0.0, 1.0, 1001)
    assert np.allclose(colormap(name, share), matplotlib.colormaps[name](share)[:, :3], atol=0.025)
    assert np.array_equal(colormap(name, np.array([-1.0, 7.0])), colormap(name, np.array([0.0, 1.0])))


def test_pressure_is_force_over_circumference():
    pairs = {"pair": np.array([(0, 1), (0, 4)]), "force": np.array([3.0, 5.0])}
    now = moment(
        *make_frames(1)[0], **pairs, wall=np.array([(1, 0), (3, 1)]), wall_force=np.array([2.0, 7.0])
    )
    total = np.array([3 + 5, 3 + 2, 0, 7, 5])
    assert np.array_equal(pressure(now), total / (2 * np.pi * RADIUS))


FALLS, AT_REST = {"gravity": (0, -10)}, {"gravity": (0, 0)}
ROUGH = FALLS | {"friction": 0.3}
THROWN = AT_REST | {"velocity": np.full((5, 2), 3.0)}
PISTON = Segment((-1.0, 1.6), (1.0, 1.6), velocity=(0.3, -0.4))
BLADE = Segment((-1.5, 0.0), (-0.7, 0.0), angular_velocity=-2.0)
ROLLER = Disc((0.0, 1.6), 0.1, angular_velocity=7.0)
LID = Segment((-1.0, 1.6), (1.0, 1.6), force=-60.0, mass=3.0, friction=0.0)
DRIVEN = AT_REST | {"friction": 0.3, "walls": [LID]}
BOX = {"x": (-2.0, 2.0), "y": (-1.5, 1.5)}
IN_BOX = FALLS | {"radius_out": None, "radius_in": 0.0, "domain": Box(**BOX)}
TOP = {"pressure": 30.0, "mass": 3.0, "velocity": (0.5, 0.0)}
PRESSED = IN_BOX | AT_REST | {"domain": Box(**BOX, top=TOP)}


def force_scale(scene):
    return ChainScale.of(scene).force


@pytest.mark.parametrize(
    ("scale", "fields", "expected"),
    [
        (speed_scale, FALLS, np.sqrt(2 * 10 * 2.0)),
        (speed_scale, FALLS | {"drag": 5.0}, 10 * 1.0 / 5.0),
        (speed_scale, THROWN, 3 * 2**0.5),
        (pressure_scale, FALLS, 5 * 10 / 1.0),
        (pressure_scale, THROWN, 3 * 2**0.5 / 0.01 / (2 * np.pi * RADIUS.mean())),
        (pressure_scale, AT_REST, 1 / 0.01**2 / (2 * np.pi)),
        (force_scale, FALLS, 50 * 2 * RADIUS.mean()),
        # what walls inside give to grains at rest: the ends of the blade, and a roller unless it is smooth
        (speed_scale, AT_REST | {"friction": 0.3, "walls": [PISTON, BLADE]}, 2.0 * 0.4),
        (spin_scale, AT_REST | {"friction": 0.3, "walls": [PISTON, BLADE]}, 0.5 * 0.8 / 0.1),
        (speed_scale, AT_REST | {"friction": 0.3, "walls": [PISTON, ROLLER]}, 7.0 * 0.1),
        (speed_scale, AT_REST | {"walls": [PISTON, ROLLER]}, 0.5),
        (speed_scale, DRIVEN, np.sqrt(2 * 60.0 * 4.0 / (3.0 + 5.0))),
        (pressure_scale, DRIVEN, 4 * 60.0 / 2.0),
        (force_scale, DRIVEN, 120 * 2 * RADIUS.mean()),
        (pressure_scale, DRIVEN | {"gravity": (0, -1000)}, 5 * 1000 / 1.0),
        # half as fast as what falls across; the median radius
        (spin_scale, ROUGH, 0.5 * np.sqrt(2 * 10 * 2.0) / 0.1),
        (spin_scale, ROUGH | {"spin": -1000.0}, 1000.0),
        (spin_scale, ROUGH | {"angular_velocity_out": -1000.0}, 0.5 * 1000.0 * 2.0 / 0.1),
        # the longer side of a box
        (speed_scale, PRESSED, np.sqrt(2 * 30.0 * 4.0 * 4.0 / (3.0 + 5.0))),
        (pressure_scale, PRESSED, 4 * 30.0),
        (speed_scale, IN_BOX, np.sqrt(2 * 10 * 2.0)),
        (pressure_scale, IN_BOX, 5 * 10 / 1.0),
    ],
)
def test_scales_come_from_the_scene(scale, fields, expected):
    assert scale(make_scene(**fields)) == pytest.approx(expected)


@pytest.mark.parametrize("kind", BOXES)
def test_sides_and_walls_of_a_box_are_drawn_in_it_at_all_times(kind):
    """Without a circle; what crosses a periodic side reaches beyond by its width, and in between again."""
    scene, still = boxed(kind), drawn_walls(boxed(kind), 0.02)
    period, high = scene.period.lengths, np.array([1.0, 0.7])
    assert {name.split("_")[0] for name in still} == {*scene.wall_names}
    for time in (0.0, 0.3, 2.0, 50.0):
        for name, band in (still | moved_walls(scene, scene, time, 0.02)).items():
            wall = scene.walls[list(still).index(name)]
            points = np.concatenate([band.first, band.second])
            assert len(points) == len(still[name].first) * 2
            width = 2.0 * wall.circle[2] + 0.02 if np.isfinite(wall.circle[2]) else 0.03
            outside = ((points < -width) | (points > high + width)) & (period > 0.0)
            assert not outside.any(), (name, time)


def test_the_colors_that_help_names_are_those_that_there_are():
    assert {*COLORS} == {*CATEGORIES, *COLORINGS}


def test_neighbours_in_the_palette_differ():
    colors = GrainColors(make_scene(), "palette")
    assert colors.scale is None
    assert (np.diff(colors.still) != 0).all()


def test_colors_run_from_nothing_to_the_scale_and_no_further():
    """And those of spins by their signs."""
    scene, share = make_scene(friction=0.3), np.array([0.0, 1 / 3, -1.0, 7.0, 0.0])
    velocity = speed_scale(scene) * np.stack([0.0 * share, share], axis=1)
    wall_force = pressure_scale(scene) * 2 * np.pi * RADIUS * np.abs(share)
    at_wall = {"wall": np.stack([np.arange(5), np.zeros(5, int)], axis=1), "wall_force": wall_force}
    spin = spin_scale(scene) * np.array([-7.0, -1.0, 1 / 63, 1 / 3, 1.0])
    now = moment(scene.position, velocity, scene, spin=spin, **at_wall)
    rooted = [0, round(63 * 3**-0.5), 63, 63, 0]
    all_levels = {"speed": rooted, "pressure": rooted, "spin": [0, 0, 32, 42, 63]}
    for color_by, levels in all_levels.items():
        colors = GrainColors(scene, color_by)
        assert colors.levels(now).tolist() == levels
        expected = matplotlib.colormaps[COLORINGS[color_by].colormap](np.array(levels) / (LEVELS - 1))
        assert np.allclose(colors.of(now), expected[:, :3], atol=0.025)


def test_a_scene_without_a_scale_has_the_lowest_color():
    scene = make_scene(np.full(5, 0.1), gravity=(0, 0))
    now = moment(scene.position, scene.velocity, scene)
    for color_by in ("radius", "speed", "pressure"):
        assert GrainColors(scene, color_by).levels(now).tolist() == [0] * 5


def test_mobilized_friction_is_the_largest_of_a_grain():
    scene = make_scene(friction=0.5, wall_friction=0.1)
    contacts = {
        "pair": np.array([[0, 1], [1, 2]], np.int32),
        "force": np.array([2.0, 4.0]),
        "tangential_force": np.array([-1.0, 0.5]),
        "wall": np.array([[2, 0], [3, 1]], np.int32),
        "wall_force": np.ones(2),
        "wall_tangential_force": np.array([0.04, -0.07]),
    }
    where = scene.position, scene.velocity
    assert_allclose(mobilized(moment(*where, scene, **contacts)), [1.0, 1.0, 0.4, 0.7, 0.0])
    smooth = scene.replace(wall_friction=0.0)
    assert_allclose(mobilized(moment(*where, smooth, **contacts)), [1.0, 1.0, 0.25, 0.0, 0.0])


@pytest.mark.parametrize("shape", [disc, sphere])
def test_a_mark_changes_no_shape(shape):
    plain, marked = shape(), shape(is_marked=True)
    assert plain.marked is None
    assert marked.marked is not None
    assert area(marked).sum(axis=0) == pytest.approx(area(plain).sum(axis=0), abs=1e-12)
    assert np.hypot(*area(marked).T[:2]).sum() == pytest.approx(np.hypot(*area(plain).T[:2]).sum())
    first = np.cumsum(marked.counts) - marked.counts
    middle = np.add.reduceat(marked.points[marked.corners], first) / marked.counts[:, np.newaxis]
    inside = np.abs(np.arctan2(middle[:, 1], middle[:, 0])) < np.pi / 32
    assert np.array_equal(marked.marked, inside)
    assert np.hypot(*mark().T).max() < 1.0  # a line from the center


def area(shape):
    """Return the area vector of each polygon, shape (p, 3)."""
    first = np.cumsum(shape.counts) - shape.counts
    after = np.arange(1, len(shape.corners) + 1)
    after[first + shape.counts - 1] = first
    points = shape.points[shape.corners]
    found = np.add.reduceat(np.cross(points, points[after]), first) / 2.0
    a, b, c = (points[first + corner] for corner in range(3))
    assert ((np.cross(b - a, c - a) * found).sum(axis=1) > 0.0).all()
    return found


def test_lines_are_cut_at_periodic_sides():
    """Pieces lie in the box, and join at its sides: end to start, a length apart."""
    box = Box((-0.4, 0.6), (0.1, 0.6), periodic="xy")
    rng = np.random.default_rng(1)
    start, way = rng.uniform(-2.0, 2.0, (200, 2)), rng.uniform(-0.2, 0.2, (200, 2))
    begin, end, line = cut(box.period, start, start + way)
    low, high = np.array([box.x, box.y]).T
    for points in (begin, end):
        assert ((points > low - 1e-12) & (points < high + 1e-12)).all()
    total = np.stack([np.bincount(line, along) for along in (end - begin).T], axis=1)
    assert_allclose(total, way, rtol=0.0, atol=1e-12)
    assert np.array_equal(line[:200], np.arange(200))
    for whole in np.flatnonzero(np.bincount(line) > 1):
        own = np.flatnonzero(line == whole)
        joins = (begin[own, np.newaxis] - end[own]) / box.lengths
        joins = np.abs(joins - np.rint(joins)).max(axis=2) < 1e-12
        assert np.count_nonzero(joins) == len(own) - 1
    assert np.bincount(np.bincount(line)).tolist()[1:] != [200]
