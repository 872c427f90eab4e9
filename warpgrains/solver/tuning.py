"""Lengths of a scene that its lists of contacts are made with."""

import numpy as np

from warpgrains.scene.scene import Scene

SLACK = 0.12  # of the smallest radius: how far grains may at first stray before a list is built anew


def smallest_radius(scene: Scene) -> float:
    """Return the radius of the smallest grain [m]."""
    return scene.radius.min().item()


def typical_radius(scene: Scene) -> float:
    """Return the median radius [m]; thousands of scenes ask for it, and NumPy's own takes 20 us."""
    ascending, half = np.sort(scene.radius), scene.n // 2
    return 0.5 * float(ascending[half] + ascending[-half - 1])


def first_slack(scene: Scene) -> float:
    """Return how far grains may at first stray before a list is built anew [m]."""
    return SLACK * smallest_radius(scene)


def cell_size(scene: Scene) -> float:
    """Return the side of a cell [m]: about the diameter of the grains that are most frequent."""
    return 2.0 * (typical_radius(scene) + first_slack(scene))


def room(scene: Scene) -> float:
    """Return how far grains may come beside the others while a list lasts [m]."""
    return 0.5 * typical_radius(scene)


def acceleration(scene: Scene) -> float:
    """Return the magnitude of the gravity [m/s2]."""
    return float(np.hypot(*scene.gravity))


def rounding(scene: Scene) -> float:
    """Return what may be lost in the digits of a position [m]."""
    return 16.0 * float(np.finfo(float).eps) * scene.radius_out
