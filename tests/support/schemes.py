"""The schemes of time and wall that every kind of check is made with."""

import numpy as np
import pytest

from warpgrains import Scene
from warpgrains.base.arrays import FloatArray

TEXTS = {"scheme": "text", "wall": "tangent"}
SECOND_ORDER = {"scheme": "leapfrog", "wall": "round"}
SCHEMES = [pytest.param(TEXTS, id="text"), pytest.param(SECOND_ORDER, id="second order")]
MIXED = [
    pytest.param(TEXTS | {"wall": "round"}, id="text, round wall"),
    pytest.param(SECOND_ORDER | {"wall": "tangent"}, id="leapfrog, tangents"),
]


def without_contacts(scene: Scene, v: FloatArray, staggered: bool) -> FloatArray:
    """Velocities after a step without contacts [m/s]: by Euler, or with drag on the mean of old and new."""
    g, rate = np.array(scene.gravity), (scene.drag / scene.mass)[:, None]
    if scene.scheme == "text":
        return v + scene.dt * (g - rate * v)
    old, kick = (0.5 * v, scene.dt) if staggered else (0.0 * v, 0.5 * scene.dt)
    return (v + kick * g - scene.dt * rate * old) / (1.0 + 0.5 * scene.dt * rate)


def contact_mass(scene: Scene) -> FloatArray:
    """Impulse that changes a velocity by 1 m/s [kg], shape (n,): midpoint drag acts on half of the change."""
    return scene.mass + (0.5 * scene.dt * scene.drag if scene.scheme == "leapfrog" else 0.0)
