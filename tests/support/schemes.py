"""Combinations of `scheme` and `wall` for tests, and their free velocities and masses."""

import numpy as np
import pytest

from warpgrains import Scene
from warpgrains.base.arrays import FloatArray

EULER = {"scheme": "euler", "wall": "tangent"}
SECOND_ORDER = {"scheme": "leapfrog", "wall": "round"}
SCHEMES = [pytest.param(EULER, id="euler"), pytest.param(SECOND_ORDER, id="second order")]
MIXED = [
    pytest.param(EULER | {"wall": "round"}, id="text, round wall"),
    pytest.param(SECOND_ORDER | {"wall": "tangent"}, id="leapfrog, tangents"),
]


def without_contacts(scene: Scene, v: FloatArray, staggered: bool) -> FloatArray:
    """Return the velocities after a step without contacts [m/s], shape (n, 2).

    The step is explicit Euler, or leapfrog with drag at the midpoint. `v` are the velocities before it. In
    leapfrog, they are half a step early if `staggered`; otherwise they belong to the same time as the
    positions.
    """
    g, rate = np.array(scene.gravity), (scene.drag / scene.mass)[:, None]
    if scene.scheme == "euler":
        return v + scene.dt * (g - rate * v)
    old, kick = (0.5 * v, scene.dt) if staggered else (0.0 * v, 0.5 * scene.dt)
    return (v + kick * g - scene.dt * rate * old) / (1.0 + 0.5 * scene.dt * rate)


def contact_mass(scene: Scene) -> FloatArray:
    """Return the contact impulse that changes the velocity of each grain by 1 m/s [kg], shape (n,).

    It is the mass, in leapfrog plus dt drag / 2.
    """
    return scene.mass + (0.5 * scene.dt * scene.drag if scene.scheme == "leapfrog" else 0.0)
