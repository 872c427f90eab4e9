"""Scenes in which one term of (11) alone tells that a contact is missing from the list.

Grains of radius 1 m at steps of 1 s, so that speeds are lengths. The first list reaches SKIN beyond a grain
at rest. Every scene is run at many gaps, some just beyond what is listed; the reference visits all pairs.
"""

from collections.abc import Callable
from itertools import product

import numpy as np
import pytest
from same_bits import assert_same_bits

from warpgrains import Scene, Simulation, StepReport
from warpgrains.base.arrays import FloatArray
from warpgrains.reference.reference import Reference
from warpgrains.solver import tuning

SKIN = 1.25 * tuning.BASE_SKIN  # of the first list (kernels/search/skins.py)
JUST = 1e-6
HEAVY = 1e9

MakeReference = Callable[..., Reference]


def scene_of(position: object, velocity: object, mass: object = 1.0, **changes: object) -> Scene:
    """Return grains far from the walls."""
    flat = {"radius": 1.0, "dt": 1.0, "gravity": (0.0, 0.0), "radius_out": 500.0, "max_iterations": 20}
    return Scene(position=position, velocity=velocity, mass=mass, tolerance=1e-9, **flat | changes)


def mirrored(x: FloatArray, velocity: FloatArray, mass: object = 1.0, **changes: object) -> Scene:
    """Return grains in a line, at x > 0, that move towards their mirror images: the frame is at rest."""
    masses = np.broadcast_to(mass, np.shape(x))
    x, velocity = np.append(-x[::-1], x), np.append(-velocity[::-1], velocity)
    position, velocity = (np.stack([along, 0.0 * x], axis=1) for along in (x, velocity))
    return scene_of(position + np.array([0.0, 10.0]), velocity, np.append(masses[::-1], masses), **changes)


def step_both(make: MakeReference, scene: Scene, steps: int, **tuned: float) -> list[StepReport]:
    """Hold every step against the reference, and return what the steps report."""
    simulation, reference, reports = Simulation(scene, threads=1), make(scene), []
    for name, value in tuned.items():
        simulation._engine.records.host["tuning"][name] = value
    for _ in range(steps):
        reports.append(simulation.step())
        assert (reports[-1].iterations, reports[-1].zeta) == reference.step()
        assert_same_bits(simulation, reference)
    return reports


def pushed(gap: float, speed: float, before: float = 0.0, fast: float = 0.4) -> Scene:
    """Return two grains that heavy ones, touching them, push towards each other, and fast ones far away.

    They move at `before`, and after the first sweep faster by `speed`; with fast ones a list lasts one step.
    """
    x = 0.5 * gap + np.array([1.0, 3.0, 100.0])
    return mirrored(x, -np.array([before, before + speed, -fast]), np.array([1.0, HEAVY, 1.0]))


def pushed_to_wall(gap: float, speed: float, before: float, outer: bool) -> Scene:
    """Return a grain that a heavy one pushes to a wall, and fast ones far away."""
    at, back = (500.0 - 1.0 - gap, -1.0) if outer else (40.0 + 1.0 + gap, 1.0)
    return scene_of(
        [[0.0, at], [0.0, at + 2.0 * back], [200.0, 200.0], [-200.0, -200.0]],
        [[0.0, -back * before], [0.0, -back * (before + speed)], [0.4, 0.0], [-0.4, 0.0]],
        [1.0, HEAVY, 1.0, 1.0],
        radius_in=40.0,
    )


BEYOND = [(JUST, 0.5 * JUST), (0.01, 0.1), (0.1, 1e-3), (0.28, 0.5 * JUST), (0.4, 0.1), (0.8, 1e-3)]
"""How far beyond the list a grain is, and how much faster than needed it is pushed, in skins."""


TUNED: dict[str, dict[str, float]] = {
    "as it is": {},
    "all monitored": {"MONITOR_THRESHOLD": 0.0},
    "too small to be monitored": {"MONITOR_THRESHOLD": 5.0},
    "lists without skin": {"BASE_SKIN": 1e-12},
}


@pytest.mark.parametrize("tuned", TUNED)
@pytest.mark.parametrize("before", [0.0, 0.1])
@pytest.mark.parametrize("to", ["a grain", "the outer wall", "the inner wall"])
def test_grain_from_just_outside_the_list(
    reference: MakeReference, monkeypatch: pytest.MonkeyPatch, to: str, before: float, tuned: str
) -> None:
    """p_i, also at walls, and where lists are built before every step; |w_i - w_j| is listed."""
    for name, value in TUNED[tuned].items():
        monkeypatch.setattr(tuning, name, value)
    moving = 2.0 if to == "a grain" else 1.0
    for beyond, faster in BEYOND:
        gap = moving * before + 2.0 * SKIN * (1.0 + beyond)
        speed = gap / moving - before + SKIN * faster
        scene = pushed(gap, speed, before)
        if to != "a grain":
            scene = pushed_to_wall(gap, speed, before, to == "the outer wall")
        assert step_both(reference, scene, steps=3)[0].restarts >= 1


def test_grain_that_creeps_below_the_threshold(reference: MakeReference) -> None:
    """A row in contact, each grain slightly slower than the next: sweep by sweep, the first is pushed on."""
    k = np.arange(30)
    for beyond in (JUST, 0.05, 0.2):
        gap = 2.0 * SKIN * (1.0 + beyond)
        velocity = -2.0 * (0.5 * gap + 0.002) * k / k[-1]
        scene = mirrored(0.5 * gap + 1.0 + 2.0 * k, velocity, max_iterations=2000)
        reports = step_both(reference, scene, steps=2)
        assert reports[0].iterations > 100
        assert sum(report.restarts for report in reports) > 0


def test_grain_that_drifts_for_long(reference: MakeReference) -> None:
    """s_i: a light push, and many steps without any, in a list that would last for long."""
    for speed, late in product((0.15, 0.2, 0.45), np.arange(0.0, 6.0, 1.5)):
        gap = 2.0 * SKIN * (1.0 + JUST) + 2.0 * SKIN * speed * late * 0.3
        reports = step_both(reference, pushed(gap, speed * SKIN, fast=0.0), steps=12)
        assert sum(report.contacts > 2 for report in reports) > 0


def test_list_that_outlives_its_time(reference: MakeReference) -> None:
    """e + dt <= T: grains in free flight need no skin at all."""
    for speed, late in product((0.01, 0.1, 0.24, 0.3, 0.49), (JUST, 0.5, 1.0 - JUST)):
        lifetime = min(64.0, np.floor(0.5 / speed))
        gap = 2.0 * speed * (lifetime + late)
        scene = mirrored(0.5 * gap + np.array([1.0]), np.array([-speed]))
        assert step_both(reference, scene, int(lifetime) + 2)[-1].contacts == 1


@pytest.mark.parametrize("grains", [1, 12])
@pytest.mark.parametrize(("share", "farthest"), [(0.0, 1.5), (0.25, 7.0)])
def test_frame_that_falls_while_grains_hardly_separate(
    reference: MakeReference, share: float, farthest: float, grains: int
) -> None:
    """|U| + dt |u|: thrown up, at rest when the list is built, and down again to the wall.

    The frame's skin covers a fall by gravity, and is never needed; here it covers a share of one.
    """
    g, offset = 0.005, np.arange(grains) * 2.01 - grains * 1.005
    for gap in np.linspace(2.0 * SKIN + JUST, farthest, 5):
        x = np.stack([offset, -np.sqrt((500.0 - 1.0 - gap) ** 2 - offset**2)], axis=1)
        scene = scene_of(x, np.tile([0.0, g], (grains, 1)), gravity=(0.0, -g), drag=0.0)
        steps = int(np.sqrt(2.0 * gap / g)) + 4
        assert step_both(reference, scene, steps, acceleration=share * g)[-1].contacts > 0
