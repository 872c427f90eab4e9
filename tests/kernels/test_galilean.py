"""The motion is the same for all who watch: of grains and walls that all move at V besides (26, 26b)."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product
from math import pi, tau
from typing import Any

import numpy as np
import pytest
from walled_scenes import BOUNCY, BUMPS, ROLLING, ROUGH, chained, on_circle

from warpgrains import Arc, Box, Disc, Line, Scene, Segment, Simulation
from warpgrains.walls.wall import Wall

EPS = np.finfo(float).eps
DT, STEPS = 2.0**-8, 24

KINDS: dict[str, list[Wall]] = {
    "discs": [Disc((0.3, -0.4), 0.25), Disc((-0.5, 0.1), 0.1, angular_velocity=3.0)],
    "segments": [Segment((-1.0, -0.6), (0.2, -0.7)), Segment((0.1, 0.3), (0.6, 0.1), angular_velocity=2.0)],
    "arcs": [Arc((0.0, 0.2), 1.0, pi, tau), Arc((0.2, 0.6), 0.3, 2.0, 4.0, angular_velocity=-1.0)],
    "a ring": [Disc((0.0, 0.0), 1.1, inside=True)],
    "lines": [Line((0.0, -0.8), (0.1, 1.0), 2.0), Line((-0.9, 0.0), (1.0, 0.2), 2.0)],
    "a polyline": chained(np.array([(-1.0, 0.2), (-0.6, -0.6), (0.1, -0.7), (0.6, -0.4), (1.0, 0.3)])),
    "a drum": chained(1.15 * on_circle(np.arange(9) % 8 * tau / 8), angular_velocity=0.7, pivot=(0.1, 0.0)),
}


def grains(seed: int, walls: list[Wall], **fields: Any) -> dict[str, Any]:
    """Return grains of random velocities outside of walls."""
    rng = np.random.default_rng(seed)
    position = rng.uniform(-0.75, 0.75, (40, 2))
    for wall in walls:
        position = position[wall.side(position, np.full(len(position), 0.05)).gap > 0.0]
    n = len(position)
    radius, mass = rng.uniform(0.03, 0.06, n), rng.uniform(0.2, 1.0, n)
    own = {"position": position, "velocity": rng.normal(0.0, 1.0, (n, 2)), "radius": radius, "mass": mass}
    how = {"drag": 0.0, "gravity": (2.0, -9.0), "dt": DT, "tolerance": 0.0, "max_iterations": 60}
    return {**own, **how, **fields}


def boosted(wall: Wall, boost: tuple[float, float]) -> Wall:
    """Return a wall that moves at a velocity besides."""
    return replace(wall, velocity=(wall.velocity[0] + boost[0], wall.velocity[1] + boost[1]))


def free(kind: str, boost: tuple[float, float], **fields: Any) -> Scene:
    """Return grains among walls of a kind, which all move at a velocity besides, far from any circle."""
    own = grains([*KINDS].index(kind), KINDS[kind], **fields)
    own["velocity"] = own["velocity"] + boost
    return Scene(**own, walls=[boosted(wall, boost) for wall in KINDS[kind]], radius_out=64.0)


def in_box(kind: str, boost: tuple[float, float], **fields: Any) -> Scene:
    """Return grains in a box whose sides all move at a velocity besides."""
    own, side = grains(5, [], **fields), {"velocity": boost}
    rough: dict[str, Any] = side | {"roughness": BUMPS}
    sides = {
        "closed": dict.fromkeys(("left", "right", "bottom", "top"), side),
        "rough": {"bottom": rough, "top": side},
        "lid": {"bottom": side, "top": rough | {"pressure": 30.0, "mass": 2.0}},
    }[kind]
    own["velocity"] = own["velocity"] + boost
    return Scene(
        **own, domain=Box((-1.0, 1.0), (-1.0, 1.0), periodic="" if "left" in sides else "x", **sides)
    )


Make = Callable[..., Scene]
BOOSTS = (8.0, -2.0), (-0.5, 24.0)  # m/s: DT times these is exact, and up to three of the smallest radii
CASES: dict[str, tuple[Make, tuple[float, float]]] = {
    **{kind: (partial(free, kind), BOOSTS[k % 2]) for k, kind in enumerate(KINDS)},
    "a closed box": (partial(in_box, "closed"), BOOSTS[0]),
    "a rough side": (partial(in_box, "rough"), BOOSTS[1]),
    "a rough lid": (partial(in_box, "lid"), (8.0, 0.0)),  # a pressure drives it across this way
}
EVERY: dict[str, Any] = ROUGH | ROLLING | BOUNCY
LAWS: dict[str, list[dict[str, Any]]] = {
    "gauss-seidel": [{}, EVERY],
    "accelerated": [{}, EVERY],
    "exact": [{}, ROUGH | BOUNCY],
}
RUNS = [
    (case, method, k)
    for case, method, k in product(CASES, LAWS, range(2))
    if (case, method) != ("a rough lid", "exact")
]

# gap / dt is rounded by a few eps of places, up to 4 m, over dt; each step adds as much
TOLERANCE = 16.0 * EPS / DT * STEPS


@pytest.mark.parametrize(("case", "method", "k"), RUNS)
def test_all_that_moves_besides_moves_as_at_rest(case: str, method: str, k: int) -> None:
    """Sweeps are as many, for a tolerance of 0; the exact method meets one that is a part of what is left."""
    make, boost = CASES[case]
    scheme = ("euler", "leapfrog")[([*CASES].index(case) + k) % 2]
    how: dict[str, Any] = {"scheme": scheme, "method": method, **LAWS[method][k]}
    if method == "exact":
        how |= {"tolerance": 1e-13, "max_iterations": 2000}
    still, moving = (Simulation(make(own, **how)) for own in ((0.0, 0.0), boost))
    touched = 0
    for _ in range(STEPS):
        for simulation in (still, moving):
            simulation.step()
        touched += len(moving.wall_contacts().wall)
    assert touched > 0
    assert np.abs(moving.velocity - boost - still.velocity).max() < TOLERANCE
    assert np.abs(still.scene.radius * (moving.spin - still.spin)).max() < TOLERANCE
