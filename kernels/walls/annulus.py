"""The annulus: an outer circle and, optionally, an inner circle, as the two sides of one wall.

The normal points away from the origin. The outer circle carries dv > 0, the inner circle dv < 0 (MODEL.md,
eq. 8). If the outer circle is round within a step, the gap of a grain that slides along it is smaller
(eq. 18).
"""

import warp as wp

from .. import law

f64 = wp.float64


@wp.struct
class Annulus:
    """The outer and the inner circle."""

    radius_in: f64  # [m]; 0 without an inner circle
    radius_out: f64  # [m]
    angular_velocity_out: f64  # [rad/s]
    round: wp.int32  # whether the outer wall is a circle within a step (1), or a tangent of it (0)


@wp.func
def outer_gap(distance: f64, radius: f64, walls: Annulus) -> f64:
    """Return the gap between the outer circle and a grain at this distance from the origin [m]."""
    return walls.radius_out - distance - radius


@wp.func
def inner_gap(distance: f64, radius: f64, walls: Annulus) -> f64:
    """Return the gap between the inner circle and a grain at this distance [m]; inf without a circle."""
    if walls.radius_in > f64(0.0):
        return distance - walls.radius_in - radius
    return f64(wp.inf)


@wp.func
def is_near(x: wp.vec2d, radius: f64, walls: Annulus, reach: f64) -> bool:
    """Return whether the gap between a grain at x and one of the circles is at most `reach` [m]."""
    distance = wp.length(x)
    return outer_gap(distance, radius, walls) <= reach or inner_gap(distance, radius, walls) <= reach


@wp.func
def contact(x: wp.vec2d, radius: f64, walls: Annulus):
    """Return (normal, outer gap, inner gap, A) of a grain at x [m].

    A = R_out - r if the outer circle is round within a step (eq. 18), and inf otherwise.
    """
    n, distance = law.normal(wp.vec2d(f64(0.0), f64(0.0)), x)
    circle = wp.where(walls.round != 0, walls.radius_out - radius, f64(wp.inf))
    return n, outer_gap(distance, radius, walls), inner_gap(distance, radius, walls), circle


@wp.func
def overlap(x: wp.vec2d, radius: f64, walls: Annulus) -> f64:
    """Return the larger overlap of a grain at x with the two circles [m]; negative if there is none."""
    distance = wp.length(x)
    return wp.max(-outer_gap(distance, radius, walls), -inner_gap(distance, radius, walls))
