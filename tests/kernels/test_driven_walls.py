"""Walls that forces drive: lists, rows that move along, and recordings."""

from ctypes import CDLL
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hard_scenes import ROUGH, SOON
from pxr import Usd
from swept_order import follow_reference
from walled_scenes import BUMPS, DRIVEN, WALLED, boxed, force_on, on_circle, pressed

from warpgrains import InputError, Recording, Scene, Simulation, SimulationError, analysis
from warpgrains.accuracy import certify
from warpgrains.scene.state import Corrections, first_state
from warpgrains.usd.check import report_on_recording
from warpgrains.usd.meshes import PLACES, WALLS


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
    lid = {"pressure": 30.0, "mass": 1.0, "velocity": (0.5, 0.0), "end_time": 0.1, "roughness": BUMPS}
    scene = boxed("rough lid", top=lid, drag=0.3, method=method, max_iterations=1000)
    simulation = Simulation(scene)
    simulation.advance(1200)
    now, contacts = simulation.present_scene, simulation.wall_contacts()
    moved = [np.subtract(wall.point, was.point) for wall, was in zip(now.walls, scene.walls, strict=True)]
    assert simulation.driven[1, 0] > 0.05
    assert (simulation.driven[2:] == 0.0).all()
    down = -simulation.driven[1, 0]  # a line that moves along itself stays where it is
    assert np.allclose(moved, [(0.0, 0.0), (0.0, down), *[(0.05, down)] * 2], rtol=0.0, atol=1e-14)
    assert force_on(contacts)[contacts.wall[:, 1] > 0, 1].sum() == pytest.approx(30.0, abs=1e-2)
    assert set(contacts.wall[:, 1]) > {2}


@pytest.mark.parametrize(
    "kind",
    [
        *("pressure", "pressure, a light wall", "pressure, a heavy wall", "pressure, two circles"),
        *("a driven segment", "box, smooth lid", "box, bouncing"),
    ],
)
def test_steps_solved_exactly_are_those_of_many_sweeps(kind: str) -> None:
    """Without friction there is one solution, of grains and walls."""
    scene = WALLED[kind](**SOON)
    sweeps = {"method": "gauss-seidel", "stop": "residual", "tolerance": 1e-12, "max_iterations": 100_000}
    simulation, other, asked = Simulation(scene), Simulation(scene.replace(**sweeps)), 0
    for _ in range(20):
        other.restore(simulation.state())
        report = simulation.step()
        assert report.converged
        assert other.step().converged
        asked += report.factorizations
        now, swept = (np.append(one.velocity, one.driven[:, 1]) for one in (simulation, other))
        # residuals of 1e-10 m/s by some contacts each, as far as soft piles magnify them
        assert np.abs(now - swept).max() <= 100.0 * scene.tolerance
    assert asked > 0


@pytest.mark.parametrize("kind", ["pressure, a light wall", "pressure, a heavy wall", "box, rough lid"])
def test_steps_with_friction_are_solved_exactly(kind: str) -> None:
    """They end within the tolerance for velocities that the kernels compute from the corrections."""
    scene = WALLED[kind](**{**ROUGH, "max_iterations": 300})
    simulation, asked = Simulation(scene), 0
    for _ in range(80):
        report = simulation.step()
        assert report.converged
        asked += report.factorizations
    assert asked > 0


def test_a_recording_shows_where_walls_are(tmp_path: Path) -> None:
    simulation = Simulation(pressed(30, walls=[DRIVEN]))
    simulation.run(duration=0.5, record=tmp_path / "run.usdc", forces=True)
    assert report_on_recording(tmp_path / "run.usdc") == ["OK: 13 frames, 30 grains"]
    recording, now = Recording(tmp_path / "run.usdc"), simulation.present_scene
    shown, (segment, circle) = recording.frame(12).scene, simulation.driven[:, 0]
    assert (recording.scene.radius_out, recording.scene.walls[0]) == (1.0, DRIVEN)
    assert (shown.radius_out, shown.walls) == (now.radius_out, now.walls)
    assert now.radius_out == circle
    assert now.walls[0].start == pytest.approx((-0.6, 0.5 + segment), rel=1e-15)
    assert 0.2 < now.radius_out < 0.99
    assert segment < -0.1
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
    found = "Walls.warpgrains:places has other time codes than the grains' positions"
    assert found in report_on_recording(path)


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


WEIGHTLESS: dict[str, Any] = {"radius_out": 1.0, "gravity": (0.0, 0.0)}


@pytest.mark.parametrize("speed", [0.0, -0.05, -3.3])
def test_a_list_holds_for_a_wall_that_comes(c_library: CDLL, speed: float) -> None:
    """Grains at rest keep a list for long; the wall must not come near those that it lists not.

    A light wall creeps, a fast one meets rings of grains in single steps.
    """
    position = np.concatenate([d * on_circle(np.arange(5) * 0.4 * np.pi + d) for d in (0.2, 0.5, 0.8)])
    given = {"radius": 0.05, "mass": 0.1, "pressure": 0.02, "wall_mass": 1.0, "drag": 0.5, "tolerance": 1e-9}
    scene = Scene(**WEIGHTLESS, **given, position=position)
    state = first_state(scene)
    state.driven[0, 1] = speed
    met = follow_reference(scene, 400, c_library, state=state)
    assert sum(report.rebuilds for report in met.reports) < 200
    assert met.reports[-1].contacts > 0


def test_a_list_holds_for_a_speed_between_two_sweeps(c_library: CDLL) -> None:
    """In the first sweep, grain 0 lets go of the wall, which then comes at 0.6 m/s until grain 2 stops it.

    By then it has pushed grain 1, which is out of reach of the speeds before and after.
    """
    position, velocity = [(0.99, 0.0), (0.0, 0.9845), (-0.9899, 0.0)], [(-2.0, 0.0), (0.0, 0.0), (0.0, 0.0)]
    given = {"radius": 0.01, "mass": [1.0, 1e-3, 100.0], "wall_mass": 0.1, "tolerance": 1e-12}
    scene = Scene(**WEIGHTLESS, **given, position=position, velocity=velocity, pressure=1.0)
    nobody, kept = np.zeros((0, 2), np.int32), np.array([0.01 * 2.0 * np.pi])
    held = Corrections(nobody, np.zeros(0), np.zeros((1, 2), np.int32), kept)
    state = replace(first_state(scene), corrections=held)
    follow_reference(scene, 2, c_library, state=state)
    simulation = Simulation(scene, state=state)
    simulation.step()
    assert abs(simulation.driven[0, 1]) < 0.02


def test_a_wall_that_closes_on_a_grain_is_named() -> None:
    scene = Scene(
        **WEIGHTLESS | {"radius_out": 0.2}, position=[(0.01, 0.02)], radius=0.1, mass=1.0, pressure=5.0
    )
    with pytest.raises(SimulationError, match="a driven wall, body 0, reached a speed of"):
        Simulation(scene).advance(2000)
