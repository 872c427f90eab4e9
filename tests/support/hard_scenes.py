"""Scenes that are known to be hard for contact solvers."""

from typing import Any

import numpy as np

from warpgrains import Scene
from warpgrains.base.arrays import FloatArray
from warpgrains.scene.layouts import column, lattice
from warpgrains.walls.annulus import Annulus

RADIUS_OUT = 1.0  # m
ROUGH: dict[str, Any] = {"method": "exact", "tolerance": 1e-9, "max_iterations": 320}
ROUGH |= {"friction": 0.5, "exact_budget": 1e3}
"""Fields of scenes with friction and the exact method, which calls the host solver after 320 sweeps."""
SOON: dict[str, Any] = {"method": "exact", "tolerance": 1e-10, "max_iterations": 3}
"""Fields of the exact method with which it calls the host solver after 3 sweeps."""


def stack(count: int) -> Scene:
    """Return a vertical column of touching grains at x = 0, and a grain that lands on it at 1 m/s."""
    position, radius = column(
        Annulus(0.0, RADIUS_OUT).space, count=count + 1, radius=0.95 / (count + 2), spacing=2.0
    )
    position[-1, 1] += 0.02
    velocity = np.zeros_like(position)
    velocity[-1, 1] = -1.0
    return Scene(position=position, velocity=velocity, radius=radius, mass=0.1, radius_out=RADIUS_OUT)


def heap(count: int, spacing: float = 2.05, **changes: Any) -> Scene:
    """Return `count` equal grains that cover 40 % of the disc, from its bottom up.

    They start on a lattice with this spacing [radii], each displaced a little. `changes` replace fields.
    """
    radius = np.sqrt(0.4 / count)
    position, _ = lattice(Annulus(0.0, RADIUS_OUT).space, radius=radius, count=count, spacing=spacing)
    off = abs(spacing - 2.0) * radius / 4.0
    position += np.random.default_rng(1).uniform(-off, off, position.shape)
    return Scene(**{"position": position, "radius": radius, "mass": 0.1, "radius_out": RADIUS_OUT, **changes})


def random_masses(count: int, ratio: float) -> Scene:
    """Return a heap with random masses from 0.1 kg to 0.1 `ratio` kg, whose logarithms are uniform."""
    return heap(count, mass=0.1 * ratio ** np.random.default_rng(2).uniform(0.0, 1.0, count))


def heavy_top(count: int, ratio: float) -> Scene:
    """Return a heap whose highest tenth of grains is `ratio` times heavier than the others."""
    scene = heap(count)
    mass = np.full(count, 0.1)
    mass[np.argsort(scene.position[:, 1])[-count // 10 :]] *= ratio
    return scene.replace(mass=mass)


def jam() -> Scene:
    """Return grains that cover 80 % of the disc and move in random directions."""
    position, radius = lattice(Annulus(0.0, RADIUS_OUT).space, radius=0.04, spacing=2.04)
    velocity = np.random.default_rng(4).normal(0.0, 1.0, position.shape)
    return Scene(position=position, velocity=velocity, radius=radius, mass=0.1, radius_out=RADIUS_OUT)


def sizes(radius: FloatArray) -> Scene:
    """Return grains of these radii at random places without overlaps, with masses 10 radius^2."""
    rng = np.random.default_rng(3)
    radius, position = np.sort(radius)[::-1], np.empty((0, 2))
    while len(position) < len(radius):
        r, at = radius[len(position)], rng.uniform(-RADIUS_OUT, RADIUS_OUT, 2)
        is_free = (np.hypot(*(position - at).T) > radius[: len(position)] + r).all()
        if is_free and np.hypot(*at) < RADIUS_OUT - r:
            position = np.vstack([position, at])
    return Scene(position=position, radius=radius, mass=10.0 * radius**2, radius_out=RADIUS_OUT)


def past_the_origin(radius: float) -> Scene:
    """Return a grain that passes the origin at 1e-9 m, so that the wall's normal reverses within a step."""
    grain = {"position": [[-0.0155, 1e-9]], "velocity": [[1.0, 0.0]], "radius": radius, "mass": 0.1}
    return Scene(**grain, radius_out=RADIUS_OUT, gravity=(0.0, 0.0))


def drum(**changes: Any) -> Scene:
    scene = heap(60, spacing=2.0, wall="round", scheme="leapfrog", drag=0.1, dt=0.01, **ROUGH)
    return scene.replace(**{"wall_friction": 0.8, "angular_velocity_out": 0.5, **changes})


def couette(**changes: Any) -> Scene:
    place, radius = lattice(Annulus(0.3, 1.0).space, radius=0.06, count=60, spacing=2.02)
    mass = 0.1 * 10.0 ** np.random.default_rng(2).uniform(0.0, 1.0, len(place))
    circles = {"radius_in": 0.3, "radius_out": 1.0, "angular_velocity_in": 5.0}
    return Scene(position=place, radius=radius, mass=mass, **{**circles, **ROUGH, **changes})
