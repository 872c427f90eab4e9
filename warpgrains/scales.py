"""Lengths of a scene that its lists of contacts are made with."""

import numpy as np

from warpgrains.scene import Scene

SLACK = 0.12  # of the smallest radius: how far grains may at first stray before a list is built anew


def smallest_radius(scene: Scene) -> float:
    """Return the radius of the smallest grain [m]."""
    return scene.radius.min().item()


def first_slack(scene: Scene) -> float:
    """Return how far grains may at first stray before a list is built anew [m]."""
    return SLACK * smallest_radius(scene)


def cell_size(scene: Scene) -> float:
    """Return the side of a cell [m]: about the diameter of the grains that are most frequent."""
    return 2.0 * (float(np.median(scene.radius)) + first_slack(scene))


def room(scene: Scene) -> float:
    """Return how far grains may come beside the others while a list lasts [m]."""
    return 0.5 * float(np.median(scene.radius))


def acceleration(scene: Scene) -> float:
    """Return the magnitude of the gravity [m/s2]."""
    return float(np.hypot(*scene.gravity))


def rounding(scene: Scene) -> float:
    """Return what may be lost in the digits of a position [m]."""
    return 16.0 * float(np.finfo(float).eps) * scene.radius_out
