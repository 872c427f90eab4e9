"""Walls that forces drive: against the C reference, closed forms, lists, and runs that are continued."""

from ctypes import CDLL
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd
from walled_scenes import BUMPS, DRIVEN, boxed, pressed

from warpgrains import (
    InputError,
    Recording,
    Scene,
    Segment,
    Simulation,
    SimulationError,
    analysis,
)
from warpgrains.accuracy import certify
from warpgrains.reference.reference import Reference
from warpgrains.scene.state import Corrections, first_state
from warpgrains.usd.check import report_on_recording
from warpgrains.usd.meshes import PLACES, WALLS


@pytest.mark.parametrize("method", ["gauss-seidel", "accelerated"])
@pytest.mark.parametrize("scheme", ["text", "leapfrog"])
def test_a_wall_without_contacts_accelerates(method: str, scheme: str) -> None:
    """Its speed is F t / M; pressure acts on 2 pi R."""
    wall = Segment((-0.2, 0.0), (0.2, 0.0), force=3.0, mass=2.0)
    scene = Scene(
        position=[(0.0, -0.9)], radius=0.05, mass=1.0, radius_out=1.0, gravity=(0.0, 0.0), walls=[wall],
        dt=1e-3, pressure=0.5, wall_mass=1e6, method=method, scheme=scheme,
    )  # fmt: skip
    simulation = Simulation(scene)
    simulation.advance(200)
    place, speed = simulation.state().driven.T
    behind = 0.5e-3 if scheme == "leapfrog" else 0.0  # speeds are those of the middle of the step
    assert speed[1] == pytest.approx(1.5 * (0.2 - behind))
    assert place[1] == pytest.approx(0.5 * 1.5 * 0.2**2, rel=1e-2 if scheme == "text" else 1e-9)
    assert speed[0] == pytest.approx(-0.5 * 2.0 * np.pi * (0.2 - behind) / 1e6, rel=1e-5)
    assert simulation.present_scene.radius_out == place[0] < 1.0
    assert simulation.present_scene.walls[0].start == (-0.2, place[1])
    assert simulation.scene.radius_out == 1.0


@pytest.mark.parametrize(
    ("method", "mass"),
    [("gauss-seidel", 1e-6), ("gauss-seidel", 1.0), ("accelerated", 1e-6), ("accelerated", 1e6)],
)
def test_a_grain_carries_the_force_of_a_piston(method: str, mass: float) -> None:
    """Between a piston and a fixed wall it comes to rest, and both contacts carry the force."""
    walls = [Segment((-0.5, -0.1), (0.5, -0.1)), Segment((0.5, 0.15), (-0.5, 0.15), force=7.0, mass=mass)]
    scene = Scene(
        position=[(0.0, 0.02)], radius=0.1, mass=0.3, radius_out=1.0, gravity=(0.0, 0.0), walls=walls,
        method=method, stop="residual", tolerance=1e-10, dt=1e-2 * max(1.0, mass**0.5),
    )  # fmt: skip
    simulation = Simulation(scene)
    simulation.advance(300)
    contacts = simulation.wall_contacts()
    assert contacts.wall[:, 1].tolist() == [2, 3]
    assert contacts.force == pytest.approx([7.0, 7.0], rel=1e-6, abs=1e-9 * mass / scene.dt)
    assert np.abs(simulation.velocity).max() < 1e-9
    assert simulation.state().driven[2] == pytest.approx((0.05, 0.0), abs=1e-8)
    assert np.abs(contacts.gap).max() < 1e-8


def test_a_snapshot_has_the_normals_of_the_step() -> None:
    """A grain touches the end of a piston, so that the normal turns as the piston moves."""
    simulation = Simulation(pressed(pressure=None, walls=[DRIVEN], gravity=(0.0, -1.0)))
    for _ in range(60):
        simulation.step()
        walls = simulation.wall_contacts()
        of_walls = analysis.snapshot(simulation).loads.normal[len(walls.normal) * -1 :]
        if len(walls.normal):
            assert of_walls == pytest.approx(walls.normal, abs=1e-12)  # positions are taken back by dt v


@pytest.mark.parametrize("method", ["gauss-seidel", "accelerated"])
def test_a_rough_lid_moves_as_one(method: str) -> None:
    """Its rows stay where they are on the line, and once grains rest, line and rows carry the pressure."""
    lid = {"pressure": 30.0, "mass": 1.0, "velocity": (0.5, 0.0), "to_time": 0.1, "roughness": BUMPS}
    scene = boxed("rough lid", top=lid, drag=0.3, method=method, max_iterations=1000)
    simulation = Simulation(scene)
    simulation.advance(1200)
    now, contacts = simulation.present_scene, simulation.wall_contacts()
    moved = [np.subtract(wall.point, was.point) for wall, was in zip(now.walls, scene.walls, strict=True)]
    assert simulation.driven[2, 0] > 0.05
    assert (simulation.driven[3:] == 0.0).all()
    down = -simulation.driven[2, 0]  # a line that moves along itself stays where it is
    assert np.allclose(moved, [(0.0, 0.0), (0.0, down), *[(0.05, down)] * 2], rtol=0.0, atol=1e-14)
    tangent = np.stack([-contacts.normal[:, 1], contacts.normal[:, 0]], axis=1)
    on_wall = contacts.force[:, None] * contacts.normal + contacts.tangential_force[:, None] * tangent
    assert on_wall[contacts.wall[:, 1] > 2, 1].sum() == pytest.approx(30.0, abs=1e-2)
    assert set(contacts.wall[:, 1]) > {4}


@pytest.mark.parametrize("scheme", ["text", "leapfrog"])
def test_the_reported_overlap_is_that_after_walls_moved(scheme: str) -> None:
    """A few sweeps leave grains in a fast piston and in a circle that shrinks."""
    piston = replace(DRIVEN, force=-200.0, mass=20.0)
    scene = pressed(60, max_iterations=2, walls=[piston], wall_mass=5.0, scheme=scheme)
    simulation, at_piston = Simulation(scene), 0
    for _ in range(60):
        report, now, x = simulation.step(), simulation.present_scene, simulation.position
        distance = np.hypot(*(x[:, None] - x[None]).T) - np.add.outer(scene.radius, scene.radius)
        walls = [-now.side(wall, x, scene.radius).gap.min() for wall in (0, 2)]
        worst = max(*walls, -distance[np.triu_indices(scene.n, 1)].min(), 0.0)
        assert report.overlap == pytest.approx(worst, rel=1e-9, abs=1e-15)
        at_piston += worst == walls[1]
    assert at_piston > 0


@pytest.mark.parametrize("n", [30, 31])
def test_a_recording_shows_where_walls_are(tmp_path: Path, n: int) -> None:
    simulation = Simulation(pressed(n, walls=[DRIVEN]))
    simulation.run(duration=0.5, record=tmp_path / "run.usdc", forces=True)
    assert report_on_recording(tmp_path / "run.usdc") == [f"OK: 13 frames, {n} grains"]
    recording, now = Recording(tmp_path / "run.usdc"), simulation.present_scene
    assert recording.scene.radius_out == 1.0
    assert recording.scene.walls == (DRIVEN,)
    shown, driven = recording.frame(12).scene, simulation.driven
    assert driven is not None
    assert shown.radius_out == driven[0, 0]
    assert shown.walls == now.walls
    assert now.walls[0].start[1] < 0.4
    assert 0.2 < now.radius_out < 0.99
    simulation.plot(forces=True).save(tmp_path / "end.png")


def test_damaged_places_of_walls_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "run.usda"
    Simulation(pressed(10)).run(steps=20, record=path)
    stage = Usd.Stage.Open(str(path))
    places = stage.GetPrimAtPath(WALLS).GetAttribute(PLACES)
    places.Set([float("inf")], 1)
    stage.Save()
    assert report_on_recording(path) == ["warpgrains:places are not all finite (frame 1)"]
    places.Set([0.9], 1)
    places.ClearAtTime(2)
    stage.Save()
    assert report_on_recording(path) == [
        "Walls.warpgrains:places has other time codes than the grains' positions"
    ]


def test_what_is_not_offered_is_refused() -> None:
    simulation = Simulation(pressed(5))
    simulation.step()
    for question in (certify, analysis.step_energy_balance):
        with pytest.raises(InputError, match="drive"):
            question(simulation)
    with pytest.raises(InputError, match="change: a pressure or a force can be changed, but not given"):
        simulation.change(pressure=None)
    simulation.change(pressure=100.0)
    simulation.step()


@pytest.mark.parametrize("speed", [0.0, -0.05, -3.3])
def test_a_list_holds_for_a_wall_that_comes(c_library: CDLL, speed: float) -> None:
    """Grains at rest keep a list for long; the wall must not come near those that it lists not.

    A light wall creeps, a fast one meets rings of grains in single steps.
    """
    turn = np.linspace(0.0, 2.0 * np.pi, 6)[:-1]
    position = np.concatenate(
        [(d * np.stack([np.cos(turn + d), np.sin(turn + d)], axis=1)) for d in (0.2, 0.5, 0.8)]
    )
    scene = Scene(
        position=position, radius=0.05, mass=0.1, radius_out=1.0, gravity=(0.0, 0.0), pressure=0.02,
        wall_mass=1.0, drag=0.5, tolerance=1e-9,
    )  # fmt: skip
    simulation = Simulation(scene)
    state = simulation.state()
    state.driven[0, 1] = speed
    simulation.restore(state)
    reference = Reference(c_library, scene, state)
    rebuilds = 0
    for _ in range(400):
        rebuilds += simulation.step().rebuilds
        reference.step()
        assert np.array_equal(simulation.position, reference.position)
        assert np.array_equal(simulation.state().driven, reference.driven)
    assert rebuilds < 200
    assert len(simulation.wall_contacts().wall) > 0


def test_a_list_holds_for_a_speed_between_two_sweeps(c_library: CDLL) -> None:
    """In the first sweep, grain 0 lets go of the wall, which then comes at 0.6 m/s until grain 2 stops it.

    By then it has pushed grain 1, which is out of reach of the speeds before and after.
    """
    scene = Scene(
        position=[(0.99, 0.0), (0.0, 0.9845), (-0.9899, 0.0)], radius=0.01, mass=[1.0, 1e-3, 100.0],
        radius_out=1.0, gravity=(0.0, 0.0), pressure=1.0, wall_mass=0.1, tolerance=1e-12, dt=0.01,
    )  # fmt: skip
    state = first_state(scene)
    nobody, kept = np.zeros((0, 2), np.int32), np.array([0.01 * 2.0 * np.pi])
    held = Corrections(nobody, np.zeros(0), np.zeros((1, 2), np.int32), kept)
    state = replace(state, velocity=np.array([(-2.0, 0.0), (0.0, 0.0), (0.0, 0.0)]), corrections=held)
    simulation, reference = Simulation(scene), Reference(c_library, scene, state)
    simulation.restore(state)
    report = simulation.step()
    assert report.iterations == reference.step()[0]
    assert np.array_equal(simulation.driven, reference.driven)
    assert np.array_equal(simulation.velocity, reference.velocity)
    assert abs(simulation.driven[0, 1]) < 0.02


def test_a_wall_that_closes_on_a_grain_is_named() -> None:
    scene = Scene(
        position=[(0.01, 0.02)], radius=0.1, mass=1.0, radius_out=0.2, gravity=(0.0, 0.0), pressure=5.0
    )
    with pytest.raises(SimulationError, match="a driven wall, body 0, reached a speed of"):
        Simulation(scene).advance(2000)
