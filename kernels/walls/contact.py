"""Contacts of grains with walls: walls within reach, normal and gap, velocity of the surface, and overlap."""

import warp as wp

from .. import law
from ..access import at, checked
from ..types import MOST_NUMBERS, PoseOf, Shape
from . import annulus
from .joints import contact_at_joint, have_joints, joint_reach
from .motion import from_frame
from .shapes import hollow_radius, shape_gap, shape_normal
from .walls import (
    CIRCLE_RADIUS,
    Walls,
    are_mobile,
    is_periodic,
    nearest_place,
    place_at,
    wall_body_count,
    wall_velocity,
)

f64 = wp.float64
IS_NEAR = f"""
    const auto is_near = [&](const auto &shape) {{
        constexpr int c = 1 + {MOST_NUMBERS};
        const double dx = shape[c] - x[0], dy = shape[c + 1] - x[1], near = reach + shape[c + 2];
        return dx * dx + dy * dy <= near * near;
    }};
"""
NEXT = """
    int k = begin;
    while (k < shapes.shape[0] && !is_near(shapes.data[k]))
        k++;
    return k;
"""


@wp.func_native(IS_NEAR + "return is_near(shape);")
def is_near_circle(shape: Shape, x: wp.vec2d, reach: f64) -> bool:
    """Return whether x is within `reach` [m] of the circle around a wall (`Shape`), which is a fast test."""
    ...


@wp.func_native(checked(IS_NEAR + NEXT))
def next_near(shapes: wp.array(dtype=Shape), begin: int, x: wp.vec2d, reach: f64) -> int:
    """Return the first index >= begin of a shape whose circle (`Shape`) is within reach [m] of x.

    If there is none, this is the number of shapes.
    """
    ...


@wp.func
def is_near_wall(b: int, x: wp.vec2d, radius: f64, walls: Walls, reach: f64) -> bool:
    """Return whether the gap between a grain at x and wall b, or an image of wall b, is at most `reach` [m].

    This is also true if the gap is NaN. At joints, a larger gap may suffice (`is_image_near`).
    """
    if b == 0:
        return annulus.is_near(x, radius, walls.annulus, reach)
    place, shape = nearest_place(b, x, walls), at(walls.shape, b - 1)
    far = radius + reach + joint_reach(walls, radius)
    if is_near_circle(shape, place, far) and is_image_near(b, place, radius, walls, reach):
        return True
    beyond = far + shape[CIRCLE_RADIUS]
    if not (is_periodic(walls) and beyond < f64(wp.inf)):
        return False
    listed = bool(False)
    away = place - wp.vec2d(shape[CIRCLE_RADIUS - 2], shape[CIRCLE_RADIUS - 1])
    is_beyond = bool(False)
    for d in range(2):
        is_beyond = is_beyond or (walls.period[d] > f64(0.0) and walls.period[d] - wp.abs(away[d]) <= beyond)
    if not is_beyond:
        return False
    for m in range(-1, 2):
        for n in range(-1, 2):
            moved = wp.vec2d(f64(m) * walls.period[0], f64(n) * walls.period[1])
            if wp.length_sq(moved) > f64(0.0) and is_near_circle(shape, place + moved, far):
                listed = listed or is_image_near(b, place + moved, radius, walls, reach)
    return listed


@wp.func
def is_image_near(b: int, place: wp.vec2d, radius: f64, walls: Walls, reach: f64) -> bool:
    """Return whether the gap between wall b and a grain is at most `reach` [m], or NaN.

    The grain is at `place` in the frame of the wall. At a joint, a gap of `reach` + `joint_reach` suffices if
    a joined wall is within `reach` of the grain.
    """
    gap = shape_gap(place, radius, at(walls.shape, b - 1))
    if gap > reach and gap <= reach + joint_reach(walls, radius) and have_joints(walls):
        for k in range(at(walls.joint_start, 2 * b - 2), at(walls.joint_start, 2 * b)):
            joined = at(walls.shape, at(walls.joint, k)[0])
            gap = wp.min(gap, shape_gap(place - at(walls.joint_way, k), radius, joined))
    return not (gap > reach)


@wp.func
def wall_contact(b: int, x: wp.vec2d, radius: f64, walls: Walls):
    """Return (normal, gap, gap on the other side, A of eq. 18) of a grain at x and wall b; lengths in m.

    The last two numbers are inf except at the annulus: other walls have one side, and are replaced by their
    tangents.
    """
    if b > 0:
        place, shape = place_at(b, x, walls), at(walls.shape, b - 1)
        n, gap = shape_normal(place, shape), shape_gap(place, radius, shape)
        if have_joints(walls) and gap <= radius:
            n, gap = contact_at_joint(b, x, place, radius, n, gap, walls)
        if are_mobile(walls):
            n = from_frame(at(walls.pose, b - 1), n)
        return n, gap, f64(wp.inf), f64(wp.inf)
    return annulus.contact(x, radius, walls.annulus)


@wp.func
def surface_velocity(b: int, x: wp.vec2d, reach: f64, n: wp.vec2d, walls: Walls) -> wp.vec2d:
    """Return (velocity of wall b along the normal n, along the tangent) at a contact [m/s] (eq. 26b).

    A grain at x touches the wall at x + reach n. A wall that is curved there turns about its center.
    """
    if not (b > 0 and are_mobile(walls)):
        return wp.vec2d()
    hollow = hollow_radius(place_at(b, x, walls), at(walls.shape, b - 1))
    u = wall_velocity(b, x + (reach - hollow) * n, walls)
    turning = hollow * at(walls.pose, b - 1)[PoseOf.ANGULAR_VELOCITY]
    return wp.vec2d(wp.dot(u, n), law.speed_along(u, n) + turning)


@wp.func
def wall_overlap(b: int, x: wp.vec2d, radius: f64, walls: Walls) -> f64:
    """Return the overlap of a grain at x with wall b [m], which is minus the gap."""
    if b > 0:
        return -shape_gap(place_at(b, x, walls), radius, at(walls.shape, b - 1))
    return annulus.overlap(x, radius, walls.annulus)


@wp.func
def worst_overlap(x: wp.vec2d, radius: f64, walls: Walls) -> f64:
    """Return the largest overlap of a grain at x with any wall [m]."""
    worst = wall_overlap(0, x, radius, walls)
    for b in range(1, wall_body_count(walls)):
        worst = wp.max(worst, wall_overlap(b, x, radius, walls))
    return worst
