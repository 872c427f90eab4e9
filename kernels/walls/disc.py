"""A disc: a wall that grains touch from outside, or a ring that they touch from inside."""

import warp as wp

from .. import law
from ..types import Shape

f64 = wp.float64
KIND = wp.constant(f64(1.0))


@wp.func
def gap(x: wp.vec2d, radius: f64, disc: Shape) -> f64:
    """Return the gap between a grain at x and a disc [m]; disc[1:] = center, radius, whether a ring."""
    distance = law.distance(x, wp.vec2d(disc[1], disc[2]))
    if disc[4] != f64(0.0):
        return disc[3] - distance - radius
    return law.pair_gap(distance, radius, disc[3])


@wp.func
def normal(x: wp.vec2d, disc: Shape) -> wp.vec2d:
    """Return the unit normal from a grain at x into a disc or ring."""
    n, _ = law.normal(x, wp.vec2d(disc[1], disc[2]))
    if disc[4] != f64(0.0):
        return -n
    return n
