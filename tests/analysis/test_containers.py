"""Containers that segments form: found from their ends, with areas and stresses in closed form."""

import csv
from dataclasses import replace
from itertools import pairwise
from math import cos, pi, sin, sqrt

import numpy as np
import pytest
from command import exit_code, require_refusal
from moments import EPS, far_away, moment_of
from walled_scenes import BOXES, boxed

from warpgrains import Arc, Box, Disc, InputError, Line, Scene, Segment, Simulation, analysis
from warpgrains.analysis.quantities import SWEEP_QUANTITIES
from warpgrains.scene.annulus import Annulus
from warpgrains.scene.outline import Part
from warpgrains.scene.snapshot import Snapshots

TURN = np.array([[cos(0.4), sin(0.4)], [-sin(0.4), cos(0.4)]])


def chain(*corners):
    return [Segment(tuple(a), tuple(b)) for a, b in pairwise(corners)]


U = [(-0.3, 0.4), (-0.3, -0.4), (0.3, -0.4), (0.3, 0.5)]
HEXAGON = [(0.6 * cos(k * pi / 3), 0.6 * sin(k * pi / 3)) for k in range(7)]
CORNER = [(0.0, 0.01), (0.1, -0.3)]
CAP = pi / 3.0 - sqrt(3.0) / 4.0  # of a disc of radius 1, beyond a line at a distance of 1/2


@pytest.mark.parametrize(
    ("walls", "area", "mouth"),
    [
        (chain(*U), 0.6 * 0.8, 0.4),
        (chain(*(np.array(U) @ TURN)), None, None),  # gravity turns along
        ([*chain(*U), Segment((-0.5, 0.2), (0.31, 0.2))], 0.6 * 0.6, np.inf),  # a lid that sticks out
        ([*chain(*U), Segment((-0.28, 0.2), (0.28, 0.2))], 0.6 * 0.6, np.inf),  # and one with narrow gaps
        ([Segment((-0.2, 0.2), (0.2, 0.2)), *chain(*U)], 0.36, 0.2),  # with gaps of 5 radii it is open there
        (chain((-0.3, 0.4), (-0.3, -0.4), (0.0, -0.4), (0.2, -0.4), (0.3, -0.4), (0.3, 0.5)), 0.48, 0.4),
        (chain(*HEXAGON), 1.5 * sqrt(3.0) * 0.36, np.inf),
        ([*chain(*HEXAGON), Disc((0.2, 0.2), 0.1)], 1.5 * sqrt(3.0) * 0.36 - pi * 0.01, np.inf),
        ([Segment((-0.9, -0.5), (0.9, -0.5))], pi - CAP, np.inf),  # both ends beyond the circle
        ([*chain(*U), *chain((0.5, 0.2), (0.5, -0.5), (0.7, -0.5), (0.7, 0.2))], 0.48, 0.4),  # another box
        ([*chain(*U), Segment((0.05, -0.4), (0.05, 0.1))], None, "unknown"),  # a divider
        ([*chain(*U), Arc((0.0, 0.0), 0.8, 0.0, 1.0)], None, "unknown"),
        ([Segment((-0.2, -0.5), (0.2, -0.5))], None, "unknown"),  # a shelf
        ([Segment((-0.8, 0.7), (-0.1, -0.5)), Segment((0.1, -0.5), (0.8, 0.7))], None, "unknown"),  # a hopper
        (chain(*U)[:2], None, "unknown"),  # no wall to the right
    ],
)
def test_container_is_found_from_the_ends_of_segments(walls, area, mouth):
    turned = mouth is None
    turn, area, mouth = (TURN, 0.48, 0.4) if turned else (np.eye(2), area, mouth)
    gravity = np.array([0.0, -1.0]) @ turn
    found = moment_of(np.array(CORNER) @ turn, walls=walls, gravity=gravity).container
    if mouth == "unknown":
        assert not found.is_known
        with pytest.raises(InputError, match="do not form a convex polygon around the grains: give region"):
            found.closed()
        return
    assert found.is_known
    assert found.mouth == pytest.approx(mouth, rel=16 * EPS)
    assert found.region.area == pytest.approx(area, rel=64 * EPS)
    assert found.region.contains(np.array(CORNER) @ turn).all()


@pytest.mark.parametrize(
    ("sides", "walls", "area"),
    [
        ({}, [], 0.48),
        ({"left": {"velocity": (0.1, 0.3)}, "top": {"velocity": (0.2, 0.0)}}, [], 0.32),
        ({"left": {"velocity": (-0.1, 0.0), "to_time": 1.0}}, [], 0.56),
        ({"periodic": "x", "bottom": {"velocity": (0.3, -0.1)}}, [], 0.6),
        ({"periodic": "x"}, [Disc((-0.25, 0.1), 0.1, velocity=(-0.2, 0.0))], 0.48 - pi * 0.01),
        ({"periodic": "xy"}, [Disc((0.3, 0.4), 0.1)], 0.48 - pi * 0.01),
        ({}, [Segment((-0.3, 0.2), (0.3, 0.2))], 0.36),
        ({"periodic": "x"}, [Segment((0.05, -0.2), (0.05, 0.1))], None),
        (None, [Line((0.0, -0.5), (0.0, 1.0), 2.0)], pi - CAP),
    ],
)
def test_container_of_a_box_ends_at_its_sides(sides, walls, area):
    domain = {} if sides is None else {"domain": Box((-0.3, 0.3), (-0.4, 0.4), **sides)}
    now = far_away(replace(moment_of(CORNER, walls=walls, **domain), time=2.0))
    assert now.container.is_known == (area is not None)
    assert area is None or now.container.closed().area == pytest.approx(area, rel=64 * EPS)
    circles = 0 if now.scene.domain else 2
    assert analysis.wall_forces(now) == (0.0,) * (circles + len(now.scene.walls))


def test_boxes_of_all_kinds_at_once():
    """The same bits as of one scene."""
    first, *others = (boxed(kind) for kind in BOXES)
    scenes = [first, *(one for one in others if (one.n, one.wall_count) == (first.n, first.wall_count))]
    arrays = {name: np.array([getattr(scene, name) for scene in scenes]) for name in ("position", "velocity")}
    arrays |= {"spin": np.zeros(arrays["position"].shape[:2])}
    arrays |= {"wall_force": np.zeros((*arrays["spin"].shape, first.wall_count))}
    together = Snapshots.of(scenes, [0.1] * len(scenes), **arrays)
    assert len(scenes) > 2
    for k, scene in enumerate(scenes):
        one = Snapshots.of([scene], [0.1], **{name: array[k : k + 1] for name, array in arrays.items()})
        for name, of_runs in SWEEP_QUANTITIES.items():
            assert np.array_equal(of_runs(one)[0], of_runs(together)[k], equal_nan=True), name
    assert np.isnan([SWEEP_QUANTITIES[f"{name}_wall_force"](together) for name in ("outer", "inner")]).all()


@pytest.mark.parametrize("changes", [{"gravity": (0.0, 0.0)}, {"position": [*CORNER, (0.5, 0.0)]}])
def test_an_open_container_without_gravity_or_without_a_grain_is_unknown(changes):
    assert not moment_of(**{"position": CORNER, "walls": chain(*U), **changes}).container.is_known


def test_a_ring_about_the_grains_is_their_container():
    """Its area, its lowest point, and the cell of the only grain."""
    now = moment_of([(0.2, 0.1)], 0.1, walls=[Disc((0.2, 0.1), 0.3, inside=True)])
    assert analysis.packing_fraction(now) == pytest.approx(1.0 / 9.0, rel=64 * EPS)
    assert analysis.pile_height(now) == pytest.approx(0.4, rel=64 * EPS)
    assert analysis.cell_areas(now) == pytest.approx(pi * 0.09, rel=1e-9)


def test_a_grain_above_the_mouth_has_no_cell():
    heaped = moment_of([*CORNER, (0.0, 0.45)], walls=chain(*U))
    assert analysis.packing_fraction(heaped) > 0.0
    with pytest.raises(InputError, match=r"position of grain 2 .*: it is above the mouth of the container"):
        analysis.cell_areas(heaped)


def test_walls_are_where_they_are_at_the_time():
    lid = Segment((-0.3, 0.4), (0.3, 0.4), velocity=(0.0, -0.1))
    moving = moment_of(CORNER, walls=[*chain(*U), lid])
    areas = [replace(moving, time=time).container.closed().area for time in (0.0, 2.0)]
    assert areas == pytest.approx([0.48, 0.36], rel=64 * EPS)


RADIUS = 0.02
BOX = [(-0.2, 0.12), (-0.2, -0.12), (0.2, -0.12), (0.2, 0.12)]
LATTICE = np.array([(0.04 * i - 0.18, 0.04 * j - 0.1) for i in range(10) for j in range(6)])


def carrying(now, around=False, walls=(2, 4)):
    """Let each row of the lattice carry a force of 3 N from wall to wall, or around."""
    pair = [(6 * i + j, 6 * i + j + 6) for i in range(9) for j in range(6)]
    pair += [(j, 54 + j) for j in range(6) if around]
    wall = [(j + 54 * k, walls[k]) for j in range(6) for k in range(2) if not around]
    numbers = {"pair": np.array(pair, np.int32), "wall": np.array(wall, np.int32).reshape(-1, 2)}
    forces = {"force": np.full(len(pair), 3.0), "tangential_force": np.zeros(len(pair))}
    at_walls = {"wall_force": np.full(len(wall), 3.0), "wall_tangential_force": np.zeros(len(wall))}
    return replace(now, **numbers, **forces, **at_walls)


def crate(closed, turn):
    """A square lattice that fills a box of segments."""
    corners, gravity = np.array([*BOX, *BOX[: int(closed)]]) @ turn, np.array([0.0, -9.81]) @ turn
    return carrying(moment_of(LATTICE @ turn, RADIUS, walls=chain(*corners), gravity=gravity))


@pytest.mark.parametrize("gravity", [(0.0, 0.0), (3.0, -5.0)])
@pytest.mark.parametrize("periodic", ["", "x", "y", "xy"])
def test_what_is_measured_in_a_box_of_the_domain(periodic, gravity):
    box = Box((-0.2, 0.2), (-0.12, 0.12), periodic=periodic)
    now = far_away(moment_of(LATTICE, RADIUS, domain=box, gravity=gravity))
    now = replace(carrying(now, "x" in periodic, (2, 3)), start=now.position)
    near, fill = {"rel": 1e4 * EPS, "abs": 1e4 * EPS}, pi / 4.0
    assert analysis.packing_fraction(now) == pytest.approx(fill, rel=sqrt(EPS))
    window = {"x": (-0.18, 0.1), "y": (-0.1, 0.1)}
    assert analysis.packing_fraction(now, window) == pytest.approx(fill, **near)
    assert analysis.global_packing_fraction(now) == pytest.approx(fill, **near)
    assert analysis.local_packing_fractions(now) == pytest.approx(fill, rel=1e-9)
    stress = np.diag([3.0 / 0.04, 0.0])
    assert analysis.mean_stress(now) == pytest.approx(stress, rel=1e-9, abs=1e-9)
    assert analysis.mean_stress(now, {"x": (-0.2, 0.0)}) == pytest.approx(stress, rel=1e-9, abs=1e-9)
    if "x" in periodic:  # elsewhere, slices may be at any angle
        profile = analysis.height_profile(now, 6)
        assert profile.packing_fraction == pytest.approx(fill, **near)
        along = np.diag([0.0, 3.0 / 0.04])
        assert profile.stress == pytest.approx(np.tile(along, (6, 1, 1)), rel=1e-9, abs=1e-9)
    assert analysis.grains_in(now, {"x": (-0.2, 0.0)}).sum() == 30
    assert analysis.contact_numbers(now).tolist() == [2] * 60


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("turn", [np.eye(2), TURN])
def test_what_is_measured_in_a_box_is_over_the_box(closed, turn):
    """Each grain fills pi / 4 of its square, also at walls; a row's force acts on its height of 4 cm."""
    now, full, fill = crate(closed, turn), {"below": 0.12}, pi / 4.0
    # the same places, turned and rounded, of up to 60 grains
    near = {"rel": 1e4 * EPS, "abs": 1e4 * EPS}
    # arcs near the ends of the arcsine, where grains touch the mean height, lose half of their digits
    assert analysis.packing_fraction(now) == pytest.approx(fill, rel=sqrt(EPS))
    assert analysis.packing_fraction(now, full) == pytest.approx(fill, **near)
    profile = analysis.height_profile(now, 9)
    assert profile.edges[[0, -1]] == pytest.approx([-0.12, 0.12], **near)
    assert profile.packing_fraction @ np.full(9, 1.0 / 9.0) == pytest.approx(fill, **near)
    assert analysis.height_profile(now, 6, full).packing_fraction == pytest.approx(fill, **near)
    assert analysis.local_packing_fractions(now) == pytest.approx(fill, rel=1e-9)  # slopes of a hull
    assert analysis.pile_height(now) == pytest.approx(0.24, **near)
    stress = turn.T @ np.diag([3.0 / 0.04, 0.0]) @ turn
    assert analysis.mean_stress(now, full) == pytest.approx(stress, rel=1e-9, abs=1e-9)
    assert analysis.grain_stresses(now) == pytest.approx(np.tile(stress, (60, 1, 1)), rel=1e-9, abs=1e-7)
    if closed:
        assert analysis.mean_stress(now) == pytest.approx(stress, rel=1e-9, abs=1e-9)
        assert analysis.global_packing_fraction(now) == pytest.approx(fill, **near)
    else:
        for measure in (analysis.mean_stress, analysis.pressure, analysis.global_packing_fraction):
            with pytest.raises(InputError, match=r"open above a height of 0\.12 m"):
                measure(now)


def test_below_the_surface_ends_at_the_floor_of_the_box():
    now = crate(False, np.eye(2))
    # a diameter below the uppermost centers, in the columns that hold grains, which are wider than the box
    assert analysis.region_of(now, {"below": "surface"}).area == pytest.approx(0.4 * 0.18, rel=1e-12)
    assert analysis.region_of(now, {"below": "surface", "x": (0.1, 0.9)}).area == pytest.approx(0.1 * 0.18)


def test_where_the_container_is_unknown_a_region_must_be_bounded():
    stub = moment_of(LATTICE, RADIUS, walls=[Segment((0.5, -0.1), (0.6, -0.1))])
    for region in (None, {}, {"below": "surface"}, {"x": (-0.2, 0.2)}, {"angle": (0.0, 1.0)}):
        with pytest.raises(InputError, match="do not form a convex polygon"):
            analysis.packing_fraction(stub, region)
    for measure in (analysis.mean_stress, analysis.pile_height, analysis.cell_areas):
        with pytest.raises(InputError, match="do not form a convex polygon"):
            measure(stub)
    box = {"x": (-0.2, 0.2), "y": (-0.12, 0.12)}
    assert analysis.packing_fraction(stub, box) == pytest.approx(pi / 4.0, rel=1e4 * EPS)
    unknown = ["packing_fraction", "pile_height", "pressure"]
    assert np.isnan([*analysis.quantities(stub, unknown).values()]).all()


@pytest.mark.parametrize("fraction", [0.1, 0.2, 0.5, 0.9])
def test_grains_are_cut_at_the_border_of_a_region(fraction):
    """Of a lattice in a window that ends anywhere within its grains, against the strip that each loses."""
    now = moment_of(LATTICE, RADIUS)
    reach = 0.16 + 0.04 * fraction  # the outermost columns have their centers at 0.18
    d = reach - 0.18
    cut = RADIUS**2 * np.arccos(-d / RADIUS) + d * sqrt(RADIUS**2 - d**2)  # of a disc, before the border
    filled = 6 * (8 * pi * RADIUS**2 + 2 * cut)
    found = analysis.packing_fraction(now, {"x": (-reach, reach), "y": (-0.12, 0.12)})
    assert found == pytest.approx(filled / (2 * reach * 0.24), rel=1e4 * EPS)


def test_areas_of_discs_are_those_of_points_at_random():
    """In polygons with up to seven edges, in rings, without discs; large and small, anywhere."""
    rng, compared = np.random.default_rng(8), 0
    points = np.sqrt(rng.random(40_000)) * np.exp(2j * pi * rng.random(40_000))
    inside = np.stack([points.real, points.imag], axis=1)
    for _ in range(12):
        angle = np.sort(rng.uniform(0.0, 2.0 * pi, rng.integers(3, 8)))
        corner = rng.uniform(0.5, 1.3) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        borders = (*Annulus(0.3, 1.0).borders, Disc((0.4, 0.2), 0.25).border)
        part = Part(corner + rng.uniform(-0.3, 0.3, 2), borders)
        center, radius = rng.uniform(-1.0, 1.0, (25, 2)), rng.uniform(0.05, 0.6, 25)
        for own, r, area in zip(center, radius, part.areas(center, radius), strict=True):
            share = area / (pi * r**2)
            # five standard deviations of a share of so many points, and one point
            deviation = 5.0 * sqrt(max(share * (1.0 - share), 0.0) / len(inside)) + 1.0 / len(inside)
            assert part.contains(own + r * inside).mean() == pytest.approx(share, abs=deviation)
            compared += 0.01 < share < 0.99
    assert compared > 100


def test_areas_of_discs_that_touch():
    """Walls and corners that only touch cut nothing, in any direction."""
    part = Part(np.array([(-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2)]) @ TURN, ())
    touching = np.array([(0.1, 0.1), (-0.1, 0.1), (0.1, 0.0), (0.0, 0.1), (0.3, 0.0), (0.0, 0.0)]) @ TURN
    found = part.areas(touching, np.array([0.1, 0.1, 0.1, 0.1, 0.1, 0.2]))
    assert found == pytest.approx(pi * np.array([0.01, 0.01, 0.01, 0.01, 0.0, 0.04]), abs=1e-15)
    depth = 1e-5  # by which a disc of radius 1 sticks out
    cap = np.arccos(1.0 - depth) - (1.0 - depth) * sqrt(depth * (2.0 - depth))
    square = Part(np.array([(-2.0, -2.0), (2.0, -2.0), (2.0, 1.0 - depth), (-2.0, 1.0 - depth)]), ())
    assert square.areas(np.zeros((1, 2)), np.ones(1)) == pytest.approx(pi - cap, rel=64 * EPS)
    ring = Part(np.array([(-2, -2), (2, -2), (2, 2), (-2, 2)], float), Annulus(0.5, 1.0).borders)
    angle = 2.0 * pi * np.arange(16) / 16
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for distance in (0.6, 0.9):
        assert ring.areas(distance * along, np.full(16, 0.1)) == pytest.approx(pi * 0.01, rel=1e-12)


SILO = """
domain.radius_out = 1.0
time = {dt = 0.01, duration = 1.0}
walls = [
    {kind = "segment", from = [-0.3, 0.5], to = [-0.3, -0.4]},
    {kind = "segment", from = [-0.4, -0.4], to = [$right, -0.4]},
    {kind = "segment", from = [0.3, -0.4], to = [0.3, 0.5]},
]
[grains]
layout = "random"
radius = [0.03, 0.04]
count = 30
mass = 0.1
region = {x = [-0.3, 0.3], y = [-0.4, 0.4]}
"""


@pytest.fixture
def silos(tmp_path):
    """A silo, and one with an opening in its floor."""
    folder = tmp_path / "silos"
    folder.mkdir()
    for name, right in (("closed", 0.4), ("open", 0.0)):
        (folder / f"{name}.toml").write_text(SILO.replace("$right", str(right)))
    return folder


def rows(path):
    with path.open() as lines:
        return list(csv.DictReader(lines))


def test_a_sweep_has_no_number_over_an_unknown_area(silos, tmp_path, capfd):
    assert exit_code("batch", silos, "-o", tmp_path / "out") == 0
    assert "1 run: the area is unknown, so give --region" in capfd.readouterr().out
    closed, leaking = rows(tmp_path / "out" / "results.csv")
    simulation = Simulation(Scene.load(silos / "closed.toml"))
    simulation.run()
    assert float(closed["packing_fraction"]) == analysis.packing_fraction(simulation) > 0.6
    assert float(closed["pile_height"]) == analysis.pile_height(simulation)
    assert leaking["packing_fraction"] == leaking["pile_height"] == "nan"


def test_a_sweep_in_a_region(silos, tmp_path, capfd):
    region = {"x": (-0.25, 0.25), "y": (-0.35, -0.2)}
    options = ("--region", "x = [-0.25, 0.25], y = [-0.35, -0.2]", "--measure", "stress")
    for where, more in (("short", ()), ("long", ("--folders",))):
        assert exit_code("batch", silos, "-o", tmp_path / where, *options, *more) == 0
        for name, row in zip(("closed", "open"), rows(tmp_path / where / "results.csv"), strict=True):
            simulation = Simulation(Scene.load(silos / f"{name}.toml"))
            simulation.run()
            assert float(row["packing_fraction"]) == analysis.packing_fraction(simulation, region)
            assert float(row["pressure"]) == analysis.pressure(simulation, region)
    capfd.readouterr()
    assert exit_code("batch", silos, "-o", tmp_path / "long", "--resume", "--measure", "stress") == 2
    require_refusal(capfd, "is of a sweep with --region x = [-0.25, 0.25], y = [-0.35, -0.2]")
