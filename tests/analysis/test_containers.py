"""Containers that walls form: found from their ends, with areas and stresses in closed form."""

from dataclasses import replace
from math import cos, pi, sin, sqrt

import numpy as np
import pytest
from command import exit_code, require_refusal
from moments import EPS, far_away, moment_of
from sweeps import rows
from walled_scenes import chained, on_circle

from warpgrains import Arc, Box, Disc, InputError, Line, Scene, Segment, Simulation, analysis

TURN = np.array([[cos(0.4), sin(0.4)], [-sin(0.4), cos(0.4)]])
DOWN = np.array([0.0, -9.81])
U_SHAPE = np.array([(-0.3, 0.4), (-0.3, -0.4), (0.3, -0.4), (0.3, 0.5)])
U = chained(U_SHAPE)
TURNED_U = {"walls": chained(U_SHAPE @ TURN), "gravity": DOWN @ TURN}
BENT_U = [*chained(U_SHAPE[:2]), *chained(np.array([(-0.3, -0.4), (0.0, -0.4), (0.3, -0.4), (0.3, 0.5)]))]
BOX_BESIDE = chained(np.array([(0.5, 0.2), (0.5, -0.5), (0.7, -0.5), (0.7, 0.2)]))
HEXAGON = chained(0.6 * on_circle(pi / 3.0 * np.arange(7)))
HOPPER = [Segment((-0.8, 0.7), (-0.1, -0.5)), Segment((0.1, -0.5), (0.8, 0.7))]
CORNER = np.array([(0.0, 0.01), (0.1, -0.3)])
CAP = pi / 3.0 - sqrt(3.0) / 4.0  # of a disc of radius 1, beyond a line at a distance of 1/2
DISC = pi * 0.1**2


def across(left, right, height, **motion):
    return Segment((left, height), (right, height), **motion)


def box(*walls, **sides):
    return {"domain": Box((-0.3, 0.3), (-0.4, 0.4), **sides), "walls": walls}


@pytest.mark.parametrize(
    ("fields", "area", "mouth"),
    [
        ({"walls": U}, 0.48, 0.4),
        ({**TURNED_U, "position": CORNER @ TURN}, 0.48, 0.4),
        ({"walls": BENT_U}, 0.48, 0.4),
        ({"walls": [*U, *BOX_BESIDE]}, 0.48, 0.4),
        ({"walls": [*U, across(-0.5, 0.31, 0.2)]}, 0.36, np.inf),  # a lid that sticks out
        ({"walls": [*U, across(-0.28, 0.28, 0.2)]}, 0.36, np.inf),  # and one with narrow gaps
        ({"walls": [across(-0.2, 0.2, 0.2), *U]}, 0.36, 0.2),  # with gaps of 5 radii it is open there
        ({"walls": [*U, across(-0.3, 0.3, 0.4, velocity=(0.0, -0.1))]}, 0.36, np.inf),  # has moved down
        ({"walls": HEXAGON}, 1.5 * sqrt(3.0) * 0.36, np.inf),
        ({"walls": [*HEXAGON, Disc((0.2, 0.2), 0.1)]}, 1.5 * sqrt(3.0) * 0.36 - DISC, np.inf),
        ({"walls": [across(-0.9, 0.9, -0.5)]}, pi - CAP, np.inf),  # both ends beyond the circle
        ({"walls": [Line((0.0, -0.5), (0.0, 1.0), 2.0)]}, pi - CAP, np.inf),
        (box(), 0.48, np.inf),
        (box(left={"velocity": (0.1, 0.3)}, top={"velocity": (0.2, 0.0)}), 0.32, np.inf),
        (box(left={"velocity": (-0.1, 0.0), "end_time": 1.0}), 0.56, np.inf),
        (box(periodic="x", bottom={"velocity": (0.3, -0.1)}), 0.6, np.inf),
        (box(Disc((-0.25, 0.1), 0.1, velocity=(-0.2, 0.0)), periodic="x"), 0.48 - DISC, np.inf),
        (box(Disc((0.3, 0.4), 0.1), periodic="xy"), 0.48 - DISC, np.inf),
        (box(across(-0.3, 0.3, 0.2)), 0.36, np.inf),
    ],
)
def test_container_is_found(fields, area, mouth):
    """At a time of 2 s, from the ends of segments and the sides of boxes."""
    now = far_away(replace(moment_of(**{"position": CORNER, **fields}), time=2.0))
    found = now.container
    assert found.is_known
    assert found.mouth == pytest.approx(mouth, rel=16 * EPS)
    assert found.region.area == pytest.approx(area, rel=64 * EPS)
    assert found.region.contains(now.position).all()
    assert not any(own.contacts or own.force.any() for own in analysis.wall_forces(now).values())


@pytest.mark.parametrize(
    "fields",
    [
        {"walls": [*U, Segment((0.05, -0.4), (0.05, 0.1))]},  # a divider
        {"walls": [*U, Arc((0.0, 0.0), 0.8, 0.0, 1.0)]},
        {"walls": [across(-0.2, 0.2, -0.5)]},  # a shelf
        {"walls": HOPPER},
        {"walls": U[:2]},  # no wall to the right
        {"walls": U, "gravity": (0.0, 0.0)},
        {"walls": U, "position": [*CORNER, (0.5, 0.0)]},
        box(Segment((0.05, -0.2), (0.05, 0.1)), periodic="x"),
    ],
)
def test_where_the_container_is_unknown_a_region_must_be_bounded(fields):
    now = moment_of(**{"position": CORNER, **fields})
    assert not now.container.is_known
    for region in (None, {}, {"below": "surface"}, {"x": (-0.2, 0.2)}, {"angle": (0.0, 1.0)}):
        with pytest.raises(InputError, match="do not form a convex polygon around the grains: give region"):
            analysis.packing_fraction(now, region)
    for measure in (analysis.mean_stress, analysis.pile_height, analysis.cell_areas):
        with pytest.raises(InputError, match="do not form a convex polygon"):
            measure(now)
    found = analysis.quantities(now, ["packing", "pile", "pressure"])
    assert np.isnan([*found.values()]).all()
    around = {"x": (-0.03, 0.03), "y": (-0.02, 0.04)}
    assert analysis.packing_fraction(now, around) == pytest.approx(pi * 0.02**2 / 0.06**2, rel=1e4 * EPS)


def test_a_ring_about_the_grains_is_their_container():
    """Its area, its lowest point, and the cell of the only grain."""
    now = moment_of([(0.2, 0.1)], 0.1, walls=[Disc((0.2, 0.1), 0.3, inside=True)])
    for fraction in (
        analysis.packing_fraction,
        analysis.pile_packing_fraction,
    ):  # whole discs, and half discs
        assert fraction(now) == pytest.approx(1.0 / 9.0, rel=64 * EPS)
    assert analysis.pile_height(now) == pytest.approx(0.4, rel=64 * EPS)
    assert analysis.cell_areas(now) == pytest.approx(pi * 0.09, rel=1e-9)


RADIUS = 0.02
CRATE = np.array([(-0.2, 0.12), (-0.2, -0.12), (0.2, -0.12), (0.2, 0.12)])
LATTICE = np.array([(0.04 * i - 0.18, 0.04 * j - 0.1) for i in range(10) for j in range(6)])


def carrying(now, around=False, walls=(0, 2)):
    """Let each row of the lattice carry a force of 3 N from wall to wall, or around."""
    pair = [(6 * i + j, 6 * i + j + 6) for i in range(9) for j in range(6)]
    pair += [(j, 54 + j) for j in range(6) if around]
    wall = [(j + 54 * k, walls[k]) for j in range(6) for k in range(2) if not around]
    numbers = {"pair": np.array(pair, np.int32), "wall": np.array(wall, np.int32).reshape(-1, 2)}
    forces = {"force": np.full(len(pair), 3.0), "tangential_force": np.zeros(len(pair))}
    at_walls = {"wall_force": np.full(len(wall), 3.0), "wall_tangential_force": np.zeros(len(wall))}
    return replace(now, **numbers, **forces, **at_walls, start=now.position)


def crate(closed):
    """Return the lattice in a crate of segments."""
    corners = np.concatenate([CRATE, CRATE[: int(closed)]]) @ TURN
    return carrying(moment_of(LATTICE @ TURN, RADIUS, walls=chained(corners), gravity=DOWN @ TURN))


def in_domain(periodic, gravity=(0.0, 0.0)):
    """Return the lattice in a box of the domain, its grains anywhere in periodic directions."""
    domain = Box((-0.2, 0.2), (-0.12, 0.12), periodic=periodic)
    now = far_away(moment_of(LATTICE, RADIUS, domain=domain, gravity=gravity))
    return carrying(now, "x" in periodic, (0, 1))


@pytest.mark.parametrize(
    ("now", "turn"),
    [
        pytest.param(crate(True), TURN, id="closed crate"),
        pytest.param(crate(False), TURN, id="open crate"),
        pytest.param(in_domain(""), np.eye(2), id="box"),
        pytest.param(in_domain("x", (3.0, -5.0)), np.eye(2), id="box, periodic in x"),
        pytest.param(in_domain("y"), np.eye(2), id="box, periodic in y"),
        pytest.param(in_domain("xy", (3.0, -5.0)), np.eye(2), id="box, periodic in x and y"),
    ],
)
def test_what_is_measured_in_a_box_is_over_the_box(now, turn):
    """Each grain fills pi / 4 of its square, also at walls; a row's force acts on its height of 4 cm."""
    fill, whole = pi / 4.0, {"below": 0.12}
    # the same places, turned and rounded, of up to 60 grains
    near = {"rel": 1e4 * EPS, "abs": 1e4 * EPS}
    # arcs near the ends of the arcsine, where grains touch the mean height, lose half of their digits
    assert analysis.pile_packing_fraction(now) == pytest.approx(fill, rel=sqrt(EPS))
    assert analysis.local_packing_fractions(now) == pytest.approx(fill, rel=1e-9)  # slopes of a hull
    assert analysis.contact_numbers(now).tolist() == [2] * 60
    stress = turn.T @ np.diag([3.0 / 0.04, 0.0]) @ turn
    assert analysis.mean_stress(now, whole) == pytest.approx(stress, rel=1e-9, abs=1e-9)
    assert analysis.grain_stresses(now) == pytest.approx(np.tile(stress, (60, 1, 1)), rel=1e-9, abs=1e-7)
    if now.container.mouth < np.inf:
        for measure in (analysis.mean_stress, analysis.pressure, analysis.packing_fraction):
            with pytest.raises(InputError, match=r"open above a height of 0\.12 m"):
                measure(now)
    else:
        assert analysis.mean_stress(now) == pytest.approx(stress, rel=1e-9, abs=1e-9)
        assert analysis.packing_fraction(now) == pytest.approx(fill, **near)
    if now.scene.domain:
        assert analysis.grains_in(now, {"x": (-0.2, 0.0)}).sum() == 30
        half = analysis.mean_stress(now, {"x": (-0.2, 0.0)})
        assert half == pytest.approx(stress, rel=1e-9, abs=1e-9)
        window = {"x": (-0.18, 0.1), "y": (-0.1, 0.1)}
        assert analysis.packing_fraction(now, window) == pytest.approx(fill, **near)
    if not now.scene.period.y:
        assert analysis.pile_height(now) == pytest.approx(0.24, **near)
    if now.scene.period.x or not now.scene.period.y:  # up is y
        profile, along = analysis.height_profile(now, 6, whole), np.diag([0.0, 3.0 / 0.04])
        assert profile.edges[[0, -1]] == pytest.approx([-0.12, 0.12], **near)
        assert profile.packing_fraction == pytest.approx(fill, **near)
        assert profile.stress == pytest.approx(np.tile(along, (6, 1, 1)), rel=1e-9, abs=1e-9)


SILO = """
domain.radius_out = 1.0
time = {dt = 0.01, duration = 0.5}
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
region = {x = [-0.3, 0.3], y = [-0.4, 0.0]}
"""


def test_a_sweep_of_silos(tmp_path, capfd):
    """A silo, and one with an opening in its floor, whose area is unknown, without a region and in one."""
    ends, silos = {}, tmp_path / "silos"
    silos.mkdir()
    for name, right in (("closed", "0.4"), ("open", "0.0")):
        path = silos / f"{name}.toml"
        path.write_text(SILO.replace("$right", right))
        ends[name] = Simulation(Scene.load(path))
        ends[name].run()

    def swept(folder, *options):
        assert exit_code("batch", silos, "-o", folder, *options) == 0
        return zip(ends.values(), rows(folder), strict=True)

    (simulation, closed), (_, leaking) = swept(tmp_path / "out")
    assert "1 run: pile_packing_fraction is nan" in capfd.readouterr().out
    assert float(closed["pile_packing_fraction"]) == analysis.pile_packing_fraction(simulation) > 0.4
    assert float(closed["pile_height"]) == analysis.pile_height(simulation)
    assert leaking["pile_packing_fraction"] == leaking["pile_height"] == "nan"
    region = {"x": (-0.25, 0.25), "y": (-0.35, -0.2)}
    options = ("--region", "x = [-0.25, 0.25], y = [-0.35, -0.2]", "--measure", "packing,stress")
    for folder, more in ((tmp_path / "short", ()), (tmp_path / "long", ("--folders",))):
        for simulation, row in swept(folder, *options, *more):
            assert float(row["packing_fraction"]) == analysis.packing_fraction(simulation, region) > 0.1
            assert float(row["pressure"]) == analysis.pressure(simulation, region) > 0.1
    capfd.readouterr()
    assert exit_code("batch", silos, "-o", folder, "--resume", "--measure", "packing,stress") == 2
    require_refusal(capfd, "holds a sweep with --region x = [-0.25, 0.25], y = [-0.35, -0.2]")
