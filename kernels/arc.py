"""An arc inside the annulus: a part of a circle that grains touch from both sides, and round its ends."""

import warp as wp

from . import law
from .types import Shape

f64 = wp.float64
KIND = wp.constant(f64(3.0))


@wp.func
def nearest(x: wp.vec2d, arc: Shape) -> wp.vec2d:
    """Return the point of an arc nearest to x [m], its middle where all are; for its numbers see `Arc`."""
    center, mx, my, c = wp.vec2d(arc[1], arc[2]), arc[4], arc[5], arc[6]
    dx, dy, rho = x[0] - arc[1], x[1] - arc[2], law.distance(center, x)
    if rho == f64(0.0):
        return wp.vec2d(arc[1] + arc[3] * mx, arc[2] + arc[3] * my)
    if dx * mx + dy * my >= rho * c:
        return wp.vec2d(arc[1] + dx * (arc[3] / rho), arc[2] + dy * (arc[3] / rho))
    s = wp.sqrt(f64(1.0) - c * c)
    if mx * dy - my * dx < f64(0.0):
        s = -s
    return wp.vec2d(arc[1] + arc[3] * (c * mx - s * my), arc[2] + arc[3] * (c * my + s * mx))
