"""An arc: a part of a circle, which grains touch from both sides and at both end points."""

import warp as wp

from .. import law
from ..types import Shape

f64 = wp.float64
KIND = wp.constant(f64(3.0))


@wp.func
def end_of(x: wp.vec2d, arc: Shape) -> int:
    """Return the end nearest to x (0: first, 1: last), or -1 if a point between the ends is nearest."""
    dx, dy, rho = x[0] - arc[1], x[1] - arc[2], law.distance(wp.vec2d(arc[1], arc[2]), x)
    if dx * arc[4] + dy * arc[5] >= rho * arc[6]:
        return -1
    return wp.where(arc[4] * dy - arc[5] * dx < f64(0.0), 0, 1)


@wp.func
def nearest(x: wp.vec2d, arc: Shape) -> wp.vec2d:
    """Return the point of an arc nearest to x [m]; if x is the center of the arc's circle, the arc's middle.

    arc[1:] = center, radius, direction from the center to the middle, cosine of half the angle of the arc.
    """
    mx, my, c = arc[4], arc[5], arc[6]
    rho, end = law.distance(wp.vec2d(arc[1], arc[2]), x), end_of(x, arc)
    if rho == f64(0.0):
        return wp.vec2d(arc[1] + arc[3] * mx, arc[2] + arc[3] * my)
    if end < 0:
        return wp.vec2d(arc[1] + (x[0] - arc[1]) * (arc[3] / rho), arc[2] + (x[1] - arc[2]) * (arc[3] / rho))
    s = wp.sqrt(f64(1.0) - c * c)
    if end == 0:
        s = -s
    return wp.vec2d(arc[1] + arc[3] * (c * mx - s * my), arc[2] + arc[3] * (c * my + s * mx))


@wp.func
def inwards(end: int, p: wp.vec2d, arc: Shape) -> wp.vec2d:
    """Return the unit tangent of an arc at end point p (number `end`), which points into the arc."""
    radial, _ = law.normal(wp.vec2d(arc[1], arc[2]), p)
    along = law.tangent(radial)
    return wp.where(end == 0, along, -along)
