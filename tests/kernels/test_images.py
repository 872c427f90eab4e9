"""Periodic boxes: a pair meets by one of its images in a step (36b), and areas have all of them."""

from dataclasses import replace
from itertools import product
from math import pi
from typing import Any

import numpy as np
import pytest
from walled_scenes import chained

from warpgrains import Arc, Box, Disc, Scene, Segment, Simulation, SimulationError, analysis
from warpgrains.base.arrays import FloatArray
from warpgrains.walls.wall import Wall

AT_REST: dict[str, Any] = {"gravity": (0.0, 0.0), "drag": 0.0, "dt": 0.01}


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("speed", "meets"), [(9.9, False), (10.1, True), (-9.9, False), (150.0, True)])
def test_a_step_in_which_a_pair_meets_by_another_image_is_refused(
    axis: int, speed: float, meets: bool
) -> None:
    """Discs of 1 m are 2.1 m apart on both sides of a period of 4.2 m: 0.1 m is left on the other side."""
    position, velocity = np.array([(0.2, 2.1), (2.3, 2.1), (0.3, 9.0)]), np.zeros((3, 2))
    velocity[1, 0] = speed
    box = Box((0.0, 4.2), (0.0, 20.0), periodic="xy")
    if axis:
        position, velocity, box = position[:, ::-1], velocity[:, ::-1], Box(box.y, box.x, periodic="xy")
    scene = Scene(position=position, velocity=velocity, radius=1.0, mass=1.0, domain=box, **AT_REST)
    simulation = Simulation(scene)
    if meets:
        with pytest.raises(
            SimulationError, match=r"grain 0 reached .* it would meet grain 1 by two of its images"
        ):
            simulation.step()
        assert (simulation.steps, simulation.position.tolist()) == (0, position.tolist())
    else:
        assert simulation.step().overlap <= 1e-15


ROUND = [(0.1, 0.1), (0.5, 0.1), (0.9, 0.1), (0.1, 0.9), (0.9, 0.9), (0.5, 0.9)]


@pytest.mark.parametrize("at", [0.5, 2.5, -6.5])
def test_cells_of_grains_at_round_places_beside_a_disc_written_anywhere(at: float) -> None:
    """Corners of cells are many times the same there, but for rounding."""
    box = Box((0.0, 1.0), (0.0, 1.0), periodic="xy")
    scene = Scene(position=ROUND, radius=0.05, mass=0.1, domain=box, walls=[Disc((at, 0.5), 0.2)], **AT_REST)
    areas = analysis.cell_areas(Simulation(scene))
    assert areas.sum() == pytest.approx(1.0 - np.pi * 0.2**2, abs=1e-12)
    assert areas == pytest.approx(areas[[2, 1, 0, 4, 3, 5]], abs=1e-12)  # it is in the middle


def test_a_floor_written_beyond_the_cell_bounds_the_grains() -> None:
    box = Box((0.0, 1.0), (0.0, 2.0), periodic="x")
    floor = Segment((3.05, 0.5), (3.99, 0.5))
    scene = Scene(position=[(0.5, 1.0)], radius=0.1, mass=0.1, domain=box, walls=[floor])
    assert analysis.region_of(Simulation(scene), {"y": (0.0, 1.5)}).area == pytest.approx(1.0, abs=1e-12)


def test_a_pressure_acts_on_the_length_that_a_side_has_now() -> None:
    """Two sides pressed with 10 N/m, which move in by a fifth, hold grains under 10 N/m."""
    place = np.linspace(0.06, 0.94, 8)
    side = {"pressure": 10.0, "mass": 1.0}
    grains = {"position": [(x, y) for x in place for y in place], "radius": 0.05, "mass": 1.0}
    box = Box((0.0, 1.0), (0.0, 1.0), top=side, right=side)
    how = AT_REST | {"drag": 2.0, "tolerance": 1e-7, "max_iterations": 5000}
    simulation = Simulation(Scene(**grains, domain=box, **how))
    simulation.advance(600)
    length = [1.0 - way for way, _ in simulation.driven[[1, 3]]]  # of the right side, and of the top
    assert length == pytest.approx([0.8, 0.8], abs=1e-6)
    # forces are those of a step that leaves 1e-7 m/s: 8 kg m/s2 of 8 grains at a wall times 1e-7 / 0.01
    assert np.diag(analysis.mean_stress(simulation)) == pytest.approx([10.0, 10.0], abs=1e-3)


RAISED = {"velocity": (3.1, 0.7)}
WIDE: dict[str, list[Wall]] = {
    "a peg": [Disc((0.5, 0.3), 0.4)],
    "an arc": [Arc((0.5, 0.6), 0.4, pi / 2, 3 * pi / 2)],
    "a floor of two segments": [Segment((0.2, 0.3), (0.7, 0.3)), Segment((0.7, 0.3), (1.2, 0.3))],
    "a floor of one, in motion": [Segment((0.2, 0.3), (1.2, 0.3), **RAISED)],
    "a zigzag, in motion": chained(np.array([(0.0, 0.3), (0.3, 0.5), (0.6, 0.2), (1.0, 0.3)]), **RAISED),
    "an arc and a chord": [Arc((0.5, 0.4), 0.45, pi, 2 * pi), Segment((-0.05, 0.4), (0.05, 0.4))],
}


@pytest.mark.parametrize("which", WIDE)
@pytest.mark.parametrize("axis", [0, 1])
def test_a_box_with_wide_walls_is_as_three_of_it_side_by_side(which: str, axis: int) -> None:
    """In which no grain can touch two images of a wall: velocities without friction are unique."""
    walls, rng = WIDE[which], np.random.default_rng(4)
    places = rng.uniform((0.0, 0.0), (1.0, 2.0), (60, 2))
    for wall in walls:
        for way in product((-1.0, 0.0, 1.0), (-2.0, 0.0, 2.0)):
            apart = np.abs(wall.side(places + way, np.zeros(len(places))).gap)
            places = places[(apart > 0.08) & ~wall.covers(places + way)]
    turn = np.array([[1.0, 0.0], [0.0, 1.0]]) if axis == 0 else np.array([[0.0, 1.0], [1.0, 0.0]])

    def run(copies: int) -> FloatArray:
        across = np.arange(copies)[:, np.newaxis, np.newaxis] * np.array([1.0, 0.0])
        every = [moved(wall, float(k)) for k in range(copies) for wall in walls]
        box = Box((0.0, 1.0 * copies), (0.0, 2.0), periodic="xy")
        if axis:
            every, box = [turned(wall) for wall in every], Box(box.y, box.x, periodic="xy")
        how = {"gravity": tuple(turn @ (1.5, -9.81)), "drag": 0.2, "dt": 2e-3, "method": "accelerated"}
        scene = Scene(
            position=(places + across).reshape(-1, 2) @ turn,
            radius=0.06,
            mass=0.1,
            domain=box,
            walls=every,
            tolerance=1e-11,
            max_iterations=20_000,
            **how,
        )
        assert copies == 1 or not any(wall.image for wall in scene.walls)
        simulation = Simulation(scene)
        met = 0
        for _ in range(60):
            assert simulation.step().converged
            met += len(simulation.wall_contacts().wall)
        assert met > 100
        return (simulation.position @ turn).reshape(copies, -1, 2) - across

    one, three = run(1), run(3)
    # velocities within 1e-11 m/s of exact ones, in 60 steps whose errors grow by what contacts turn
    assert np.abs(three - one).max() < 1e-7


def moved(wall: Wall, way: float) -> Wall:
    return wall.driven_to(way, (1.0, 0.0))


def turned(wall: Wall) -> Wall:
    """Return a wall reflected at the line x = y."""
    own = {
        name: getattr(wall, name)[::-1]
        for name in ("center", "start", "end", "velocity")
        if hasattr(wall, name)
    }
    if isinstance(wall, Arc):
        own |= {"from_angle": pi / 2 - wall.to_angle, "to_angle": pi / 2 - wall.from_angle}
    return replace(wall, **own)
