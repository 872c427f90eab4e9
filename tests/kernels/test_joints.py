"""Joints of walls: grains pass those that are no corner, and corners hold them (MODEL.md, eq. 8c)."""

from ctypes import CDLL
from math import cos, pi, sin, tau

import numpy as np
import pytest
from swept_order import follow_reference
from trimmed import trimmed
from walled_scenes import CORNERS, alone, chained, cornered, on_circle

from warpgrains import Arc, Disc, Scene, Segment, Simulation
from warpgrains.scene.bodies import Joints
from warpgrains.solver import tuning
from warpgrains.solver.exact.listed import listed_walls

LEFT, RIGHT, UP = (-2.0, 0.0), (2.0, 0.0), (2.0, 1.0)


@pytest.mark.parametrize("rolling", [{}, {"friction": 0.5, "spin": -10.0}], ids=["slides", "rolls"])
@pytest.mark.parametrize("segments", [1, 2, 40])
def test_a_grain_keeps_its_speed_along_segments_in_line(segments: int, rolling: dict[str, float]) -> None:
    line = np.stack([np.linspace(-2.0, 2.0, segments + 1), np.full(segments + 1, -1.0)], axis=1)
    simulation = alone((-1.5, -0.9), chained(line), (1.0, 0.0), **rolling)
    simulation.advance(300)
    # each of 300 steps may leave the tolerance, 1e-12 m/s
    assert simulation.velocity[0] == pytest.approx((1.0, 0.0), abs=3e-10)
    assert simulation.position[0] == pytest.approx((1.5, -0.9), abs=1e-9)


def test_a_change_of_walls_changes_their_joints() -> None:
    """A lid is lowered onto the line that it is joined with, in place; then it moves, and is no joint."""
    line = [Segment((-2.0, 0.0), (0.0, 0.0)), Segment((0.0, 0.0), (2.0, 0.0))]
    simulation = alone((-1.5, 0.1), [line[0], Segment((0.0, -1.0), (2.0, -1.0))], (1.0, 0.0))
    simulation.advance(50)
    simulation.change(walls=line)
    simulation.advance(200)
    assert simulation.velocity[0] == pytest.approx((1.0, 0.0), abs=3e-10)
    simulation.change(walls=[line[0], Segment((0.0, 0.0), (2.0, 0.0), velocity=(1.0, 0.0))])
    assert simulation.scene.joints.others == []
    simulation.advance(20)


@pytest.mark.parametrize("dt", [0.01, 0.005])
def test_a_grain_rolls_down_a_slope_of_segments(dt: float) -> None:
    """It gains 2/3 g sin(theta), as on one segment."""
    theta = pi / 9.0
    down, up = np.array([cos(theta), -sin(theta)]), np.array([sin(theta), cos(theta)])
    slope = chained(np.linspace(-0.5, 2.0, 41)[:, np.newaxis] * down)
    simulation = alone(tuple(0.1 * up), slope, (0.0, 0.0), friction=0.6, dt=dt)
    simulation.advance(round(1.0 / dt))
    way = (simulation.position[0] - 0.1 * up) @ down
    assert way == pytest.approx(9.81 * sin(theta) / 3.0, abs=1e-9)  # of second order: exact but for rounding


@pytest.mark.parametrize("speed", [1.0, 3.0])
def test_a_grain_climbs_a_smooth_chute(speed: float) -> None:
    """A floor, an arc and an upright: it gets as high as its energy does."""
    walls = [
        Segment((-3.0, 0.0), (0.0, 0.0)),
        Arc((0.0, 1.0), 1.0, -pi / 2, 0.0),
        Segment((1.0, 1.0), (1.0, 4.0)),
    ]
    simulation, heights = alone((-1.5, 0.1), walls, (speed, 0.0)), []
    while simulation.velocity[0, 0] > -0.5 * speed:
        simulation.step()
        heights.append(simulation.position[0, 1] - 0.1)
    # the tangents of the arc, of radius 0.9 m at the center, are left by up to (v dt)^2 / 1.8
    assert max(heights) == pytest.approx(speed**2 / 19.62, abs=(0.01 * speed) ** 2 / 1.8)
    assert simulation.velocity[0, 0] < -0.5 * speed


def test_two_half_arcs_are_a_ring() -> None:
    halves = [Arc((0.0, 0.0), 1.0, 0.0, pi), Arc((0.0, 0.0), 1.0, pi, tau - 1e-12)]
    half, whole = (
        alone((0.9, 0.0), walls, (0.0, 1.0), gravity=(0.0, 0.0))
        for walls in (halves, [Disc((0.0, 0.0), 1.0, inside=True)])
    )
    for simulation in (half, whole):
        simulation.advance(2800)  # five rounds
    assert half.velocity[0] == pytest.approx(whole.velocity[0], abs=1e-9)  # 2800 steps of 1e-12 m/s each


@pytest.mark.parametrize("dt", [0.013, 0.05])
@pytest.mark.parametrize("turn", [1e-3, 0.1, 0.7, 1.4])
def test_a_corner_takes_the_speed_across_the_wall_behind_it(turn: float, dt: float) -> None:
    """Of v, v cos(turn) is left on the other wall, also after a step of half a radius."""
    floor, slope = Segment((-2.0, 0.0), (0.0, 0.0)), Segment((2.0 * cos(turn), 2.0 * sin(turn)), (0.0, 0.0))
    simulation = alone((-0.7, 0.1), [floor, slope], (1.0, 0.0), gravity=(0.0, 0.0), dt=dt)
    for _ in range(round(1.2 / dt)):
        simulation.step()
        assert slope.side(simulation.position, simulation.scene.radius).gap[0] > -1e-13
    left = cos(turn) * np.array([cos(turn), sin(turn)])
    assert simulation.velocity[0] == pytest.approx(left, abs=1e-10)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_ramp_just_behind_a_joint_is_seen_from_its_side_only(side: float) -> None:
    """A grain on the floor is before the joint, and past the foot of the ramp after the next step."""
    ramp = Segment((0.03, 0.0), (1.0, 0.6))
    floor = [Segment((-2.0, 0.0), (0.0, 0.0)), Segment((0.0, 0.0), (2.0, 0.0))]
    simulation = alone((-0.68, 0.1 * side), [*floor, ramp], (7.0, 0.0), gravity=(0.0, 0.0))
    for _ in range(20):
        simulation.step()
        assert ramp.side(simulation.position, simulation.scene.radius).gap[0] > -1e-13
    assert (simulation.velocity[0, 1] > 1.0) == (side > 0.0)
    assert side > 0.0 or simulation.velocity[0] == pytest.approx((7.0, 0.0), abs=1e-10)


@pytest.mark.parametrize("walls", [(0, 1, 2), (1, 0, 2), (2, 1, 0)])
def test_a_convex_corner_lets_a_grain_go(walls: tuple[int, ...]) -> None:
    """Without gravity it flies on, past a third wall that hangs from the corner."""
    corner = [
        Segment((-2.0, 0.0), (0.0, 0.0)),
        Segment((0.0, 0.0), (1.0, -1.0)),
        Segment((0.0, -1.0), (0.0, 0.0)),
    ]
    simulation = alone((-0.7, 0.1), [corner[k] for k in walls], (1.0, 0.0), gravity=(0.0, 0.0))
    simulation.advance(200)
    assert simulation.velocity[0] == pytest.approx((1.0, 0.0), abs=2e-10)


def test_a_grain_rests_on_a_corner() -> None:
    """Both walls have the corner as nearest point: one of them carries the weight."""
    roof = [Segment((-1.0, -1.0), (0.0, 0.0)), Segment((0.0, 0.0), (1.0, -1.0))]
    simulation = alone((0.0, 0.1), roof, (0.0, 0.0))
    simulation.advance(10)
    contacts = simulation.wall_contacts()
    assert contacts.wall.tolist() == [[0, 2]]
    assert contacts.force == pytest.approx([9.81], rel=1e-12)
    assert contacts.gap == pytest.approx([0.0], abs=1e-15)


def test_a_wall_whose_tangent_may_act_is_listed(c_library: CDLL, monkeypatch: pytest.MonkeyPatch) -> None:
    """The wall comes first, and corrects a fall that the floor has not stopped yet.

    A grain that moves oppositely makes lists short, which reach no farther than they must.
    """
    monkeypatch.setattr(tuning, "BASE_SKIN", 1e-12)
    walls = [Segment((0.0, 0.0), (1.0, 1e-3)), Segment((-2.0, 0.0), (0.0, 0.0))]
    for x in (-0.105, -0.12, -0.17):
        scene = Scene(
            position=[(x, 0.125), (x, 3.0)],
            velocity=[(0.0, -1.0), (0.0, 1.0)],
            radius=0.1,
            mass=1.0,
            radius_out=6.0,
            gravity=(0.0, 0.0),
            walls=walls,
        )
        assert follow_reference(scene, 10, c_library).touched == {3}


@pytest.mark.parametrize("corners", ["zigzag", "chute"])
def test_the_host_has_normal_and_gap_of_the_kernels(corners: str) -> None:
    """To the bit: they choose the same wall at a joint."""
    scene, dropped = cornered(CORNERS[corners]), 0
    simulation = Simulation(scene, threads=1)
    for _ in range(60):
        simulation.step()
        body, index = listed_walls(simulation._records, 0)
        inside = body[:, 1] > 0  # the annulus is body 0
        wall, frozen = body[inside] + (0, 1), simulation._records.array(0, "contacts.contact")[index[inside]]
        normal, gap = scene.wall_frames(simulation.last_start().position, wall)
        assert np.array_equal(normal, frozen["n"])
        assert np.array_equal(gap / scene.dt, frozen["gap_rate"])
        dropped += np.count_nonzero(gap >= scene.annulus.diameter)
    assert dropped > 0


def test_ends_on_walls_are_joints_if_the_walls_move_alike() -> None:
    gate = Segment(LEFT, (0.0, 1e-10))  # an end within 1e-9 of the length, and in the middle of the other
    lid, ring = Segment((-1.0, 0.0), (1.0, 0.0)), Disc((0.0, 1.0), 1.0)
    assert Joints((gate, lid, ring)).others == [[], [1, 2], [0], [], [], []]
    for moves in ({"velocity": (0.0, 1.0)}, {"angular_velocity": 1.0}, {"force": 1.0, "mass": 1.0}):
        own = Segment(LEFT, (0.0, 0.0), **moves)  # type: ignore[arg-type]
        other = Segment(RIGHT, (0.0, 0.0), **moves)  # type: ignore[arg-type]
        assert Joints((own, lid)).others == []
        assert bool(Joints((own, other)).others) is ("velocity" in moves)
    assert Joints((Segment(LEFT, UP), Segment(LEFT, (2.0, 1.0 + 1e-8)))).others == [[1], [], [0], []]


def polygon_scene(seed: int) -> Scene:
    """Return grains in and around a polygon of random corners, with walls in line, and others on its sides.

    No wall is shorter than the radius, and grains are as fast as a radius a step.
    """
    rng = np.random.default_rng(seed)
    angle = np.cumsum(rng.uniform(0.5, 2.0, 12))
    angle = angle[angle < tau - 0.5]
    corners = rng.uniform(0.45, 1.0, (len(angle), 1)) * on_circle(angle)
    sides = np.roll(corners, -1, axis=0) - corners
    cuts = [np.append(0.0, np.sort(rng.uniform(0.25, 0.75, rng.integers(3)))) for _ in corners]
    points = np.concatenate(
        [a + cut[:, np.newaxis] * b for a, b, cut in zip(corners, sides, cuts, strict=True)]
    )
    walls = chained(np.append(points, points[:1], axis=0))
    for k in rng.integers(len(corners), size=rng.integers(4)).tolist():
        foot = corners[k] + rng.choice([0.0, rng.uniform(0.2, 0.8)]) * sides[k]
        walls += chained(
            np.array([foot, foot + rng.uniform(0.1, 0.6) * on_circle(rng.uniform(0.0, tau, 1))[0]])
        )
    walls = [walls[k] for k in rng.permutation(len(walls))]
    radius = min(rng.uniform(0.03, 0.06), *(2.0 * wall.circle[2] for wall in walls))
    position = np.zeros((0, 2))
    for x in rng.uniform(-1.0, 1.0, (100, 1, 2)):
        is_clear = all(wall.side(x, np.array([radius])).gap > 0.0 for wall in walls)
        if len(position) < 12 and is_clear and (np.hypot(*(x - position).T) > 2.0 * radius).all():
            position = np.append(position, x, axis=0)
    n = len(position)
    return Scene(
        position=position,
        velocity=radius / 0.01 * rng.uniform(0.1, 1.0, (n, 1)) * on_circle(rng.uniform(0.0, tau, n)),
        radius=radius,
        mass=rng.uniform(0.5, 2.0, n),
        radius_out=50.0,
        walls=walls,
        dt=0.01,
        gravity=(0.0, -9.81 * (seed % 2)),
        friction=0.4 * (seed % 3 == 0),
        tolerance=1e-9,
        stop="residual",
        max_iterations=20_000,
    )


def energy(simulation: Simulation) -> float:
    scene = simulation.scene
    spin = simulation.spin if scene.has_friction else np.zeros(scene.n)
    moving = scene.mass * (simulation.velocity**2).sum(axis=1)
    return 0.5 * float((moving + scene.inertia * spin**2).sum())


@pytest.mark.parametrize("count", [8, pytest.param(trimmed(1000), marks=pytest.mark.slow)])
def test_no_grain_overlaps_a_polygon_or_gains_energy(count: int) -> None:
    for seed in range(count):
        simulation = Simulation(polygon_scene(seed), threads=1)
        scene = simulation.scene
        for _ in range(40):
            before, report = energy(simulation), simulation.step()
            gaps = [wall.side(simulation.position, scene.radius).gap.min() for wall in scene.walls]
            # rounding of coordinates and energies, of some 1 m and 1 J; gravity adds to the latter
            assert -min(gaps) <= scene.dt * report.residual + 1e-14, seed
            assert seed % 2 or energy(simulation) <= before * (1.0 + 1e-14), seed
