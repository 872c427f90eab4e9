"""The box about what grains can touch, which pictures show."""

from itertools import pairwise

import pytest

from warpgrains import Box, Scene, Segment, Simulation

BOX = [(-0.3, -0.4), (0.3, -0.4), (0.3, 0.6), (-0.3, 0.6)]
WHOLE = (-2.0, -2.0, 2.0, 2.0)


def walls(*lines, **motion):
    return [Segment(one, other, **motion) for line in lines for one, other in pairwise(line)]


OPEN, CLOSED = walls([BOX[3], BOX[0], BOX[1], BOX[2]]), walls([*BOX, BOX[0]])
FUNNEL = walls([(-0.5, 0.5), (-0.1, -0.4)], [(0.5, 0.5), (0.1, -0.4)])
SHELF = walls([(1.0, -1.0), (1.2, -1.0)])
LID = walls([BOX[3], BOX[2]], velocity=(0.0, 0.5))

ROUGH = {"velocity": (0.3, 0.0), "roughness": {"radius": 0.02, "spacing": 0.1}}


def of_box(left_to=-0.3, **sides):
    """A box, and its extent."""
    box = Box((-0.3, 0.3), (-0.4, 0.6), **sides)
    return {"domain": box, "radius_out": None, "duration": 5.0}, (left_to, -0.4, 0.3, 0.6)


CASES = {
    "no wall inside": ({}, WHOLE),
    "an open box": ({"walls": OPEN}, (-0.3, -0.4, 0.3, 0.6)),
    "an open box without gravity": ({"walls": OPEN, "gravity": (0.0, 0.0)}, WHOLE),
    "an open box, gravity up": ({"walls": OPEN, "gravity": (0.0, 9.81)}, WHOLE),
    "an open box, and gravity that turns": (
        {"walls": OPEN, "gravity": {"vector": (0.0, -9.81), "rotate": 1.0}},
        WHOLE,
    ),
    "an open box, and a grain that flies out": ({"walls": OPEN, "velocity": [(0.0, 5.0)]}, WHOLE),
    "an open box, and a grain that stays": (
        {"walls": OPEN, "velocity": [(0.0, 2.0)]},
        (-0.3, -0.4, 0.3, 0.6),
    ),
    "a closed box": (
        {"walls": CLOSED, "velocity": [(0.0, 5.0)], "gravity": (0.0, 0.0)},
        (-0.3, -0.4, 0.3, 0.6),
    ),
    "a closed box beside an inner wall": ({"walls": CLOSED, "radius_in": 0.01}, (-0.3, -0.4, 0.3, 0.6)),
    "a closed box, and a shelf outside": ({"walls": [*CLOSED, *SHELF]}, (-0.3, -0.4, 0.3, 0.6)),
    "a funnel": ({"walls": FUNNEL}, WHOLE),
    "a funnel that lets no grain through": (
        {"walls": FUNNEL, "radius": 0.15, "position": [(0.0, 0.3)]},
        (-0.5, -0.4, 0.5, 0.5),
    ),
    "a lid that moves up to the wall": ({"walls": [*OPEN, *LID], "duration": 100.0}, WHOLE),
    "a lid that moves later": ({"walls": [*OPEN, *LID], "time": 9.0, "duration": 100.0}, WHOLE),
    "a grain above a box": ({"walls": OPEN, "position": [(0.0, 1.0)]}, WHOLE),
    "a box as the domain": of_box(),
    "a box with a piston that moves out": of_box(
        left={"velocity": (-0.1, 0.0), "to_time": 2.0}, left_to=-0.5
    ),
    "a periodic box with rough sides that move along": of_box(periodic="x", bottom=ROUGH, top=ROUGH),
    "a box that is periodic in both directions": of_box(periodic="xy"),
}


@pytest.mark.parametrize("what", CASES)
def test_it_contains_what_grains_can_touch(what):
    changes, expected = CASES[what]
    fields = {"position": [(0.0, 0.1)], "radius": 0.05, "mass": 0.1, "radius_out": 2.0, **changes}
    assert Scene(**fields).extent == pytest.approx(expected, abs=1e-12)


def test_it_follows_a_change():
    scene = Scene(position=[(0.0, 0.1)], radius=0.05, mass=0.1, radius_out=2.0, walls=OPEN)
    before, wide = scene.extent, scene.replace(walls=[])
    simulation = Simulation(scene)
    simulation.change(walls=[])
    assert simulation.scene.extent == wide.extent != before
