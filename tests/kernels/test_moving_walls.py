"""Walls that move as given in advance: against the C reference, closed forms, and runs that are continued.

Some cases have gravity that turns, too.
"""

from ctypes import CDLL
from dataclasses import replace
from math import cos, cosh, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from random_scenes import random_walls
from trimmed import trimmed
from walled_scenes import BLADE, PISTON, RING, ROUGH_MOVING, STIRRED_ROUGH, STONE, TURNING, alone, stirred

from warpgrains import Arc, Disc, InputError, Recording, Scene, Segment, Simulation, analysis
from warpgrains.accuracy import certify
from warpgrains.reference.reference import Reference
from warpgrains.scene.wall import Wall


def test_a_lift_carries_a_grain() -> None:
    lift = Segment((-1.0, 0.0), (1.0, 0.0), velocity=(0.0, 0.5), from_time=0.1, to_time=0.6)
    simulation = alone((0.0, 0.1), [lift], dt=1e-3)
    simulation.advance(600)
    assert simulation.position[0] == pytest.approx((0.0, 0.1 + 0.5 * 0.5), abs=1e-12)
    simulation.step()  # it is thrown off where the lift stops
    assert simulation.velocity[0, 1] == pytest.approx(0.5 - 9.81e-3)
    simulation.advance(400)
    assert simulation.position[0] == pytest.approx((0.0, 0.35), abs=1e-12)
    assert simulation.wall_contacts().force == pytest.approx([9.81])


def test_a_turning_rod_drives_a_grain_outwards() -> None:
    """On a rod that turns about its end without friction or gravity, its way along the rod is s cosh(w t)."""
    rod = Segment((0.0, 0.0), (2.5, 0.0), angular_velocity=1.0, pivot=(0.0, 0.0))
    simulation = alone((0.5, 0.1), [rod], (-0.1, 0.5), gravity=(0.0, 0.0), dt=1e-3)
    simulation.advance(1000)
    along, up = np.array([cos(1.0), sin(1.0)]), np.array([-sin(1.0), cos(1.0)])
    assert simulation.position[0] @ up == pytest.approx(0.1, abs=1e-6)
    assert simulation.position[0] @ along == pytest.approx(0.5 * cosh(1.0), abs=2e-3)  # of first order in dt


def test_a_belt_drives_a_grain_until_it_rolls() -> None:
    """A disc at rest on a belt of speed V ends at V / 3, with the speed of its rim 2 V / 3."""
    belt = Segment((-2.0, 0.0), (2.0, 0.0), velocity=(1.5, 0.0), friction=0.3)
    simulation = alone((0.0, 0.1), [belt], dt=1e-3)
    simulation.advance(100)
    assert simulation.velocity[0, 0] == pytest.approx(0.3 * 9.81 * 0.1, rel=0.01)  # half a step behind
    simulation.advance(200)
    assert simulation.velocity[0, 0] == pytest.approx(0.5, abs=1e-9)
    assert 0.1 * simulation.spin[0] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("friction", [{}, STIRRED_ROUGH, TURNING], ids=["smooth", "rough", "turning"])
def test_energy_balance_closes(friction: dict[str, Any]) -> None:
    simulation = Simulation(stirred(60, **friction))
    before = analysis.kinetic_energy(simulation)
    balance = analysis.energy_balance(simulation, steps=100)
    gained = balance.gravity_work + balance.wall_work - balance.drag_loss - balance.contact_loss
    assert analysis.kinetic_energy(simulation) - before == pytest.approx(gained, abs=1e-9)
    assert balance.wall_work > 0.0


@pytest.mark.parametrize("method", ["gauss-seidel", "accelerated", "exact"])
def test_all_methods_find_the_exact_step(method: str) -> None:
    gravity = TURNING["gravity"]
    scene = stirred(
        60, method=method, stop="residual", tolerance=1e-8, max_iterations=20_000, gravity=gravity
    )
    simulation = Simulation(scene)
    simulation.advance(60)
    assert simulation.step().converged
    assert certify(simulation).at_most < 1e-5


def test_accelerated_friction_meets_the_tolerance() -> None:
    simulation = Simulation(stirred(60, method="accelerated", max_iterations=20_000, **STIRRED_ROUGH))
    assert simulation.advance(100).unconverged == 0


@pytest.mark.parametrize("count", [10, pytest.param(trimmed(1000), marks=pytest.mark.slow)])
def test_no_overlap_exceeds_dt_eta(count: int) -> None:
    """After each converged step of random scenes (12); along a concave wall a grain leaves its tangent."""
    fields = {"radius_out": 2.0, "method": "accelerated", "tolerance": 1e-7, "max_iterations": 2000}
    for seed in range(count):
        walls = random_walls(np.random.default_rng(seed), 0.5)
        walls = [wall for wall in walls if not isinstance(wall, Arc) and not getattr(wall, "inside", False)]
        scene = stirred(30, seed, walls, **fields)
        simulation = Simulation(scene)
        for _ in range(60):
            report, x = simulation.step(), simulation.position
            gaps = [wall.side_at(simulation.time, x, scene.radius).gap.min() for wall in walls]
            assert not report.converged or min(gaps, default=0.0) >= -scene.dt * report.residual - 1e-14, seed


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


@pytest.mark.parametrize("fields", [{"walls": (STONE,)}, {"gravity": {"rotate": 1.0}}])
def test_a_change_of_dt_moves_no_wall_and_turns_no_gravity(fields: dict[str, Any]) -> None:
    """Both are where the time puts them, which goes on: t_0 + 20 dt is rounded three times, below 1 s."""
    simulation = Simulation(stirred(20, **{"walls": (), "gravity": (0.0, -9.81), **fields}))
    simulation.advance(20)
    for dt in (1e-3, 0.01):
        simulation.change(dt=dt)
        assert simulation.time == pytest.approx(0.1, rel=0, abs=3 * np.finfo(float).eps)
    simulation.step()
    assert simulation.time == pytest.approx(0.11, rel=0, abs=4 * np.finfo(float).eps)


@pytest.mark.parametrize(
    "wall", [*ROUGH_MOVING, Arc((0.3, 0.1), 0.2, 0.0, 1.0, angular_velocity=2.0, pivot=(1, 1))]
)
def test_a_wall_given_as_it_is_at_a_time_moves_on_alike(wall: Wall) -> None:
    """Before, during and after its motion. Numbers of order 1 are rounded some ten times."""
    position = np.random.default_rng(2).uniform(-0.9, 0.9, (40, 2))
    radius, wall = np.full(40, 0.05), wall.starting(0.05)
    for given in (0.0, 0.3, 0.9):
        for later in (given, given + 0.2, 1.5):
            expected, found = (
                wall.side_at(later, position, radius),
                wall.at(given).side_at(later, position, radius),
            )
            for one, other in zip(expected, found, strict=True):
                assert np.abs(one - other).max() < 64 * np.finfo(float).eps / 0.05


def test_a_scene_of_the_present_goes_on(tmp_path: Path) -> None:
    """A grain that a blade lifts and gravity that turns pulls: the steps after it are those of one run.

    Walls are where they are, with their speeds of later times, and the clock goes on. Contacts begin without
    corrections, which a tolerance of 0 makes good; numbers of order 1 are rounded in every step. Speeds
    follow from gaps / dt, and spins from speeds / 0.1.
    """
    lift = Segment(
        (-1.0, -0.5), (1.0, -0.5), velocity=(0.1, 0.5), angular_velocity=0.2, from_time=0.1, to_time=0.6
    )
    fields: dict[str, Any] = {"scheme": "text", "tolerance": 0.0, "max_iterations": 10}
    whole = alone((0.0, -0.39), [lift], dt=1e-3, gravity={"rotate": 0.3}, friction=0.3, **fields)
    whole.advance(300)
    scene = whole.present_scene
    assert (scene.time, scene.walls[0].from_time) == (whole.time, whole.time)
    assert np.allclose(scene.walls[0].side(whole.position, scene.radius).gap, 0.0, atol=1e-9)
    assert scene.text == whole.scene.text
    anew = Simulation(scene.replace(name="anew"))
    for _ in range(400):
        whole.step()
        anew.step()
    assert anew.time == pytest.approx(0.7, rel=0, abs=1e-15)
    assert np.abs(anew.position - whole.position).max() < 700 * np.finfo(float).eps
    assert np.abs(anew.spin - whole.spin).max() < 700 * np.finfo(float).eps / (1e-3 * 0.1)
    anew.run(steps=5, record=tmp_path / "run.usdc", fps=1000.0)
    assert Recording(tmp_path / "run.usdc").frame(0, contacts=False).time == pytest.approx(
        0.7, rel=0, abs=1e-15
    )


def test_walls_that_are_new_begin_to_move_now() -> None:
    """The others move on from their times; a scene that starts at a time has both kinds, too."""
    simulation = Simulation(stirred(20, walls=(STONE,)))
    simulation.advance(20)
    new = Segment((-0.9, 0.0), (-0.8, 0.0), velocity=(0.0, 0.1))
    simulation.change(walls=[*simulation.scene.walls, new])
    simulation.advance(10)
    stone, segment = simulation.present_scene.walls
    assert np.allclose(stone.middle, STONE.starting(0.0).at(simulation.time).middle, rtol=0, atol=1e-15)
    assert np.allclose(segment.middle, (-0.85, 0.005), rtol=0, atol=1e-15)
    later = stirred(20, walls=(replace(STONE, from_time=0.1), new), time=0.3)
    assert [wall.from_time for wall in later.walls] == [0.1, 0.3]


def test_grains_are_laid_out_and_checked_where_walls_are_at_the_start() -> None:
    scene = Scene.load("collapse", ["time.time=100.0"])
    gate = scene.walls[-1]
    at_start = gate.at(100.0)
    assert at_start != gate
    assert scene.count_overlaps()[:2] == (0, 0)
    with pytest.raises(InputError, match=r"grain 0 is \(0.0, 0.5\): its center is inside walls\[0\]"):
        Scene(
            position=[(0.0, 0.5)],
            radius=0.1,
            mass=1.0,
            radius_out=1.0,
            walls=[Disc((0.0, 0.0), 0.2, velocity=(0.0, 0.5), from_time=0.0)],
            time=1.0,
        )


def test_grains_that_a_piston_crushes_are_named() -> None:
    """Between a piston and the outer wall, a column of three grains fits until the piston comes down."""
    piston = Segment((-0.5, 0.31), (0.5, 0.31), velocity=(0.0, -0.5))
    scene = Scene(
        position=[(0.0, -0.9), (0.0, -0.7), (0.0, -0.5), (0.0, 0.6)],
        radius=0.1,
        mass=1.0,
        radius_out=1.0,
        walls=[piston],
        max_iterations=100_000,
        wall="tangent",
    )
    simulation = Simulation(scene)
    simulation.advance(180)
    assert simulation.infeasible_grains() == (0, 1, 2)


def test_a_recording_in_which_a_grain_is_where_a_wall_was(tmp_path: Path) -> None:
    """Its scene begins with the first frame: with the wall where it is by then."""
    scene = Scene(
        position=[(0.0, 0.5)],
        radius=0.1,
        mass=1.0,
        radius_out=1.0,
        walls=[Disc((0.0, 0.0), 0.2, velocity=(0.8, 0.0), to_time=0.7)],
        dt=1e-3,
    )
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
    scene = stirred(60, walls=(PISTON, BLADE, RING), dt=1e-3, order="color")
    simulation = Simulation(scene)
    simulation.advance(500)
    simulation.run(steps=20, record=tmp_path / "run.usdc", fps=1000.0, forces=True)
    recording, now = Recording(tmp_path / "run.usdc"), analysis.snapshot(simulation)
    frame = recording.frame(-1)
    assert (frame.steps, frame.time) == (520, simulation.time)
    assert {2, 3} <= set(frame.wall[:, 1].tolist())
    assert np.array_equal(frame.wall, now.wall)
    difference = np.abs(frame.loads.normal - now.loads.normal).max()
    assert difference < 0.02  # grains move by about 2 mm in a step, where the blade has turned by 1 rad
    for table, own in (
        ("contacts", frame.normal),
        ("wall_contacts", frame.loads.normal[2 * len(frame.pair) :]),
    ):
        rows = recording.to_pandas(table)
        assert np.array_equal(rows[["normal_x", "normal_y"]][rows.frame == 20], own)
