"""Joints of walls: which there are, how the host finds them, and what corners hold (MODEL.md, eq. 8c)."""

from ctypes import CDLL
from math import tau
from typing import Any

import numpy as np
import pytest
from swept_order import follow_reference
from trimmed import trimmed
from walled_scenes import CORNERS, alone, chained, cornered, on_circle

from warpgrains import Disc, Scene, Segment, Simulation
from warpgrains.analysis import kinetic_energy
from warpgrains.solver import tuning
from warpgrains.solver.exact.listed import listed_walls
from warpgrains.space.geometry import NOWHERE
from warpgrains.walls.bodies import Joints
from warpgrains.walls.wall import Wall


def test_a_change_of_walls_changes_their_joints() -> None:
    """A lid is lowered onto the line that it is joined with, in place; then it moves, and is no joint."""
    line = [Segment((-2.0, 0.0), (0.0, 0.0)), Segment((0.0, 0.0), (2.0, 0.0))]
    simulation = alone((-1.5, 0.1), [line[0], Segment((0.0, -1.0), (2.0, -1.0))], (1.0, 0.0))
    simulation.advance(50)
    simulation.change(walls=line)
    simulation.advance(200)
    assert simulation.velocity[0] == pytest.approx((1.0, 0.0), abs=3e-10)
    simulation.change(walls=[line[0], Segment((0.0, 0.0), (2.0, 0.0), velocity=(1.0, 0.0))])
    assert not simulation.scene.joints
    simulation.advance(20)


def test_a_wall_whose_tangent_may_act_is_listed(c_library: CDLL, monkeypatch: pytest.MonkeyPatch) -> None:
    """The wall comes first, and corrects a fall that the floor has not stopped yet.

    A grain that moves oppositely makes lists short, which reach no farther than they must.
    """
    monkeypatch.setattr(tuning, "BASE_SKIN", 1e-12)
    walls = [Segment((0.0, 0.0), (1.0, 1e-3)), Segment((-2.0, 0.0), (0.0, 0.0))]
    fields: dict[str, Any] = {"radius": 0.1, "mass": 1.0, "radius_out": 6.0, "gravity": (0.0, 0.0)}
    for x in (-0.105, -0.12, -0.17):
        position, velocity = [(x, 0.125), (x, 3.0)], [(0.0, -1.0), (0.0, 1.0)]
        scene = Scene(position=position, velocity=velocity, walls=walls, **fields)
        assert follow_reference(scene, 10, c_library).touched == {1}


@pytest.mark.parametrize("corners", ["zigzag", "chute"])
def test_the_host_has_normal_and_gap_of_the_kernels(corners: str) -> None:
    """To the bit, of all that are listed: they choose the same wall at a joint."""
    scene, dropped = cornered(CORNERS[corners]), 0
    simulation = Simulation(scene, threads=1)
    for _ in range(60):
        simulation.step()
        body, index = listed_walls(simulation._records, 0)
        inside = body[:, 1] > 0  # the annulus is body 0
        wall = body[inside] - (0, 1)
        frozen = simulation._records.array(0, "contacts.contact")[index[inside]]
        normal, gap = scene.wall_frames(simulation.last_start().position, wall)
        assert np.array_equal(normal, frozen["n"])
        assert np.array_equal(gap / scene.dt, frozen["gap_rate"])
        dropped += np.count_nonzero(gap >= 2.0 * scene.reach)
    assert dropped > 0


def others(*walls: Wall) -> list[list[int]]:
    """Return the walls at the joints of both ends of each wall; [] if there are none."""
    joints = Joints(walls, NOWHERE)
    found = [joints.of(k) or [[], []] for k in range(len(walls))]
    return [[wall for wall, _ in own] for ends in found for own in ends] if joints else []


def test_ends_on_walls_are_joints_if_the_walls_move_alike() -> None:
    left, right, up = (-2.0, 0.0), (2.0, 0.0), (2.0, 1.0)
    gate = Segment(left, (0.0, 1e-10))  # an end within 1e-9 of the length, and in the middle of the other
    lid, ring = Segment((-1.0, 0.0), (1.0, 0.0)), Disc((0.0, 1.0), 1.0)
    assert others(gate, lid, ring) == [[], [1, 2], [0], [], [], []]
    moves: tuple[dict[str, Any], ...] = (
        {"velocity": (0.0, 1.0)},
        {"angular_velocity": 1.0},
        {"force": 1.0, "mass": 1.0},
    )
    for move in moves:
        own, other = Segment(left, (0.0, 0.0), **move), Segment(right, (0.0, 0.0), **move)
        assert others(own, lid) == []
        assert bool(others(own, other)) is ("velocity" in move)
    assert others(Segment(left, up), Segment(left, (2.0, 1.0 + 1e-8))) == [[1], [], [0], []]


def polygon_scene(seed: int) -> Scene:
    """Return grains in and around a polygon of random corners, with walls in line, and others on its sides.

    No wall is shorter than the radius, and grains are as fast as a radius a step.
    """
    rng = np.random.default_rng(seed)
    angle = np.cumsum(rng.uniform(0.5, 2.0, 12))
    angle = angle[angle < tau - 0.5]
    corners = rng.uniform(0.45, 1.0, (len(angle), 1)) * on_circle(angle)
    sides = np.roll(corners, -1, axis=0) - corners
    points = []
    for corner, side in zip(corners, sides, strict=True):
        cuts = np.sort(rng.uniform(0.25, 0.75, rng.integers(3)))
        points += [corner, *(corner + cuts[:, np.newaxis] * side)]
    walls = chained(np.array([*points, points[0]]))
    for k in rng.integers(len(corners), size=rng.integers(4)).tolist():
        foot = corners[k] + rng.choice([0.0, rng.uniform(0.2, 0.8)]) * sides[k]
        walls += chained(np.array([foot, foot + rng.uniform(0.1, 0.6) * on_circle(rng.uniform(0.0, tau))]))
    walls = [walls[k] for k in rng.permutation(len(walls))]
    radius = min(rng.uniform(0.03, 0.06), *(2.0 * wall.circle[2] for wall in walls))
    position = np.zeros((0, 2))
    for x in rng.uniform(-1.0, 1.0, (100, 1, 2)):
        is_clear = all(wall.side(x, np.array([radius])).gap > 0.0 for wall in walls)
        if len(position) < 12 and is_clear and (np.hypot(*(x - position).T) > 2.0 * radius).all():
            position = np.append(position, x, axis=0)
    n = len(position)
    velocity = radius / 0.01 * rng.uniform(0.1, 1.0, (n, 1)) * on_circle(rng.uniform(0.0, tau, n))
    grains = {"position": position, "velocity": velocity, "radius": radius, "mass": rng.uniform(0.5, 2.0, n)}
    laws: dict[str, Any] = {"gravity": (0.0, -9.81 * (seed % 2)), "friction": 0.4 * (seed % 3 == 0)}
    solver: dict[str, Any] = {"tolerance": 1e-9, "stop": "residual", "max_iterations": 20_000}
    return Scene(**grains, **laws, **solver, walls=walls, radius_out=50.0)


@pytest.mark.parametrize("count", [6, pytest.param(trimmed(1000), marks=pytest.mark.slow)])
def test_no_grain_overlaps_a_polygon_or_gains_energy(count: int) -> None:
    for seed in range(count):
        simulation = Simulation(polygon_scene(seed), threads=1)
        scene = simulation.scene
        for _ in range(40):
            before, report = kinetic_energy(simulation), simulation.step()
            gaps = [wall.side(simulation.position, scene.radius).gap.min() for wall in scene.walls]
            # rounding of coordinates and energies, of some 1 m and 1 J; gravity adds to the latter
            assert -min(gaps) <= scene.dt * report.residual + 1e-14, seed
            assert seed % 2 or kinetic_energy(simulation) <= before * (1.0 + 1e-14), seed
