"""A straight wall inside the annulus: a segment that grains touch from both sides, and round its ends.

Its tangent for a step is at right angles to the way from the grain to the nearest point of the segment.
"""

import warp as wp

from .types import Shape

f64 = wp.float64
KIND = wp.constant(f64(2.0))


@wp.func
def nearest(x: wp.vec2d, wall: Shape) -> wp.vec2d:
    """Return the point of a segment, (start, end), that is nearest to x [m]."""
    dx, dy = wall[3] - wall[1], wall[4] - wall[2]
    along = ((x[0] - wall[1]) * dx + (x[1] - wall[2]) * dy) / (dx * dx + dy * dy)
    share = wp.min(wp.max(along, f64(0.0)), f64(1.0))
    return wp.vec2d(wall[1] + share * dx, wall[2] + share * dy)
