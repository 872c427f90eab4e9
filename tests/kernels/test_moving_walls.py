"""Walls that move as given in advance, and gravity that turns (31): changes, runs continued, recordings."""

from ctypes import CDLL
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from walled_scenes import BLADE, MOVING, PISTON, RING, STONE, alone, stirred

from warpgrains import Arc, Disc, InputError, Recording, Scene, Segment, Simulation, analysis
from warpgrains.reference.reference import Reference
from warpgrains.scene.gravity import TurningGravity
from warpgrains.scene.toml import parameters_text, read_parameters
from warpgrains.walls.wall import Wall

EPS = np.finfo(float).eps


def test_a_change_of_walls_needs_another_list(c_library: CDLL) -> None:
    """A list that was made for other walls would leave out contacts."""
    simulation = Simulation(stirred(60, gravity=(0.0, 0.0), walls=()))
    simulation.advance(10)
    simulation.change(walls=[Segment((-2.0, -0.3), (2.0, -0.3), velocity=(0.0, 3.0))])
    reference = Reference(c_library, simulation.scene, simulation.state())
    for _ in range(40):
        simulation.step()
        reference.step()
        assert np.array_equal(simulation.position, reference.position)


@pytest.mark.parametrize("fields", [{"walls": (STONE,)}, {"gravity": {"angular_velocity": 1.0}}])
def test_a_change_of_dt_moves_no_wall_and_turns_no_gravity(fields: dict[str, Any]) -> None:
    """Both are where the time puts them, which goes on: t_0 + 20 dt is rounded three times, below 1 s."""
    simulation = Simulation(stirred(20, **{"walls": (), "gravity": (0.0, -9.81), **fields}))
    simulation.advance(20)
    for dt in (1e-3, 0.01):
        simulation.change(dt=dt)
        assert simulation.time == pytest.approx(0.1, rel=0, abs=3 * EPS)
    simulation.step()
    assert simulation.time == pytest.approx(0.11, rel=0, abs=4 * EPS)


@pytest.mark.parametrize(
    "wall", [*MOVING, Arc((0.3, 0.1), 0.2, 0.0, 1.0, angular_velocity=2.0, pivot=(1, 1))]
)
def test_a_wall_given_as_it_is_at_a_time_moves_on_alike(wall: Wall) -> None:
    """Before, during and after its motion. Numbers of order 1 are rounded some ten times."""
    position = np.random.default_rng(2).uniform(-0.9, 0.9, (40, 2))
    radius, wall = np.full(40, 0.05), wall.starting(0.05)
    for given in (0.0, 0.3, 0.9):
        for later in (given, given + 0.2, 1.5):
            sides = [own.side_at(later, position, radius) for own in (wall, wall.at(given))]
            for one, other in zip(*sides, strict=True):
                assert np.abs(one - other).max() < 64 * EPS / 0.05


def test_a_scene_of_the_present_goes_on(tmp_path: Path) -> None:
    """A grain that a blade lifts and gravity that turns pulls: the steps after it are those of one run.

    Contacts begin without corrections, which a tolerance of 0 makes good; numbers of order 1 are rounded in
    every step. Speeds follow from gaps / dt, and spins from speeds / 0.1.
    """
    moves: dict[str, Any] = {
        "velocity": (0.1, 0.5),
        "angular_velocity": 0.2,
        "start_time": 0.1,
        "end_time": 0.6,
    }
    fields: dict[str, Any] = {"scheme": "euler", "tolerance": 0.0, "max_iterations": 10, "dt": 1e-3}
    fields |= {"gravity": {"angular_velocity": 0.3}, "friction": 0.3}
    whole = alone((0.0, -0.39), [Segment((-1.0, -0.5), (1.0, -0.5), **moves)], **fields)
    whole.advance(300)
    scene = whole.present_scene
    assert (scene.time, scene.walls[0].start_time) == (whole.time, whole.time)
    # a step turns the blade by 2e-4: half the square of that times 0.1 m is left, and what slips (26b)
    assert np.allclose(scene.walls[0].side(whole.position, scene.radius).gap, 0.0, atol=3e-9)
    assert scene.text == whole.scene.text
    anew = Simulation(scene.replace(name="anew"))
    for simulation in (whole, anew):
        simulation.advance(400)
    assert anew.time == pytest.approx(0.7, rel=0, abs=1e-15)
    assert np.abs(anew.position - whole.position).max() < 700 * EPS
    assert np.abs(anew.spin - whole.spin).max() < 700 * EPS / (1e-3 * 0.1)
    anew.run(steps=5, record=tmp_path / "run.usdc", fps=1000.0)
    first = Recording(tmp_path / "run.usdc").frame(0, contacts=False)
    assert first.time == pytest.approx(0.7, rel=0, abs=1e-15)


def test_walls_that_are_new_begin_to_move_now() -> None:
    """The others move on from their times; a scene that starts at a time has both kinds, too."""
    simulation = Simulation(stirred(20, walls=(STONE,)))
    simulation.advance(20)
    new = Segment((-0.9, 0.0), (-0.8, 0.0), velocity=(0.0, 0.1))
    simulation.change(walls=[*simulation.scene.walls, new])
    simulation.advance(10)
    stone, segment, _ = simulation.present_scene.walls
    assert np.allclose(stone.middle, STONE.starting(0.0).at(simulation.time).middle, rtol=0, atol=1e-15)
    assert np.allclose(segment.middle, (-0.85, 0.005), rtol=0, atol=1e-15)
    later = stirred(20, walls=(replace(STONE, start_time=0.1), new), time=0.3)
    assert [wall.start_time for wall in later.walls] == [0.1, 0.3, None]


ONE: dict[str, Any] = {"position": [(0.0, 0.5)], "radius": 0.1, "mass": 1.0, "radius_out": 1.0}


def test_grains_are_laid_out_and_checked_where_walls_are_at_the_start() -> None:
    scene = Scene.load("collapse", ["time.time=100.0"])
    assert any(wall.at(100.0) != wall for wall in scene.walls)
    assert scene.count_overlaps()[:2] == (0, 0)
    disc = Disc((0.0, 0.0), 0.2, velocity=(0.0, 0.5), start_time=0.0)
    with pytest.raises(InputError, match=r"grain 0 is \(0.0, 0.5\): its center is inside walls\[0\]"):
        Scene(**ONE, walls=[disc], time=1.0)


def test_grains_that_a_piston_crushes_are_named() -> None:
    """Between a piston and the outer wall, a column of three grains fits until the piston comes down."""
    piston = Segment((-0.5, -0.38), (0.5, -0.38), velocity=(0.0, -0.5))
    position = [(0.0, -0.9), (0.0, -0.7), (0.0, -0.5), (0.0, 0.6)]
    simulation = Simulation(Scene(**ONE | {"position": position}, walls=[piston], max_iterations=100_000))
    simulation.advance(42)
    assert simulation.infeasible_grains() == (0, 1, 2)


def test_a_recording_in_which_a_grain_is_where_a_wall_was(tmp_path: Path) -> None:
    """Its scene begins with the first frame: with the wall where it is by then."""
    scene = Scene(**ONE, walls=[Disc((0.0, 0.0), 0.2, velocity=(0.8, 0.0), end_time=0.7)], dt=1e-3)
    simulation = Simulation(scene)
    simulation.advance(320)
    assert scene.walls[0].covers(simulation.position).all()
    simulation.run(steps=20, record=tmp_path / "run.usdc", fps=1000.0, forces=True)
    recording, now = Recording(tmp_path / "run.usdc"), analysis.snapshot(simulation)
    frame = recording.frame(-1)
    assert (frame.steps, frame.scene.walls) == (340, scene.walls)
    assert np.array_equal(frame.position, now.position.astype(np.float32))
    assert (recording.scene.time, recording.scene.walls[0]) == (0.32, scene.walls[0].at(0.32))
    Simulation(recording.scene).step()


def test_a_recording_of_a_later_state_has_its_normals(tmp_path: Path) -> None:
    """Walls are where they are at the time of a frame, not at the time since the first frame."""
    simulation = Simulation(stirred(60, walls=(PISTON, BLADE, RING), dt=1e-3, order="color"))
    simulation.advance(500)
    simulation.run(steps=20, record=tmp_path / "run.usdc", fps=1000.0, forces=True)
    recording, now = Recording(tmp_path / "run.usdc"), analysis.snapshot(simulation)
    frame = recording.frame(-1)
    assert (frame.steps, frame.time) == (520, simulation.time)
    assert {0, 1} <= set(frame.wall[:, 1].tolist())
    assert np.array_equal(frame.wall, now.wall)
    # grains move by about 2 mm in a step, where the blade has turned by 1 rad
    assert np.abs(frame.loads.normal - now.loads.normal).max() < 0.02
    of_walls = frame.loads.normal[2 * len(frame.pair) :]
    for table, own in (("contacts", frame.normal), ("wall_contacts", of_walls)):
        rows = recording.to_pandas(table)
        assert np.array_equal(rows[["normal_x", "normal_y"]][rows.frame == 20], own)


G, RATE = complex(3.0, -9.0), -2.5
TURNED = {"vector": (G.real, G.imag), "angular_velocity": RATE}


def grain(**changes: Any) -> Scene:
    """Return one grain in a wide domain, at rest at first."""
    fields = {"position": [[0.5, 0.25]], "radius": 0.25, "mass": 0.5, "radius_out": 90.0, "gravity": TURNED}
    return Scene(**{**fields, **changes})


@pytest.mark.parametrize(("scheme", "order"), [("euler", 1.0), ("leapfrog", 2.0)])
@pytest.mark.parametrize(("turning", "rate"), [(RATE, 0.0), (RATE, 3.0), (0.0, 2.0), (0.0, 30.0)])
def test_free_flight_has_the_order_of_the_scheme(
    turning: float, rate: float, scheme: str, order: float
) -> None:
    """v = (v_0 - A) exp(-k t) + A exp(i w t), A = G / (k + i w), with drag at a rate k."""
    v0, end, turn = 1.0 + 0.5j, 0.2 if rate > 10.0 else 1.0, 1j * turning
    forced = G / (rate + turn)
    exact = (v0 - forced) * integral(-rate, end) + forced * integral(turn, end)
    given = {"velocity": [[v0.real, v0.imag]], "drag": 0.5 * rate, "scheme": scheme}
    given["gravity"] = {"vector": (G.real, G.imag), "angular_velocity": turning}
    errors = []
    for steps in (100, 200):
        flight = Simulation(grain(dt=end / steps, **given))
        flight.advance(steps)
        moved = flight.position[0] - flight.scene.position[0]
        errors.append(abs(complex(*moved) - exact))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1)


def integral(rate: complex, time: float) -> complex:
    """Return that of exp(rate t)."""
    return (np.exp(rate * time) - 1.0) / rate if rate else time


def test_heights_and_energies_follow_gravity() -> None:
    scene = grain(gravity={"vector": (0.0, -8.0), "angular_velocity": np.pi / 2.0}, drag=49.0, dt=0.01)
    simulation = Simulation(scene)
    simulation.advance(100)
    assert scene.gravity_at(simulation.time) == pytest.approx((8.0, 0.0))
    (x, _), now = simulation.position[0], analysis.snapshot(simulation)
    assert now.position @ now.scene.up_at(now.time) == pytest.approx([-x])
    assert analysis.potential_energy(now) == pytest.approx(-0.5 * 8.0 * x)
    assert analysis.height_profile(now).velocity.any()


def test_a_scene_keeps_it(tmp_path: Path) -> None:
    """In text, copies and recordings; `vector` is that of the Earth by default, and 0 rad/s is constant."""
    scene = Scene.load("annulus", ["physics.gravity={angular_velocity = 0.05}"])
    assert scene.gravity == TurningGravity((0.0, -9.81), 0.05)
    assert scene.summary()["gravity"] == "(0, -9.81) m/s2, turning at 0.05 rad/s"
    assert scene.replace(drag=0.1).gravity == scene.gravity
    read = read_parameters(parameters_text(scene))
    assert scene.replace(gravity=read["gravity"]).gravity == scene.gravity
    Simulation(scene).run(steps=4, record=tmp_path / "run.usdc")
    assert Recording(tmp_path / "run.usdc").scene.gravity == scene.gravity
    constant = scene.replace(gravity={"vector": (1.0, 2.0), "angular_velocity": 0.0})
    assert constant.gravity == (1.0, 2.0)
    assert constant.gravity_at(5.0) is constant.gravity
