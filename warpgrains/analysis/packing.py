"""How high and how densely grains are packed."""

import numpy as np
from numpy.typing import ArrayLike

from warpgrains.analysis.snapshot import HasState, Snapshot, snapshot
from warpgrains.arrays import FloatArray
from warpgrains.scene.geometry import area_below
from warpgrains.solver.ends import Grains


def upwards(gravity: ArrayLike) -> FloatArray:
    """Return the unit vectors against gravity [m/s2], shape (..., 2); without gravity, that of y."""
    g = np.array(gravity)
    size, up = np.hypot(g[..., :1], g[..., 1:]), np.zeros_like(g)
    up[..., 1] = 1.0
    return np.divide(-g, size, out=up, where=size > 0.0)


def heights(of: Snapshot | HasState) -> FloatArray:
    """Return how high the grains' centres are above the origin, against gravity [m], shape (n,).

    Examples
    --------
    >>> analysis.heights(simulation).shape
    (15,)
    """
    return _heights(snapshot(of).grains)[0]


def _heights(grains: Grains) -> FloatArray:
    return (grains.position @ upwards(grains.gravity)[..., np.newaxis])[..., 0]


def pile_height(of: Snapshot | HasState) -> float:
    """Return how far the highest point of a grain is above the lowest point of the walls [m].

    Examples
    --------
    >>> f"{analysis.pile_height(simulation):.3f} m"
    '1.638 m'
    """
    return pile_heights(snapshot(of).grains).item()


def pile_heights(grains: Grains) -> FloatArray:
    """Return the heights of the piles of many runs [m], shape (m,)."""
    return (_heights(grains) + grains.radius).max(axis=-1) + grains.walls.depth


def packing_fraction(of: Snapshot | HasState) -> float:
    """Return which share of the space between the walls the grains fill, beneath their mean height.

    Below the mean of the heights, weighted by area, a pile is dense; its loose surface does not count, nor
    does where the walls end. Grains and space are cut at that height exactly.

    Examples
    --------
    >>> round(analysis.packing_fraction(simulation), 3)
    0.672
    """
    return packing_fractions(snapshot(of).grains).item()


def packing_fractions(grains: Grains) -> FloatArray:
    """Return the packing fractions of many runs, shape (m,)."""
    radius, height, mean = grains.radius, _heights(grains), mean_heights(grains)
    return area_below(radius, mean[:, np.newaxis] - height).sum(axis=-1) / grains.walls.area_below(mean)


def mean_heights(grains: Grains) -> FloatArray:
    """Return the mean heights of the grains of many runs, weighted by area [m], shape (m,)."""
    area = grains.radius**2
    return (area * _heights(grains)).sum(axis=-1) / area.sum(axis=-1)


def global_packing_fraction(of: Snapshot | HasState) -> float:
    """Return which share of the whole space between the walls the grains fill.

    Examples
    --------
    >>> round(analysis.global_packing_fraction(simulation), 4)
    0.04
    """
    scene = snapshot(of).scene
    return float(np.pi * (scene.radius**2).sum() / scene.walls.area)
