"""Walls: what holds at all of them, every kind on both sides, and scenes read and written."""

from ctypes import CDLL
from dataclasses import replace
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from moments import energy_balance
from schemes import contact_mass, without_contacts
from swept_order import follow_reference
from walled_scenes import ARC, BOUNCY, DISCS, INFINITE, OF_EVERY_KIND, WALLED, around, force_on

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
from warpgrains.accuracy import certify
from warpgrains.analysis.vtk import export
from warpgrains.drawing.shapes import drawn_walls
from warpgrains.kernels import types
from warpgrains.kernels.walls.contact import is_near_circle
from warpgrains.kernels.walls.shapes import shape_gap, shape_normal
from warpgrains.reference.reference import Reference
from warpgrains.scene.fields import METHODS
from warpgrains.usd.check import report_on_recording
from warpgrains.walls.kinds import WALL_KINDS
from warpgrains.walls.wall import MOST_NUMBERS, Wall

EPS = np.finfo(float).eps


def methods(scene: Scene) -> tuple[str, ...]:
    """Return those that take a scene; that with friction by the exact one has tests of its own."""
    return METHODS[: 2 if scene.has_driven_walls or scene.has_friction else 3]


@pytest.mark.parametrize("which", WALLED)
def test_steps_are_solved_and_no_overlap_exceeds_dt_eta(which: str) -> None:
    """Nor at a light wall, which a large step would take through half of the grains (12)."""
    make, k, converged = WALLED[which], [*WALLED].index(which), 0
    method = methods(make())[k % len(methods(make()))]
    simulation = Simulation(make(stop="residual", max_iterations=1000, method=method, **(BOUNCY, {})[k % 2]))
    for _ in range(30):
        report, now = simulation.step(), simulation.present_scene
        fastest = np.hypot(*simulation.velocity.T).max()
        for number, wall in enumerate(now.walls) if report.converged else ():
            beyond, slide = 1e-14, now.dt * (fastest + wall.speed)
            if isinstance(wall, Arc) or getattr(wall, "inside", False):
                room = wall.radius - now.radius.max()
                beyond += 0.5 * slide**2 / room  # sqrt(a^2 + b^2) <= a + b^2 / (2 a) along a hollow wall
            if isinstance(wall, Segment):  # that turns by an angle (26b)
                angle = abs(wall.angular_velocity) * now.dt
                beyond += 0.5 * now.radius.max() * angle**2 + slide * angle
            gap = now.side(number, simulation.position, now.radius, time=now.time).gap.min()
            assert gap >= -now.dt * report.residual - beyond, number
        converged += report.converged
    assert converged > 25
    simulation.change(tolerance=1e-12, max_iterations=100_000)
    certified = not (now.has_driven_walls or now.has_rolling_friction)
    if certified and simulation.step().converged:
        bound = certify(simulation)
        assert bound.error is None
        assert bound.solver_error <= 1e-5  # the root of a duality gap of 1e-14, times speeds of some m/s


@pytest.mark.parametrize("which", WALLED)
def test_momentum_and_energy_are_accounted_for(which: str) -> None:
    """What grains gain in a step is what contacts carry, in the directions that the host finds."""
    scheme = ("euler", "leapfrog")[[*WALLED].index(which) % 2]
    simulation = Simulation(WALLED[which](max_iterations=60, scheme=scheme))
    scene, mass = simulation.scene, contact_mass(simulation.scene)[:, np.newaxis]
    if scene.has_driven_walls or scene.has_rolling_friction:
        simulation.advance(30)
    else:
        before, balance = analysis.kinetic_energy(simulation), energy_balance(simulation, steps=30)
        gained = balance.gravity_work + balance.wall_work - balance.drag_loss - balance.contact_loss
        assert analysis.kinetic_energy(simulation) - before == pytest.approx(gained, abs=1e-9)
    falling = scene.replace(gravity=scene.gravity_at(simulation.time))
    free = without_contacts(falling, simulation.velocity, simulation.state().staggered)
    simulation.step()
    pairs, walls, carried = simulation.contacts(), simulation.wall_contacts(), np.zeros((scene.n, 2))
    np.add.at(carried, pairs.pair[:, 1], force_on(pairs))
    np.subtract.at(carried, pairs.pair[:, 0], force_on(pairs))
    np.subtract.at(carried, walls.wall[:, 0], force_on(walls))
    assert len(walls.force) > 0 or which == "box, everywhere"
    assert walls.gap.max(initial=0.0) < scene.radius.max()  # at a joint, none is that of a wall left out
    # each of 60 iterations rounds what some six contacts give and take
    largest = mass.max() * (np.abs(free).max() + np.abs(simulation.velocity).max())
    assert np.abs(mass * (simulation.velocity - free) - scene.dt * carried).max() <= 60 * 6 * EPS * largest


def test_what_a_scene_file_says_is_read_back(tmp_path: Path) -> None:
    """In recordings and states, too; a polyline is segments of one name, whose forces are added up."""
    file, corners = tmp_path / "walls.toml", [(-0.5, 0.5), (-0.05, 0.0), (0.05, 0.0), (0.5, 0.5)]
    file.write_text(
        "[domain]\nradius_out = 2.0\n"
        "[grains]\nposition = [[0.0, 0.2], [0.01, 0.5]]\nradius = 0.1\nmass = 1.0\n"
        '[[walls]]\nkind = "disc"\ncenter = [0.0, -0.5]\nradius = 0.15\n'
        '[[walls]]\nkind = "arc"\ncenter = [0.5, -0.1]\nradius = 0.3\nfrom_angle = -2.5\nto_angle = -0.3\n'
        f'[[walls]]\nkind = "polyline"\npoints = {[*map(list, corners)]}\nname = "hopper"\n'
        f'[[walls]]\nkind = "polyline"\npoints = {[*map(list, corners[:3])]}\nclosed = true\n'
        "velocity = [0.0, -1.0]\n"
    )
    scene = Scene.load(file)
    assert scene.walls[:2] == (DISCS[0], ARC)
    assert scene.wall_names == ("Disc0", "Arc1", *["hopper"] * 3, *["polyline3"] * 3, "Outer")
    assert [wall.ends.tolist() for wall in scene.walls[2:5]] == [
        [list(a), list(b)] for a, b in pairwise(corners)
    ]
    assert scene.walls[7] == Segment(
        corners[2], corners[0], velocity=(0.0, -1.0), start_time=0.0, name="polyline3"
    )
    in_python = [DISCS[0], ARC, Polyline(corners, name="hopper")]
    in_python.append(Polyline(corners[:3], closed=True, velocity=(0.0, -1.0)))
    assert scene.replace(walls=in_python).walls == scene.walls
    simulation = Simulation(scene)
    simulation.run(duration=1.0, record=tmp_path / "run.usdc", forces=True)
    assert Recording(tmp_path / "run.usdc").scene.walls == scene.walls
    assert report_on_recording(tmp_path / "run.usdc") == ["OK: 25 frames, 2 grains"]
    assert export(tmp_path / "run.usdc", tmp_path / "run.pvd") == 25
    assert {"hopper_2", "hopper_4", "polyline3_7"} < drawn_walls(scene, 0.02).keys()
    simulation.save(tmp_path / "state.npz")
    assert Simulation.load(tmp_path / "state.npz").scene.walls == scene.walls
    contacts = simulation.wall_contacts()
    assert {2, 4} <= set(contacts.wall[:, 1].tolist()) <= {2, 3, 4}
    found = analysis.wall_forces(simulation)
    assert [*found] == ["Disc0", "Arc1", "hopper", "polyline3", "Outer"]
    assert [own.normal for own in found.values()] == [0.0, 0.0, contacts.force.sum(), 0.0, 0.0]


def test_a_polyline_turns_as_a_whole() -> None:
    turning = Polyline([(0.5, 0.0), (0.0, 0.5), (-0.5, -0.5)], closed=True, angular_velocity=1.0)
    assert {wall.pivot for wall in turning.segments(0)} == {(0.0, 0.0)}


def test_host_and_kernels_number_the_kinds_of_walls_alike() -> None:
    for name, kind in WALL_KINDS.items():
        assert kind.kind_number == import_module(f"warpgrains.kernels.walls.{name}").KIND
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


RING, BOWL = Disc((0.25, 0.25), 0.5, inside=True), Arc((0.25, 0.25), 0.5, -1.0, 1.0)
CENTERS: dict[str, dict[str, Any]] = {
    "annulus": {"position": [(0.125, 0.0)]},
    "annulus at the start": {"position": [(0.0, 0.0)]},
    "round": {"position": [(0.125, 0.0)], "wall": "round", "scheme": "leapfrog"},
    "pressure": {"position": [(0.125, 0.0)], "pressure": 0.01},
    "ring": {"position": [(0.375, 0.25)], "walls": [RING]},
    "turning ring": {"position": [(0.375, 0.25)], "walls": [replace(RING, angular_velocity=1.0)]},
    "arc": {"position": [(0.375, 0.25)], "walls": [BOWL]},
    "arc at the start": {"position": [(0.25, 0.25)], "walls": [BOWL]},
}


def centered(which: str, **changes: Any) -> Scene:
    """Return a scene of a grain that moves to the left by 0.125 m a step, to where a wall has no normal."""
    fields = {"velocity": [(-1.0, 0.0)], "radius_out": 1.0, "dt": 0.125, "gravity": (0.0, 0.0)}
    return Scene(**{"radius": 0.1, "mass": 1.0} | fields | CENTERS[which] | changes)


@pytest.mark.parametrize("which", CENTERS)
def test_a_grain_passes_where_a_wall_out_of_reach_has_no_normal(c_library: CDLL, which: str) -> None:
    """It meets the wall on the other side, as in C; in every other case with friction."""
    scene = centered(which, friction=0.5 * ([*CENTERS].index(which) % 2))
    met = follow_reference(scene, 12, c_library)
    assert met.touched
    assert max(report.overlap for report in met.reports) < 2e-3
    simulation = Simulation(scene)
    simulation.advance(3)
    assert simulation.position.tolist() == [[scene.position[0, 0] - 0.375, scene.position[0, 1]]]


@pytest.mark.parametrize("which", ["annulus", "round", "pressure", "ring"])
def test_a_grain_that_may_touch_a_wall_without_normal_is_named(which: str) -> None:
    """The gap is less than the 0.125 m by which it moves in a step."""
    large = {"radius": 0.4} if which == "ring" else {"radius": 0.9}
    simulation = Simulation(centered(which, **large, max_iterations=1))
    where = (
        f"the wall {'Disc0' if which == 'ring' else 'Outer'}, which it may touch in this step, has no normal"
    )
    with pytest.raises(SimulationError, match=rf"step 2, .* velocity of \[-1.0, .*where {where}"):
        simulation.advance(2)
    assert simulation.steps == 1
