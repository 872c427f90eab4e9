"""The box about what grains can touch, which pictures show."""

from math import tau

import numpy as np
import pytest
from walled_scenes import chained

from warpgrains import Box, Scene, Segment, Simulation
from warpgrains.drawing.extent import extent_of

WHOLE = (-2.0, -2.0, 2.0, 2.0)
INSIDE = (-0.3, -0.4, 0.3, 0.6)
CUP = np.array([(-0.3, 0.6), (-0.3, -0.4), (0.3, -0.4), (0.3, 0.6)])
OPEN, CLOSED = chained(CUP), chained(CUP[[0, 1, 2, 3, 0]])
FUNNEL = [Segment((-0.5, 0.5), (-0.1, -0.4)), Segment((0.5, 0.5), (0.1, -0.4))]
SHELF = Segment((1.0, -1.0), (1.2, -1.0))
LID = Segment((-0.3, 0.6), (0.3, 0.6), velocity=(0.0, 0.5))
ROUGH = {"velocity": (0.3, 0.0), "roughness": {"radius": 0.02, "spacing": 0.1}}


def box(**sides):
    return {"domain": Box((-0.3, 0.3), (-0.4, 0.6), **sides), "radius_out": None, "duration": 5.0}


CASES = {
    "no wall inside": ({}, WHOLE),
    "an open box": ({"walls": OPEN}, INSIDE),
    "an open box without gravity": ({"walls": OPEN, "gravity": (0.0, 0.0)}, WHOLE),
    "an open box, gravity up": ({"walls": OPEN, "gravity": (0.0, 9.81)}, WHOLE),
    "an open box, gravity that turns": ({"walls": OPEN, "gravity": {"angular_velocity": 1.0}}, WHOLE),
    "an open box, a grain that flies out": ({"walls": OPEN, "velocity": [(0.0, 5.0)]}, WHOLE),
    "an open box, a grain that stays": ({"walls": OPEN, "velocity": [(0.0, 2.0)]}, INSIDE),
    "a closed box": ({"walls": CLOSED, "velocity": [(0.0, 5.0)], "gravity": (0.0, 0.0)}, INSIDE),
    "a closed box beside an inner wall": ({"walls": CLOSED, "radius_in": 0.01}, INSIDE),
    "a closed box, and a shelf outside": ({"walls": [*CLOSED, SHELF]}, INSIDE),
    "a funnel": ({"walls": FUNNEL}, WHOLE),
    "a funnel that lets no grain through": (
        {"walls": FUNNEL, "radius": 0.15, "position": [(0.0, 0.3)]},
        (-0.5, -0.4, 0.5, 0.5),
    ),
    "a lid that moves up to the wall": ({"walls": [*OPEN, LID], "duration": 100.0}, WHOLE),
    "a lid that moves later": ({"walls": [*OPEN, LID], "time": 9.0, "duration": 100.0}, WHOLE),
    "a grain above a box": ({"walls": OPEN, "position": [(0.0, 1.0)]}, WHOLE),
    "a box as the domain": (box(), INSIDE),
    "a piston that moves out": (
        box(left={"velocity": (-0.1, 0.0), "end_time": 2.0}),
        (-0.5, -0.4, 0.3, 0.6),
    ),
    "a side that oscillates by 0.1 m, sixteen times": (
        box(left={"velocity": (-1.6 * tau, 0.0), "frequency": 16.0}),
        (-0.4, -0.4, 0.3, 0.6),
    ),
    "rough sides that move along": (box(periodic="x", bottom=ROUGH, top=ROUGH), INSIDE),
    "a box that is periodic in both directions": (box(periodic="xy"), INSIDE),
}


def scene(**changes):
    return Scene(**{"position": [(0.0, 0.1)], "radius": 0.05, "mass": 0.1, "radius_out": 2.0, **changes})


@pytest.mark.parametrize(("changes", "expected"), CASES.values(), ids=CASES)
def test_it_contains_what_grains_can_touch(changes, expected):
    assert extent_of(scene(**changes)) == pytest.approx(expected, abs=1e-12)


def test_it_follows_a_change():
    simulation = Simulation(scene(walls=OPEN))
    simulation.change(walls=[])
    assert extent_of(simulation.scene) == pytest.approx(WHOLE)
