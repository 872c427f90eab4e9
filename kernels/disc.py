"""A disc that stands fixed inside the annulus: a wall that grains touch from outside, and slide off."""

import warp as wp

from . import law
from .types import Shape

f64 = wp.float64


@wp.func
def gap_at(x: wp.vec2d, radius: f64, disc: Shape) -> f64:
    """Return the free distance between a grain at x and a disc, (center, radius) [m]."""
    return law.pair_gap(law.distance(x, wp.vec2d(disc[1], disc[2])), radius, disc[3])


@wp.func
def is_near(x: wp.vec2d, radius: f64, disc: Shape, reach: f64) -> bool:
    """Return whether a disc is within reach [m] of a grain at x."""
    return gap_at(x, radius, disc) <= reach


@wp.func
def frame(x: wp.vec2d, radius: f64, disc: Shape):
    """Return normal, gap, gap on the other side (inf), and A of eq. 18 (inf: its tangent) [m]."""
    n, _ = law.normal(x, wp.vec2d(disc[1], disc[2]))
    return n, gap_at(x, radius, disc), f64(wp.inf), f64(wp.inf)


@wp.func
def overlap(x: wp.vec2d, radius: f64, disc: Shape) -> f64:
    """Return how far a grain at x overlaps a disc [m]; negative where it does not."""
    return -gap_at(x, radius, disc)
