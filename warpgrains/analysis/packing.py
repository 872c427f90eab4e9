"""How high and how densely grains are packed."""

import numpy as np

from warpgrains.analysis.snapshot import HasState, Snapshot, snapshot
from warpgrains.arrays import FloatArray
from warpgrains.scene.geometry import area_below


def upwards(gravity: tuple[float, float]) -> FloatArray:
    """Return the unit vector against gravity [m/s2]; without gravity, that of y."""
    size = np.hypot(*gravity)
    return -np.array(gravity) / size if size > 0.0 else np.array([0.0, 1.0])


def heights(of: Snapshot | HasState) -> FloatArray:
    """Return how high the grains' centres are above the origin, against gravity [m], shape (n,)."""
    moment = snapshot(of)
    return moment.position @ upwards(moment.scene.gravity)


def pile_height(of: Snapshot | HasState) -> float:
    """Return how far the highest point of a grain is above the lowest point of the walls [m]."""
    moment = snapshot(of)
    return float((heights(moment) + moment.scene.radius).max() + moment.scene.walls.depth)


def packing_fraction(of: Snapshot | HasState) -> float:
    """Return which share of the space between the walls the grains fill, beneath their mean height.

    Below the mean of the heights, weighted by area, a pile is dense; its loose surface does not count, nor
    does where the walls end. Grains and space are cut at that height exactly.
    """
    moment = snapshot(of)
    radius, height = moment.scene.radius, heights(moment)
    mean = (radius**2 * height).sum() / (radius**2).sum()
    return float(area_below(radius, mean - height).sum() / moment.scene.walls.area_below(mean))


def global_packing_fraction(of: Snapshot | HasState) -> float:
    """Return which share of the whole space between the walls the grains fill."""
    scene = snapshot(of).scene
    return float(np.pi * (scene.radius**2).sum() / scene.walls.area)
