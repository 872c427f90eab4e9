"""Walls inside the annulus: against the C reference, closed forms, and scenes read and written."""

from collections.abc import Callable
from ctypes import CDLL
from functools import partial
from importlib import import_module
from itertools import pairwise
from math import acos, cos, hypot, pi, sin, sqrt
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from walled_scenes import (
    ARC,
    CORNERS,
    DISCS,
    INFINITE,
    MOVING,
    OF_EVERY_KIND,
    ROUGH,
    SEGMENTS,
    SMOOTH_DRIVEN,
    alone,
    around,
    boxed,
    cornered,
    pressed,
    stirred,
)

from warpgrains import (
    Arc,
    Disc,
    InputError,
    Polyline,
    Recording,
    Scene,
    Segment,
    Simulation,
    SimulationError,
    analysis,
)
from warpgrains.analysis.vtk import export
from warpgrains.drawing.shapes import drawn_walls
from warpgrains.kernels import types
from warpgrains.kernels.shapes import shape_gap, shape_normal
from warpgrains.kernels.walls import is_near_circle
from warpgrains.reference.reference import Reference
from warpgrains.scene.annulus import OUTER
from warpgrains.scene.fields import METHODS
from warpgrains.scene.wall import MOST_NUMBERS, Wall
from warpgrains.scene.wall_kinds import WALL_KINDS
from warpgrains.usd.check import report_on_recording

UNDER_PRESSURE = partial(pressed, 60, dt=2e-2, walls=[SMOOTH_DRIVEN])
WALLED: dict[str, Callable[..., Scene]] = {
    "fixed": partial(around, walls=(*DISCS, *SEGMENTS)),
    "box of segments": partial(cornered, CORNERS["box"]),
    "drum": partial(cornered, CORNERS["drum"]),
    "moving": partial(stirred, 60, walls=MOVING[:4]),
    "driven, light": partial(UNDER_PRESSURE, wall_mass=1.0),
    "driven": UNDER_PRESSURE,
    "driven, heavy": partial(UNDER_PRESSURE, wall_mass=1e3),
    "driven, rough": partial(UNDER_PRESSURE, **ROUGH),
    "rough lid": partial(boxed, "rough lid"),
}


CASES = [
    (which, method)
    for which in WALLED
    for method in (METHODS[:2] if which.startswith(("driven", "rough")) else METHODS)
]
"""Method "exact" refuses driven walls."""


@pytest.mark.parametrize(("which", "method"), CASES)
def test_no_overlap_exceeds_dt_eta(which: str, method: str) -> None:
    """Nor at a light wall, which a large step would take through half of the grains."""
    scene = WALLED[which](stop="residual", max_iterations=5000)
    simulation, converged = Simulation(scene, method=method), 0
    for _ in range(60):
        report, now = simulation.step(), simulation.present_scene
        slide = scene.dt * np.hypot(*simulation.velocity.T).max()
        for wall in now.wall_numbers if report.converged else ():
            # sqrt(a^2 + b^2) <= a + b^2 / (2 a) where a grain goes along a tangent
            beyond = 0.5 * slide**2 / (now.radius_out - scene.radius.max()) if wall == OUTER else 1e-14
            gap = now.side(wall, simulation.position, scene.radius).gap.min()
            assert gap >= -scene.dt * report.residual - beyond
        converged += report.converged
    assert converged > (30 if scene.has_friction else 50)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_grain_slides_down_a_segment(side: float) -> None:
    """Its acceleration is g sin(theta), on either side of it: below it, gravity points upwards."""
    theta, seconds = 0.5, 0.5
    along, up = np.array([cos(theta), -sin(theta)]), np.array([sin(theta), cos(theta)])
    slope = Segment(tuple(-1.5 * along), tuple(1.5 * along))
    start = -side * 1.0 * along + side * 0.1 * up
    simulation = alone(tuple(start), [slope], gravity=(0.0, -9.81 * side), dt=1e-4)
    simulation.advance(round(seconds / simulation.scene.dt))
    path = 0.5 * side * 9.81 * sin(theta) * seconds**2
    assert simulation.position[0] == pytest.approx(start + path * along, abs=1e-7)


@pytest.mark.parametrize("bowl", [Disc((0.5, 0.0), 1.0, inside=True), Arc((0.5, 0.0), 1.0, -2.5, -0.5)])
def test_a_grain_in_a_bowl_swings_as_a_pendulum(bowl: Wall) -> None:
    """The period of small swings is 2 pi sqrt((R - r) / g)."""
    simulation = alone((0.51, -0.9), [bowl], dt=1e-3)
    period = 2.0 * pi * sqrt(0.9 / 9.81)
    simulation.advance(round(0.5 * period / simulation.scene.dt))
    x, _ = simulation.position[0]
    assert x == pytest.approx(0.49, abs=1e-4)


@pytest.mark.parametrize(
    ("wall", "arm", "start"),
    [
        (Segment((-1.0, 0.0), (0.0, 0.0)), 0.1, 0.05),
        ({"kind": "disc", "center": (0.0, 0.0), "radius": 1.0}, 1.1, 1e-3),
    ],
    ids=["an end", "a disc"],
)
def test_a_grain_slides_off_where_the_closed_form_says(wall: object, arm: float, start: float) -> None:
    """It leaves a point or a disc without friction at cos(theta) = 2/3 of that at the start."""
    simulation = alone((arm * sin(start), arm * cos(start)), [wall], dt=1.2e-4 * sqrt(arm))
    while simulation.step().contacts or simulation.steps < 10:
        pass
    x, y = simulation.position[0]
    # within a step before it leaves it moves by |v| dt: an angle of sqrt(2 g arm / 3) dt / arm = 3.1e-4
    assert np.arctan2(x, y) == pytest.approx(acos(2.0 / 3.0 * cos(start)), abs=1e-3)
    assert hypot(x, y) == pytest.approx(arm, abs=1e-5 * arm)


def test_what_a_scene_file_says_is_read_back(tmp_path: Path) -> None:
    file = tmp_path / "walls.toml"
    file.write_text(
        "[domain]\nradius_out = 1.0\n[grains]\nposition = [[0.0, 0.5]]\nradius = 0.1\nmass = 1.0\n"
        '[[walls]]\nkind = "disc"\ncenter = [0.0, -0.5]\nradius = 0.15\n'
        '[[walls]]\nkind = "segment"\nfrom = [-0.7, -0.2]\nto = [-0.2, -0.6]\n'
        '[[walls]]\nkind = "arc"\ncenter = [0.5, -0.1]\nradius = 0.3\nfrom_angle = -2.5\nto_angle = -0.3\n'
    )
    scene = Scene.load(file)
    assert scene.walls == (DISCS[0], SEGMENTS[0], ARC)
    simulation = Simulation(scene)
    simulation.run(duration=0.5, record=tmp_path / "run.usdc", forces=True)
    assert Recording(tmp_path / "run.usdc").scene.walls == scene.walls
    simulation.save(tmp_path / "state.npz")
    assert Simulation.load(tmp_path / "state.npz").scene.walls == scene.walls
    assert report_on_recording(tmp_path / "run.usdc") == ["OK: 13 frames, 1 grain"]
    assert export(tmp_path / "run.usdc", tmp_path / "run.pvd") == 13


def test_a_polyline_is_segments_of_one_name(tmp_path: Path) -> None:
    """One wall in sums of forces; a scene file, a recording and a state keep the name."""
    file, corners = tmp_path / "hopper.toml", [(-0.5, 0.5), (-0.05, 0.0), (0.05, 0.0), (0.5, 0.5)]
    written = "\n".join(
        f'[[walls]]\nkind = "polyline"\npoints = {[list(corner) for corner in points]}\n{more}'
        for points, more in (
            (corners, 'name = "hopper"'),
            (corners[:3], "closed = true\nvelocity = [0.0, -1.0]"),
        )
    )
    grains = "[grains]\nposition = [[0.0, 0.2], [0.01, 0.5]]\nradius = 0.1\nmass = 1.0\n"
    file.write_text(f"[domain]\nradius_out = 2.0\n{grains}{written}\n")
    scene = Scene.load(file)
    assert scene.wall_names == ("Outer", "Inner", *["hopper"] * 3, *["polyline1"] * 3)
    assert [wall.ends.tolist() for wall in scene.walls[:3]] == [
        [list(a), list(b)] for a, b in pairwise(corners)
    ]
    assert scene.walls[5] == Segment(
        corners[2], corners[0], velocity=(0.0, -1.0), from_time=0.0, name="polyline1"
    )
    in_python = [Polyline(corners, name="hopper"), Polyline(corners[:3], closed=True, velocity=(0.0, -1.0))]
    assert (
        Scene(position=[(0.0, 0.5)], radius=0.1, mass=1.0, radius_out=2.0, walls=in_python).walls
        == scene.walls
    )
    simulation = Simulation(scene)
    simulation.run(duration=1.0, record=tmp_path / "run.usdc", forces=True)
    assert Recording(tmp_path / "run.usdc").scene.walls == scene.walls
    assert {"hopper_0", "hopper_2", "polyline1_5"} < drawn_walls(scene).keys()
    contacts = simulation.wall_contacts()
    assert {2, 4} <= set(contacts.wall[:, 1].tolist()) <= {2, 3, 4}
    assert analysis.wall_forces(simulation) == (0.0, 0.0, contacts.force.sum(), 0.0)


def test_a_polyline_turns_as_a_whole() -> None:
    turning = Polyline([(0.5, 0.0), (0.0, 0.5), (-0.5, -0.5)], closed=True, angular_velocity=1.0)
    assert {wall.pivot for wall in turning.segments(0)} == {(0.0, 0.0)}


def test_host_and_kernels_number_the_kinds_of_walls_alike() -> None:
    for name, kind in WALL_KINDS.items():
        assert kind.kind_number == import_module(f"warpgrains.kernels.{name}").KIND
    assert len({kind.kind_number for kind in WALL_KINDS.values()}) == len(WALL_KINDS)
    assert MOST_NUMBERS == types.MOST_NUMBERS


@wp.kernel
def find_sides(
    x: types.Vectors,  # type: ignore[valid-type]
    shapes: wp.array(dtype=types.Shape),  # type: ignore[valid-type]
    normal: types.Vectors,  # type: ignore[valid-type]
    gap: types.Floats,  # type: ignore[valid-type]
    near: types.Ints,  # type: ignore[valid-type]
) -> None:
    k = wp.tid()
    shape = shapes[0]
    radius = wp.float64(0.1)
    normal[k] = shape_normal(x[k], shape)
    gap[k] = shape_gap(x[k], radius, shape)
    near[k] = wp.where(is_near_circle(shape, x[k], radius), 1, 0)


@pytest.mark.parametrize("kind", WALL_KINDS.values(), ids=WALL_KINDS)
def test_kernels_have_normal_and_gap_of_every_kind_of_wall(kind: type[Wall]) -> None:
    """They are those of the host, and its circle is about all places where grains touch it."""
    walls = [wall for wall in (*OF_EVERY_KIND, *INFINITE) if type(wall) is kind]
    assert walls, f"add {kind.one()} to OF_EVERY_KIND or INFINITE of walled_scenes.py"
    position = np.random.default_rng(3).uniform(-1.0, 1.0, (1000, 2))
    radius = np.full(len(position), 0.1)
    for wall in walls:
        with wp.ScopedDevice("cpu"):
            normal, gap, near = (wp.zeros(1000, dtype) for dtype in (wp.vec2d, wp.float64, wp.int32))
            given = wp.array(position, wp.vec2d), wp.array([wall.shape], dtype=types.Shape)
            wp.launch(find_sides, 1000, [*given, normal, gap, near])
        side = wall.side(position, radius)
        assert np.isfinite(side.gap).all()
        assert normal.numpy() == pytest.approx(side.normal, rel=0.0, abs=1e-12)  # rounding of numbers near 1
        assert gap.numpy() == pytest.approx(side.gap, rel=0.0, abs=1e-12)
        assert near.numpy()[side.gap <= 0.0].all()


def test_a_wall_of_no_known_kind_is_refused() -> None:
    unknown = type("Unknown", (Wall,), {"kind": "unknown"})()
    with pytest.raises(InputError, match=r"walls\[1\] is Unknown\(\): it must be a Disc or "):
        Scene(position=[(0.0, 0.5)], radius=0.1, mass=1.0, radius_out=1.0, walls=[DISCS[0], unknown])


def test_a_kind_of_wall_without_its_branch_is_refused(
    c_library: CDLL, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Kernels and reference take it neither for another kind nor for no wall."""
    monkeypatch.setattr(Arc, "kind_number", 99)
    scene = around(walls=(ARC,))
    with pytest.raises(SimulationError, match=r"reached a velocity of \[nan, nan\] m/s: it is not finite"):
        Simulation(scene).advance(10)
    in_c = Reference(c_library, scene)
    in_c.update()
    assert np.isnan(in_c.velocity).all()


CENTERS: dict[str, dict[str, object]] = {
    "annulus": {"position": [(0.125, 0.0)]},
    "annulus at the start": {"position": [(0.0, 0.0)]},
    "round": {"position": [(0.125, 0.0)], "wall": "round", "scheme": "leapfrog"},
    "pressure": {"position": [(0.125, 0.0)], "pressure": 0.01},
    "ring": {"position": [(0.375, 0.25)], "walls": [Disc((0.25, 0.25), 0.5, inside=True)]},
    "turning ring": {
        "position": [(0.375, 0.25)],
        "walls": [Disc((0.25, 0.25), 0.5, inside=True, angular_velocity=1.0)],
    },
    "arc": {"position": [(0.375, 0.25)], "walls": [Arc((0.25, 0.25), 0.5, -1.0, 1.0)]},
    "arc at the start": {"position": [(0.25, 0.25)], "walls": [Arc((0.25, 0.25), 0.5, -1.0, 1.0)]},
}


def centered(which: str, **changes: object) -> Scene:
    """Return a scene of a grain that moves to the left by 0.125 m a step, to where a wall has no normal."""
    fields = {"velocity": [(-1.0, 0.0)], "radius_out": 1.0, "dt": 0.125, "gravity": (0.0, 0.0)}
    return Scene(**{"radius": 0.1, "mass": 1.0} | fields | CENTERS[which] | changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("which", CENTERS)
def test_a_grain_passes_where_a_wall_out_of_reach_has_no_normal(
    c_library: CDLL, which: str, friction: float
) -> None:
    """It meets the wall on the other side, as in C."""
    scene = centered(which, friction=friction)
    simulation, in_c = Simulation(scene), Reference(c_library, scene)
    for step in range(12):
        report = simulation.step()
        in_c.update()
        if step < 3:
            assert simulation.position.tolist() == [
                [scene.position[0, 0] - 0.125 * (step + 1), scene.position[0, 1]]
            ]
        assert np.array_equal(simulation.position, in_c.position)
        assert np.array_equal(simulation.velocity, in_c.velocity)
        assert report.overlap <= 0.0 or report.overlap < 2e-3


@pytest.mark.parametrize(("which", "wall"), [("annulus", 0), ("round", 0), ("pressure", 0), ("ring", 2)])
def test_a_grain_that_may_touch_a_wall_without_normal_is_named(which: str, wall: int) -> None:
    """The gap is less than the 0.125 m by which it moves in a step."""
    large = {"radius": 0.9} if wall == 0 else {"radius": 0.4}
    simulation = Simulation(centered(which, **large, max_iterations=1))
    where = f"wall {wall}, which it may touch in this step, has no normal"
    with pytest.raises(SimulationError, match=rf"step 2, .* velocity of \[-1.0, .*where {where}"):
        simulation.advance(2)
    assert simulation.steps == 1
