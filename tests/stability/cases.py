"""The hard cases: each a scene, how long it runs, and what is expected of it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from hard_scenes import heap, heavy_top, jam, past_the_origin, random_masses, sizes, stack
from sample_scenes import bullet, explosion, falling_cloud, squeezed_light_grains

from warpgrains import Scene, Simulation


@dataclass(frozen=True)
class Case:
    """A scene, how long it runs, and what is expected of it beside the invariants of every step."""

    name: str
    scene: Callable[[], Scene]
    steps: int
    long_steps: int  # of the run behind the marker `slow`
    expectation: str
    outcome: Callable[[Simulation], None] = lambda simulation: None  # asserts what the words say
    is_hard: bool = False  # most of its first 30 steps need more than 20 iterations
    refused: bool = False  # a round wall refuses its first step: grains that are parted leave its circle
    then: dict[str, Any] = field(default_factory=dict)  # changes after these steps, followed by as many


def rests_upright(simulation: Simulation) -> None:
    """On the axis every normal is (0, 1) or (0, -1), and every number off it is a product with 0.

    At rest, each contact closes at eta at most, from a gap of dt eta at most: 2 eta a contact below.
    """
    scene, v = simulation.scene, simulation.velocity
    assert (simulation.position[:, 0] == 0.0).all()
    assert (np.abs(v[:, 1]) <= 2.0 * np.arange(1, scene.n + 1) * scene.tolerance).all()


def flies_on(simulation: Simulation) -> None:
    """It has not come near the wall."""
    assert np.array_equal(simulation.velocity, simulation.scene.velocity)


def stops_at_the_wall(simulation: Simulation) -> None:
    """It hits it within 1e-9 m of straight on, keeps as little of its 1 m/s, and stays to within dt eta."""
    scene = simulation.scene
    room = scene.radius_out - scene.radius[0]
    assert np.abs(simulation.velocity).max() <= 2.0 * scene.tolerance + 1e-9 / room
    assert abs(simulation.position[0, 0] - room) <= scene.dt * scene.tolerance


def has_fallen_up(simulation: Simulation) -> None:
    """Its centre of mass is in the upper half."""
    assert simulation.scene.mass @ simulation.position[:, 1] > 0.0


ONE_TO_FIVE = np.random.default_rng(3).uniform(0.015, 0.075, 150)
ONE_TO_A_HUNDRED = np.repeat([0.2, 0.02, 0.002], [6, 60, 300])
UPRIGHT = "takes the blow, and rests on its axis"

CASES = (
    Case("column of 50", partial(stack, 50), 100, 400, UPRIGHT, rests_upright, is_hard=True),
    Case("column of 200", partial(stack, 200), 50, 300, UPRIGHT, rests_upright),
    Case("masses 1:100, random", partial(random_masses, 100, 1e2), 60, 200, "settles", is_hard=True),
    Case("masses 1:10,000, random", partial(random_masses, 100, 1e4), 60, 150, "settles", is_hard=True),
    Case("masses 1:100, heavy top", partial(heavy_top, 100, 1e2), 60, 200, "the heavy sink in"),
    Case("masses 1:10,000, heavy top", partial(heavy_top, 100, 1e4), 11, 30, "the heavy sink in"),
    Case("jam filled to 80%", jam, 15, 30, "comes to rest from all directions", is_hard=True),
    Case("radii 1:5", partial(sizes, ONE_TO_FIVE), 80, 300, "settles", is_hard=True),
    Case(
        "radii 1:100",
        partial(sizes, ONE_TO_A_HUNDRED),
        80,
        150,
        "large ones land on small ones",
        is_hard=True,
    ),
    Case("bullet into a pile", bullet, 40, 200, "nothing is shot through"),
    Case("cloud falling on a pile", falling_cloud, 40, 200, "nothing is shot through"),
    Case("masses 1:1,000,000, squeezed", squeezed_light_grains, 40, 200, "the light shoot out"),
    Case("thirty grains in one place", explosion, 40, 200, "no overlap outlives a step"),
    Case("deep overlap", partial(heap, 60, spacing=1.0), 40, 200, "no overlap outlives a step", refused=True),
    Case("overlap", partial(heap, 60, spacing=1.8), 40, 200, "no overlap outlives a step"),
    Case("small grain past the origin", partial(past_the_origin, 0.1), 20, 20, "flies on", flies_on),
    Case("large grain past the origin", partial(past_the_origin, 0.8), 60, 60, "stops", stops_at_the_wall),
    Case("tight grain past the origin", partial(past_the_origin, 0.98), 60, 60, "stops", stops_at_the_wall),
    Case("gravity off", partial(heap, 60), 80, 300, "contacts only dissipate", then={"gravity": (0.0, 0.0)}),
    Case(
        "gravity reversed", partial(heap, 60), 80, 300, "falls up", has_fallen_up, then={"gravity": (0, 9.81)}
    ),
    *(
        Case(f"dt {dt:g}", partial(heap, 60, spacing=2.0, dt=dt), 100, 400, "a lattice gives way")
        for dt in (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
    ),
)
