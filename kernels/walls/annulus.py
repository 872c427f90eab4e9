"""The annulus: an outer circle, and an inner one or none, as the two sides of one wall.

Its normal starts at the origin. dv > 0 is carried by the outer circle, dv < 0 by the inner one (MODEL.md,
eq. 8). Where the outer circle is round within a step, it leaves a smaller gap to a grain that slides along it
(eq. 18).
"""

import warp as wp

from .. import law

f64 = wp.float64


@wp.struct
class Annulus:
    """The circles of the outer and the inner wall."""

    radius_in: f64  # [m]; 0: there is no inner circle
    radius_out: f64  # [m]
    angular_velocity_out: f64  # [rad/s]
    round: wp.int32  # whether the outer wall is a circle within a step as well, or its tangent


@wp.func
def outer_gap(distance: f64, radius: f64, walls: Annulus) -> f64:
    """Free distance between a grain and the outer circle [m]."""
    return walls.radius_out - distance - radius


@wp.func
def inner_gap(distance: f64, radius: f64, walls: Annulus) -> f64:
    """Free distance between a grain and the inner circle [m]; inf without one."""
    if walls.radius_in > f64(0.0):
        return distance - walls.radius_in - radius
    return f64(wp.inf)


@wp.func
def is_near(x: wp.vec2d, radius: f64, walls: Annulus, reach: f64) -> bool:
    """Return whether a circle is within reach [m] of a grain at x."""
    distance = wp.length(x)
    return outer_gap(distance, radius, walls) <= reach or inner_gap(distance, radius, walls) <= reach


@wp.func
def contact(x: wp.vec2d, radius: f64, walls: Annulus):
    """Return normal, outer gap, inner gap, and A of eq. 18 (inf for a tangent) [m] of a grain at x."""
    n, distance = law.normal(wp.vec2d(f64(0.0), f64(0.0)), x)
    circle = wp.where(walls.round != 0, walls.radius_out - radius, f64(wp.inf))
    return n, outer_gap(distance, radius, walls), inner_gap(distance, radius, walls), circle


@wp.func
def overlap(x: wp.vec2d, radius: f64, walls: Annulus) -> f64:
    """Return how far a grain at x overlaps a circle [m]; negative where it does not."""
    distance = wp.length(x)
    return wp.max(-outer_gap(distance, radius, walls), -inner_gap(distance, radius, walls))
