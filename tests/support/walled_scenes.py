"""Scenes of grains of many sizes that fall on walls of every kind: at rest, in motion, driven, and joined.

A new kind of wall needs an example in `OF_EVERY_KIND` or `INFINITE`; perhaps also an entry in `WALLED`.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from math import pi, tau
from typing import Any

import numpy as np

from warpgrains import Arc, Box, Disc, Line, Row, Scene, Segment, Simulation
from warpgrains.base.arrays import FloatArray
from warpgrains.scene.layouts import random_layout
from warpgrains.walls.wall import Wall


def on_circle(angle: Any) -> FloatArray:
    """Return points of the unit circle at an angle or angles [rad], shape (..., 2)."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def chained(points: FloatArray, **motion: Any) -> list[Wall]:
    """Return the m - 1 segments from each of `points` to the next, shape (m, 2) [m]; all have `motion`."""
    return [Segment(a, b, **motion) for a, b in pairwise(map(tuple, points.tolist()))]


def scattered(
    n: int,
    seed: int,
    areas: tuple[float, float],
    outside: Sequence[Wall],
    thrown: float = 0.0,
    spinning: float = 0.0,
    **fields: Any,
) -> Scene:
    """Return a scene with the walls `outside` and up to n random grains, whose centers are outside of them.

    The squared distances of grains from the origin lie between the two numbers `areas` [m2]. Velocity
    components lie within +-`thrown` [m/s], and spins have the standard deviation `spinning` [rad/s].
    """
    rng = np.random.default_rng(seed)
    angle, distance = rng.uniform(0.0, tau, n), np.sqrt(rng.uniform(*areas, n))
    position = distance[:, np.newaxis] * on_circle(angle)
    for wall in outside:
        position = position[~wall.covers(position)]
    velocity = rng.uniform(-thrown, thrown, position.shape) if thrown else None
    radius, mass = rng.uniform(0.02, 0.05, len(position)), rng.uniform(0.1, 1.0, len(position))
    spin = rng.normal(0.0, spinning, len(position)) if spinning else None
    grains = {"position": position, "velocity": velocity, "radius": radius, "mass": mass, "spin": spin}
    common = {"radius_out": 1.0, "walls": outside, "dt": 5e-3, "tolerance": 1e-6, "max_iterations": 300}
    return Scene(**{**grains, **common, **fields})


BOUNCY: dict[str, Any] = {"restitution": 0.7, "wall_restitution": 0.9, "restitution_speed": 0.02}
ROUGH: dict[str, Any] = {"friction": 0.4, "wall_friction": 0.6}
ROLLING: dict[str, Any] = {"rolling_friction": 0.3, "wall_rolling_friction": 0.2}

DISCS = (Disc((0.0, -0.5), 0.15), Disc((0.3, -0.6), 0.1))
SEGMENTS = (Segment((-0.7, -0.2), (-0.2, -0.6)), Segment((-0.2, -0.6), (0.1, -0.75)))
RING = Disc((0.02, -0.05), 0.93, inside=True)
ARC = Arc((0.5, -0.1), 0.3, -2.5, -0.3)
OF_EVERY_KIND = (*DISCS, *SEGMENTS, RING, ARC)
INFINITE = (Line((0.1, -0.6), (0.3, 1.0), 2.0), Row((0.0, -0.5), (0.2, 0.1), 0.1, 2.0))


def alone(
    position: tuple[float, float],
    walls: Sequence[Any],
    velocity: tuple[float, float] = (0.0, 0.0),
    **changes: Any,
) -> Simulation:
    """Return the simulation of one grain of radius 0.1 m and walls, by leapfrog and to 1e-12 m/s.

    `changes` replace fields of the scene.
    """
    fields = {
        "radius": 0.1,
        "mass": 1.0,
        "radius_out": 6.0,
        "dt": 0.01,
        "scheme": "leapfrog",
        "tolerance": 1e-12,
    }
    return Simulation(Scene(position=[position], velocity=[velocity], walls=walls, **fields | changes))


def force_on(contacts: Any) -> FloatArray:
    """Return the force of each contact on its second grain, or on the wall [N], shape (m, 2)."""
    tangent = np.stack([-contacts.normal[:, 1], contacts.normal[:, 0]], axis=1)
    return contacts.force[:, None] * contacts.normal + contacts.tangential_force[:, None] * tangent


def around(n: int = 110, walls: Sequence[Wall] = OF_EVERY_KIND, **changes: Any) -> Scene:
    """Return a scene of grains that fall on fixed walls and between them."""
    return scattered(n, 1, (0.1, 0.95), walls, **{"drag": 0.1, "radius_in": 0.2} | changes)


def cloud(n: int = 90, **changes: Any) -> Scene:
    """Return a scene of grains with friction on two discs, between two circles that rotate."""
    rough = {"friction": 0.5, "wall_friction": 0.3, "spin_drag": 1e-5, "max_iterations": 200}
    turning = {"angular_velocity_out": 3.0, "angular_velocity_in": -20.0, "drag": 0.1, "radius_in": 0.2}
    return scattered(n, 1, (0.1, 0.95), DISCS, spinning=5.0, **rough | turning | changes)


PISTON = Segment((-0.95, -0.5), (-0.3, -0.5), velocity=(0.1, 0.3), start_time=0.1, end_time=0.8)
BLADE = Segment((0.1, 0.0), (0.5, -0.1), angular_velocity=2.0, pivot=(0.1, 0.1))
ROLLER = Disc((0.4, -0.6), 0.15, angular_velocity=-3.0, start_time=0.2)
STONE = Disc((0.1, -0.7), 0.1, velocity=(0.0, 0.1), angular_velocity=0.5, pivot=(0.0, 0.0))
SCOOP = Arc((-0.3, 0.2), 0.2, 3.0, 5.5, angular_velocity=1.0, velocity=(0.1, -0.1), end_time=0.7)
SHAKER = Disc(
    (-0.5, 0.5), 0.1, velocity=(0.9, 0.4), angular_velocity=2.0, pivot=(-0.4, 0.5), frequency=3.0, phase=0.4
)
MOVING = (PISTON, BLADE, ROLLER, STONE, RING, SCOOP, SHAKER)
OWN_LAWS = (
    PISTON,
    replace(BLADE, friction=0.9, rolling_friction=0.6, restitution=0.3),
    ROLLER,
    STONE,
    replace(RING, friction=0.0),
    replace(SCOOP, restitution=0.0),
    SHAKER,
)
OF_ALL_LAWS: dict[str, Any] = {**ROUGH, **ROLLING, **BOUNCY, "walls": OWN_LAWS, "angular_velocity_out": 0.5}
TURNING: dict[str, Any] = {**OF_ALL_LAWS, "gravity": {"vector": (3.0, -9.0), "angular_velocity": -4.0}}


def stirred(n: int = 90, seed: int = 1, walls: Sequence[Wall] = MOVING, **changes: Any) -> Scene:
    """Return a scene of grains that fall on walls with prescribed motions."""
    return scattered(n, seed, (0.0, 0.85), walls, **{"drag": 0.1} | changes)


DRIVEN = Segment((-0.6, 0.5), (0.6, 0.5), force=-20.0, mass=2.0)
STILL = Disc((0.2, -0.3), 0.1)


def pressed(n: int = 70, seed: int = 1, walls: Sequence[Wall] = (), **changes: Any) -> Scene:
    """Return a scene of grains with random velocities in a circle on which a pressure acts."""
    squeeze = {"pressure": 50.0, "gravity": (0.0, 0.0)}
    return scattered(n, seed, (0.05, 0.85), walls, thrown=0.3, **squeeze | changes)


AS_ONE: dict[str, Any] = {"angular_velocity": 0.8, "pivot": (0.0, 0.0)}
CORNERS: dict[str, list[Wall]] = {
    "box": chained(np.array([(-0.7, 0.7), (-0.7, -0.7), (0.7, -0.7), (0.7, 0.7), (-0.7, 0.7)])),
    "zigzag": chained(np.stack([np.linspace(-1.0, 1.0, 12), np.tile([-0.6, -0.45], 6)], axis=1)),
    "chute": [
        Segment((-0.6, -0.7), (0.0, -0.7)),
        Arc((0.0, -0.3), 0.4, -pi / 2, 0.5),
        Segment((-0.2, -0.7), (-0.8, 0.1)),
        Disc((-0.2, -0.9), 0.2),
        Arc((-0.6, -0.8), 0.1, pi / 2, 2.0),
    ],
    "drum": chained(on_circle(np.arange(13) % 12 * tau / 12), **AS_ONE),
    "fine drum": chained(on_circle(np.arange(121) % 120 * tau / 120), **AS_ONE),
}


def cornered(walls: Sequence[Wall], n: int = 50, **changes: Any) -> Scene:
    """Return a scene of grains that fall on joined walls; they start within 0.65 m from the origin."""
    areas = (0.65**2 * 0.1, 0.65**2)
    return scattered(n, 5, areas, walls, **{"radius_out": 1.2, "max_iterations": 60} | changes)


BUMPS = {"radius": 0.02, "spacing": 0.1}
LID = {"pressure": 30.0, "mass": 1.0, "velocity": (0.5, 0.0), "friction": 0.7}
FALL = {"gravity": (1.0, -9.81)}
BOXES: dict[str, dict[str, Any]] = {
    "conveyor": {
        "periodic": "x",
        "bottom": {"velocity": (1.0, 0.0), "friction": 0.5},
        "friction": 0.3,
        **FALL,
    },
    "everywhere": {"periodic": "xy"},
    "piston": {"left": {"velocity": (0.4, 0.0), "end_time": 0.2}, **FALL},
    "lid": {"periodic": "x", "top": LID, "friction": 0.4},
    "rough lid": {"periodic": "x", "top": {**LID, "roughness": BUMPS}, "friction": 0.4},
    "smooth lid": {"periodic": "x", "top": {"pressure": 30.0, "mass": 1.0}},
    "rough": {"periodic": "x", "bottom": {"roughness": BUMPS}, "friction": 0.4, **FALL},
    "shear": {"periodic": "x", "top": {"velocity": (-0.7, 0.0), "roughness": BUMPS}, "friction": 0.4},
    "walls": {
        "periodic": "xy",
        "walls": (
            Disc((0.02, 0.1), 0.1),
            Disc((0.5, 0.6), 0.1, velocity=(0.3, 0.5)),
            Segment((0.8, 0.3), (1.1, 0.35)),
            Arc((0.4, 0.1), 0.15, 0.0, 3.0),
        ),
    },
    "images": {
        "periodic": "xy",
        "walls": (
            Segment((0.3, 0.1), (1.3, 0.1), velocity=(0.4, 0.3)),
            Arc((0.4, 0.4), 0.28, -1.0, 2.5, velocity=(-0.2, 0.0), friction=0.7),
        ),
        **FALL,
    },
    "driven image": {
        "periodic": "x",
        "walls": (Segment((0.6, 0.1), (1.5, 0.15), force=8.0, mass=0.7),),
        **FALL,
    },
    "bouncing": {
        "periodic": "x",
        "bottom": {"velocity": (0.3, 0.0)},
        "top": {"pressure": 30.0, "mass": 1.0, "restitution": 0.5},
        "restitution": 0.6,
        **FALL,
    },
    "ramp": {"walls": (Segment((0.0, 0.3), (0.4, 0.0)), Segment((1.0, 0.5), (0.7, 0.2))), **FALL},
}


def filled(**fields: Any) -> Scene:
    """Return a scene of random grains in a box that is periodic in x.

    `fields` are fields of the scene, and the sides "bottom" and "top" of the box.
    """
    sides = {name: fields.pop(name) for name in ("bottom", "top") if name in fields}
    box = Box((0.2, 0.7), (0.0, 0.6), periodic="x", **sides)
    position, radius = random_layout(box.space, box.walls, radius=[0.02, 0.028], packing_fraction=0.6)
    own = {"radius": radius, "mass": 10.0 * pi * radius**2, "domain": box, "gravity": (0.0, 0.0)}
    how = {"drag": 0.05, "dt": 0.02, "duration": 30.0, "method": "accelerated", "tolerance": 1e-7}
    return Scene(position=position, **{**own, **how, **fields})


def boxed(kind: str, n: int = 60, seed: int = 1, **changes: Any) -> Scene:
    """Return a scene of grains with random velocities in the box `BOXES[kind]`."""
    fields: dict[str, Any] = {"gravity": (0.0, 0.0), "walls": ()} | BOXES[kind] | changes
    sides = {key: fields.pop(key) for key in ("periodic", "left", "bottom", "top") if key in fields}
    rng = np.random.default_rng(seed)
    position = rng.uniform((0.05, 0.05), (0.95, 0.65), (n, 2))
    for wall in fields["walls"]:
        position = position[~wall.covers(position)]
    radius = rng.uniform(0.02, 0.04, len(position))
    own = {"velocity": rng.normal(0.0, 0.5, position.shape), "radius": radius, "mass": 80.0 * radius**2}
    common = {"dt": 0.005, "max_iterations": 60, "domain": Box((0.0, 1.0), (0.0, 0.7), **sides)}
    return Scene(position=position, **own | common | fields)


WALLED: dict[str, Callable[..., Scene]] = {
    "every kind": around,
    "every kind, round": partial(around, wall="round"),
    "rotating circles": cloud,
    "rotating circles, round": partial(cloud, wall="round"),
    "one rotating circle": partial(cloud, radius_in=0.0, angular_velocity_in=0.0, walls=()),
    "equal grains": partial(cloud, mass=0.3, radius=0.04, drag=0.0, spin_drag=0.0),
    "smooth walls": partial(cloud, wall_friction=0.0, angular_velocity_in=0.0, angular_velocity_out=0.0),
    "smooth grains": partial(cloud, friction=0.0),
    "moving": stirred,
    "moving, every law": partial(stirred, **OF_ALL_LAWS, radius_in=0.05),
    "moving, turning gravity": partial(stirred, gravity=TURNING["gravity"], time=-0.2),
    "moving, from a time": partial(stirred, **TURNING, time=0.6),
    "pressure": pressed,
    "pressure, a light wall": partial(pressed, wall_mass=1.0, drag=0.5, dt=2e-2, walls=[DRIVEN]),
    "pressure, a heavy wall": partial(pressed, wall_mass=1e3, dt=2e-2, walls=[DRIVEN]),
    "pressure, two circles": partial(pressed, radius_in=0.15, walls=[DRIVEN], gravity=(0.0, -9.81)),
    "a driven segment": partial(pressed, pressure=None, walls=[STILL, DRIVEN], gravity=(0.0, -9.81)),
    **{f"corners, {kind}": partial(cornered, walls) for kind, walls in CORNERS.items()},
    **{f"box, {kind}": partial(boxed, kind) for kind in BOXES},
}
"""Functions that return scenes for tests of all kinds of walls, by a name of the test."""
