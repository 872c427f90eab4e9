"""Joints of walls: a grain at the end of a wall touches the nearest one of the joined walls (eq. 8c)."""

import warp as wp

from .. import law
from ..access import at
from .shapes import end_of, face_normal, inwards, nearest_on, shape_gap
from .walls import CIRCLE_RADIUS, Walls, is_periodic, nearest_place

f64 = wp.float64
FLUSH = wp.constant(f64(1e-9))  # sine of the angle up to which two faces at a joint count as one face


@wp.func
def have_joints(walls: Walls) -> bool:
    """Return whether an end of a wall lies on another wall."""
    return walls.joint.shape[0] > 0


@wp.func
def joint_reach(walls: Walls, radius: f64) -> f64:
    """Return the length [m] by which joints increase the gap at which a wall is listed; 0 without joints."""
    return wp.where(have_joints(walls), f64(2.0) * radius, f64(0.0))


@wp.func
def place_at_joint(k: int, x: wp.vec2d, place: wp.vec2d, walls: Walls) -> wp.vec2d:
    """Return the place x of a grain [m] in the frame of the wall of joint[k].

    `place` is x in the frame of the wall at whose end the joint is. The result has the same bits as if
    computed for the wall of joint[k] alone, so that both walls agree which of them is nearer.
    """
    if not is_periodic(walls):
        return place
    near = nearest_place(1 + at(walls.joint, k)[0], x, walls)
    wanted = place - at(walls.joint_way, k)
    for d in range(2):
        if walls.period[d] > f64(0.0):
            near[d] = near[d] + walls.period[d] * wp.rint((wanted[d] - near[d]) / walls.period[d])
    return near


@wp.func
def nearest_joined(end: int, at_grain: wp.vec2d, x: wp.vec2d, radius: f64, gap: f64, walls: Walls):
    """Return the index in `joint` of the joined wall nearest to a grain, and its gap [m].

    The index is -1 if no joined wall is nearer than the gap [m] of the wall itself. `end` is the end of this
    wall, as in `joint_start`. The grain is at `at_grain`, and at x in the frame of this wall.
    """
    nearest, least = int(-1), f64(gap)
    for k in range(at(walls.joint_start, end), at(walls.joint_start, end + 1)):
        joined = at(walls.joint, k)
        its = shape_gap(place_at_joint(k, at_grain, x, walls), radius, at(walls.shape, joined[0]))
        if its < least or (its == least and nearest < 0 and joined[1] != 0):
            nearest, least = k, its
    return nearest, least


@wp.func
def contact_at_joint(
    b: int, at_grain: wp.vec2d, x: wp.vec2d, radius: f64, n: wp.vec2d, gap: f64, walls: Walls
):
    """Return normal n and gap [m] of a grain at wall b, changed if a joined wall is nearer (eq. 8c).

    The arguments `n` and `gap` are those of wall b alone. The grain is at `at_grain`, and at x in the frame
    of wall b. If the joined wall rises towards the grain from wall b, the grain touches the tangent of wall b
    at the joint. Otherwise it touches only the joined wall, and the gap at wall b becomes very large.
    """
    shape = at(walls.shape, b - 1)
    end = end_of(x, shape)
    if end < 0:
        return n, gap
    nearest, least = nearest_joined(2 * (b - 1) + end, at_grain, x, radius, gap, walls)
    if nearest < 0:
        return n, gap
    other_shape = at(walls.shape, at(walls.joint, nearest)[0])
    moved = at(walls.joint_way, nearest)
    y, p = place_at_joint(nearest, at_grain, x, walls), nearest_on(x, shape)
    along = inwards(end, p, shape)
    shorter = wp.min(shape[CIRCLE_RADIUS], other_shape[CIRCLE_RADIUS])
    rises = wp.dot(along, face_normal(p - moved, y, other_shape)) < -FLUSH and f64(2.0) * shorter >= radius
    if rises and end_of(y, other_shape) < 0:
        left = law.tangent(along)
        height = wp.dot(left, x - p)
        return wp.where(height > f64(0.0), -left, left), wp.max(wp.abs(height) - radius, least)
    apart = law.distance(p - moved, nearest_on(y, other_shape))
    if rises and apart > f64(2.0) * FLUSH * wp.max(shape[CIRCLE_RADIUS], other_shape[CIRCLE_RADIUS]):
        return n, gap
    return n, gap + f64(2.0) * walls.annulus.radius_out
