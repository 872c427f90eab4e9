"""Gap and normal of a grain at a wall's `Shape`, at rest, for all kinds of walls.

Each kind of wall has a file. The files of walls without thickness define nearest point and ends, that of rows
the nearest center, and the others gap and normal. The functions here choose the kind by shape[0].
"""

import warp as wp

from .. import law
from ..types import Shape
from . import arc, disc, line, row, segment

f64 = wp.float64


@wp.func
def nearest_on(x: wp.vec2d, shape: Shape) -> wp.vec2d:
    """Return the point of a wall without thickness that is nearest to x [m].

    For a kind without a branch here it is x, so that the normal is NaN, and velocities of grains become NaN.
    """
    if shape[0] == segment.KIND:
        return segment.nearest(x, shape)
    if shape[0] == arc.KIND:
        return arc.nearest(x, shape)
    return x


@wp.func
def shape_gap(x: wp.vec2d, radius: f64, shape: Shape) -> f64:
    """Return the gap between a grain at x and a wall [m]."""
    if shape[0] == disc.KIND:
        return disc.gap(x, radius, shape)
    if shape[0] == line.KIND:
        return line.gap(x, radius, shape)
    if shape[0] == row.KIND:
        return law.pair_gap(law.distance(x, row.nearest_center(x, shape)), radius, shape[5])
    return law.distance(x, nearest_on(x, shape)) - radius


@wp.func
def shape_normal(x: wp.vec2d, shape: Shape) -> wp.vec2d:
    """Return the unit normal from a grain at x into a wall."""
    if shape[0] == disc.KIND:
        return disc.normal(x, shape)
    if shape[0] == line.KIND:
        return line.normal(shape)
    if shape[0] == row.KIND:
        n, _ = law.normal(x, row.nearest_center(x, shape))
        return n
    n, _ = law.normal(x, nearest_on(x, shape))
    return n


@wp.func
def hollow_radius(x: wp.vec2d, shape: Shape) -> f64:
    """Return the radius of curvature where a grain at x touches a wall [m]: > 0 if concave, < 0 if convex.

    It is 0 at ends, at straight walls, and at rows, which do not turn.
    """
    if shape[0] == disc.KIND:
        return wp.where(shape[4] != f64(0.0), shape[3], -shape[3])
    if shape[0] == arc.KIND and arc.end_of(x, shape) < 0:
        inside = law.distance(x, wp.vec2d(shape[1], shape[2])) < shape[3]
        return wp.where(inside, shape[3], -shape[3])
    return f64(0.0)


@wp.func
def end_of(x: wp.vec2d, shape: Shape) -> int:
    """Return the end of a wall nearest to x, 0 or 1; -1 if another point is nearest or there is no end."""
    if shape[0] == segment.KIND:
        return segment.end_of(x, shape)
    if shape[0] == arc.KIND:
        return arc.end_of(x, shape)
    return -1


@wp.func
def inwards(end: int, p: wp.vec2d, shape: Shape) -> wp.vec2d:
    """Return the unit tangent of a wall at its end point p (number `end`), which points into the wall."""
    if shape[0] == arc.KIND:
        return arc.inwards(end, p, shape)
    return segment.inwards(end, shape)


@wp.func
def face_normal(p: wp.vec2d, x: wp.vec2d, shape: Shape) -> wp.vec2d:
    """Return the normal at point p of a wall, on the side of the wall where a grain at x is.

    It points into the wall, as `shape_normal` does. It is 0 if this side is convex.
    """
    if shape[0] == segment.KIND:
        left = law.tangent(segment.inwards(0, shape))
        return wp.where(wp.dot(shape_normal(x, shape), left) > f64(0.0), left, -left)
    if shape[0] == line.KIND:
        return line.normal(shape)
    center = wp.vec2d(shape[1], shape[2])
    radial, _ = law.normal(center, p)
    return wp.where(law.distance(center, x) < shape[3], radial, wp.vec2d(f64(0.0), f64(0.0)))
