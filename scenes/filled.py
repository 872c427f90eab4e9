"""Grains with friction that fill a box of straight walls, for the experiments of walls.py."""

from collections.abc import Sequence
from typing import Any

import numpy as np

import warpgrains as wg
from warpgrains.arrays import FloatArray
from warpgrains.scene.layouts import random
from warpgrains.scene.walls import Annulus

DIAMETER = 0.04
"""Mean diameter of the grains [m]."""
RADII = (0.016, 0.024)
"""Between these the radii are distributed uniformly [m]."""
DENSITY = 10.0
"""kg/m2."""
FRACTION = 0.82
"""Packing fraction that sizes of boxes are computed with."""
LOOSER = 1.3
"""Area at the start, over that at rest."""
G = 9.81


def room(count: int) -> float:
    """Return the area that grains at rest fill, with the space between them [m2]."""
    low, high = RADII
    return count * np.pi * (low**2 + low * high + high**2) / 3.0 / FRACTION


def filled(
    walls: Sequence[wg.Segment],
    box: tuple[float, float, float],
    count: int,
    seed: int,
    radius_out: float,
    **fields: Any,
) -> wg.Scene:
    """Return grains at random in a box, looser than at rest.

    The box reaches from left to right, upwards from a floor. Lengths are in m. `fields` replaces fields of
    the scene.
    """
    left, right, floor = box
    high = floor + LOOSER * room(count) / (right - left)
    region = {"x": [left, right], "y": [floor, high]}
    position, radius = random(
        Annulus(0.0, radius_out), (), radius=list(RADII), count=count, region=region, seed=seed
    )
    return wg.Scene(
        **{
            "position": position,
            "radius": radius,
            "mass": DENSITY * np.pi * np.square(radius),
            "radius_out": radius_out,
            "walls": walls,
            "friction": 0.5,
            "dt": 0.004,
            "scheme": "leapfrog",
            "tolerance": 1e-4,
            "max_iterations": 300,
            "method": "accelerated",
            "order": "color",
            **fields,
        }
    )


def opened(scene: wg.Scene, settling: float, gates: int = 1) -> wg.Simulation:
    """Return a simulation that begins when grains have settled [s]; the last walls, the gates, are gone."""
    closed = wg.Simulation(scene, threads=1)
    closed.run(duration=settling)
    state = {"position": closed.position, "velocity": closed.velocity, "spin": closed.spin}
    return wg.Simulation(scene.replace(**state, walls=scene.walls[:-gates]), threads=1)


def straight_line(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Return intercept and slope of the line with the least squares."""
    intercept, slope = np.polynomial.Polynomial.fit(x, y, 1).convert().coef
    return float(intercept), float(slope)
