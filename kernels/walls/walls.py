"""The walls of a scene as bodies that grains touch, with their positions and joints.

Body 0 is the annulus (annulus.py), whose circles are the two sides of one wall. The other walls follow, each
with a `Shape` (shapes.py). Other files treat contacts with walls and with grains alike (contacts.py). For a
step, a wall is replaced by its tangent at the positions at the start of the step. A wall with a prescribed
motion (motion.py) or a driven wall (driven.py) has a velocity in the step, which is part of the gap rate or
of vn of its contacts.
"""

import warp as wp

from .. import law
from ..access import at, checked, put
from ..types import MOST_NUMBERS, Drive, Floats, Ints, Motion, MotionOf, Pose, PoseOf, Shape, Vectors
from . import annulus
from .annulus import Annulus
from .motion import from_frame, moving_time, pose_at, to_frame, velocity_at
from .shapes import end_of, face_normal, hollow_radius, inwards, nearest_on, shape_gap, shape_normal

f64 = wp.float64
CIRCLE_RADIUS = wp.constant(1 + MOST_NUMBERS + 2)  # index of this number of a shape
FLUSH = wp.constant(f64(1e-9))  # sine of the angle up to which two faces at a joint count as one face


@wp.struct
class Walls:
    """The annulus, and the arrays of the other walls or of all walls."""

    annulus: Annulus
    period: wp.vec2d  # of the domain along x and y [m]; 0 in directions that are not periodic
    shape: wp.array(dtype=Shape)  # of the other walls
    image: Vectors  # of a wall that is an image: shift in the frame, see place_at [m]; empty without images
    joint_start: Ints  # of end e of shape k, at 2 k + e: first index in `joint`; empty without joints
    joint: wp.array(dtype=wp.vec2i)  # shape of a joined wall, and 1 if it precedes an equally near wall
    joint_way: Vectors  # shift of each joined wall to the image at the joint [m]
    motion: wp.array(dtype=Motion)  # of the other walls
    pose: wp.array(dtype=Pose)  # of the other walls, at the start of a step; both empty if no wall is mobile
    drive: wp.array(dtype=Drive)  # of all walls; empty if none is driven
    surface: wp.array(dtype=wp.vec2d)  # friction, and speed along the tangent [m/s]; empty without friction
    restitution: Floats  # of all walls; empty if no contact bounces
    rolling: wp.array(dtype=wp.vec2d)  # rolling friction, and spin [rad/s]; empty without rolling friction


@wp.func
def wall_body_count(walls: Walls) -> int:
    """Return the number of walls, with the annulus."""
    return 1 + walls.shape.shape[0]


@wp.func
def are_mobile(walls: Walls) -> bool:
    """Return whether at least one wall is mobile, by a prescribed motion or because a force drives it."""
    return walls.pose.shape[0] > 0


@wp.func
def place_walls(walls: Walls, begin: f64, end: f64, dt: f64):
    """Set the poses of walls with a prescribed motion for a step from time begin to time end [s]."""
    for k in range(walls.motion.shape[0]):
        put(walls.pose, k, pose_at(at(walls.motion, k), begin, end, dt))


@wp.func
def wall_path(b: int, walls: Walls, begin: f64, end: f64) -> f64:
    """Return a bound on the path of any point of wall b from time begin to time end [s], in m."""
    if are_mobile(walls) and b > 0:
        motion = at(walls.motion, b - 1)
        return (moving_time(motion, end) - moving_time(motion, begin)) * motion[MotionOf.SPEED]
    return f64(0.0)


@wp.func
def is_periodic(walls: Walls) -> bool:
    """Return whether the domain is periodic in at least one direction."""
    return walls.period[0] > f64(0.0) or walls.period[1] > f64(0.0)


@wp.func
def way(tail: wp.vec2d, head: wp.vec2d, walls: Walls) -> wp.vec2d:
    """Return the vector from a point `tail` to the nearest periodic image of a point `head` [m]."""
    return law.nearest_image(head - tail, walls.period)


@wp.func
def place_at(b: int, x: wp.vec2d, walls: Walls) -> wp.vec2d:
    """Return a point x, or an image of x, in the frame of wall b > 0 [m].

    It is that of `nearest_place`, plus a multiple of the periods if b is itself an image of another wall.
    """
    place = nearest_place(b, x, walls)
    if walls.image.shape[0] > 0:
        place = place + at(walls.image, b - 1)
    return place


@wp.func
def nearest_place(b: int, x: wp.vec2d, walls: Walls) -> wp.vec2d:
    """Return, in the frame of wall b > 0, the periodic image of x nearest to the wall's center [m]."""
    place = x
    if are_mobile(walls):
        place = to_frame(at(walls.pose, b - 1), x)
    if is_periodic(walls):
        shape = at(walls.shape, b - 1)
        if shape[CIRCLE_RADIUS] < f64(wp.inf):
            center = wp.vec2d(shape[CIRCLE_RADIUS - 2], shape[CIRCLE_RADIUS - 1])
            place = center + way(center, place, walls)
    return place


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
    """Return whether the circle around a wall is within reach [m] of x, which is a fast test."""
    ...


@wp.func_native(checked(IS_NEAR + NEXT))
def next_near(shapes: wp.array(dtype=Shape), begin: int, x: wp.vec2d, reach: f64) -> int:
    """Return the first index >= begin of a shape whose circle is within reach [m] of x, or their number."""
    ...


@wp.func
def have_joints(walls: Walls) -> bool:
    """Return whether an end of a wall lies on another wall."""
    return walls.joint.shape[0] > 0


@wp.func
def joint_reach(walls: Walls, radius: f64) -> f64:
    """Return by how much joints increase the distance at which a wall is listed [m]."""
    return wp.where(have_joints(walls), f64(2.0) * radius, f64(0.0))


@wp.func
def place_at_joint(k: int, x: wp.vec2d, place: wp.vec2d, walls: Walls) -> wp.vec2d:
    """Return a point x in the frame of wall joint[k], which is joined to another wall [m].

    `place` is x in the frame of that other wall. The result has the same bits as if computed for wall
    joint[k] alone, so that both walls agree which of them is nearer.
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
def contact_at_joint(
    b: int, at_grain: wp.vec2d, x: wp.vec2d, radius: f64, n: wp.vec2d, gap: f64, walls: Walls
):
    """Return normal n and gap [m] of a grain at wall b, changed if a joined wall is nearer (eq. 8c).

    The arguments `n` and `gap` are those of wall b alone. The grain is at `at_grain`, and at x in the frame
    of wall b.
    """
    shape = at(walls.shape, b - 1)
    end = end_of(x, shape)
    if end < 0:
        return n, gap
    nearest, least, first = int(-1), f64(gap), 2 * (b - 1) + end
    for k in range(at(walls.joint_start, first), at(walls.joint_start, first + 1)):
        joined = at(walls.joint, k)
        its = shape_gap(place_at_joint(k, at_grain, x, walls), radius, at(walls.shape, joined[0]))
        if its < least or (its == least and nearest < 0 and joined[1] != 0):
            nearest, least = k, its
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


@wp.func
def is_near_wall(b: int, x: wp.vec2d, radius: f64, walls: Walls, reach: f64) -> bool:
    """Return whether wall b, or an image of it, is within reach [m] of a grain at x.

    This is also true if the gap is NaN. With joints, see `is_image_near`.
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
    """Return (normal, gap, gap on the other side, A of eq. 18) [m] of a grain at x and wall b.

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
def wall_velocity(b: int, x: wp.vec2d, walls: Walls) -> wp.vec2d:
    """Return the displacement of point x of wall b in the step, divided by dt [m/s]."""
    if b > 0 and are_mobile(walls):
        return velocity_at(at(walls.pose, b - 1), x)
    return wp.vec2d()


@wp.func
def surface_velocity(b: int, x: wp.vec2d, reach: f64, n: wp.vec2d, walls: Walls) -> wp.vec2d:
    """Return the velocity of wall b along normal and tangent of a contact [m/s] (eq. 26b).

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
