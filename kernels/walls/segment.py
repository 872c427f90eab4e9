"""A segment: a straight wall, which grains touch from both sides and at both end points.

The normal of a step points from the center of the grain to the nearest point of the segment.
"""

import warp as wp

from .. import law
from ..types import Shape

f64 = wp.float64
KIND = wp.constant(f64(2.0))


@wp.func
def share(x: wp.vec2d, wall: Shape) -> f64:
    """Return the parameter of a segment's point nearest to x: 0 at the start, 1 at the end of the segment."""
    dx, dy = wall[3] - wall[1], wall[4] - wall[2]
    along = ((x[0] - wall[1]) * dx + (x[1] - wall[2]) * dy) / (dx * dx + dy * dy)
    return wp.min(wp.max(along, f64(0.0)), f64(1.0))


@wp.func
def nearest(x: wp.vec2d, wall: Shape) -> wp.vec2d:
    """Return the point of a segment nearest to x [m]; wall[1:] = start, end."""
    along = share(x, wall)
    return wp.vec2d(wall[1] + along * (wall[3] - wall[1]), wall[2] + along * (wall[4] - wall[2]))


@wp.func
def end_of(x: wp.vec2d, wall: Shape) -> int:
    """Return the end nearest to x (0: start, 1: end), or -1 if a point between the ends is nearest."""
    along = share(x, wall)
    return wp.where(along == f64(0.0), 0, wp.where(along == f64(1.0), 1, -1))


@wp.func
def inwards(end: int, wall: Shape) -> wp.vec2d:
    """Return the unit vector along a segment that points from the given end into the segment."""
    along, _ = law.normal(wp.vec2d(wall[1], wall[2]), wp.vec2d(wall[3], wall[4]))
    return wp.where(end == 0, along, -along)
