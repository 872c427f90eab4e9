"""Periodic boxes: a pair meets by one of its images in a step (36b), and areas have all of them."""

from typing import Any

import numpy as np
import pytest

from warpgrains import Box, Disc, Scene, Segment, Simulation, SimulationError, analysis

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
