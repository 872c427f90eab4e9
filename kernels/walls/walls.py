"""The walls of a scene as bodies that grains touch, and their positions.

Body 0 is the annulus (annulus.py), whose circles are the two sides of one wall. The other walls follow, each
with a `Shape` (shapes.py). Other files treat contacts with walls and with grains alike (contacts.py). For a
step, a wall is replaced by its tangent at the positions at the start of the step. A wall with a prescribed
motion (motion.py) or a driven wall (driven.py) has a velocity in the step, which is part of the gap rate or
of vn of its contacts.
"""

import warp as wp

from .. import law
from ..access import at, put
from ..types import MOST_NUMBERS, Drive, Floats, Ints, Motion, MotionOf, Pose, Shape, Vectors
from .annulus import Annulus
from .motion import moving_time, pose_at, to_frame, velocity_at

f64 = wp.float64
CIRCLE_RADIUS = wp.constant(1 + MOST_NUMBERS + 2)  # index of this number of a shape


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
    """Return a point x, or a periodic image of x, in the frame of wall b > 0 [m].

    It is that of `nearest_place`, plus a multiple of the periods if wall b is itself an image of another
    wall.
    """
    place = nearest_place(b, x, walls)
    if walls.image.shape[0] > 0:
        place = place + at(walls.image, b - 1)
    return place


@wp.func
def nearest_place(b: int, x: wp.vec2d, walls: Walls) -> wp.vec2d:
    """Return, in the frame of wall b > 0, the periodic image of x nearest to the wall's center [m].

    At a line or row, which has no center, this is x itself in that frame.
    """
    place = x
    if are_mobile(walls):
        place = to_frame(at(walls.pose, b - 1), x)
    if is_periodic(walls):
        shape = at(walls.shape, b - 1)
        if shape[CIRCLE_RADIUS] < f64(wp.inf):
            center = wp.vec2d(shape[CIRCLE_RADIUS - 2], shape[CIRCLE_RADIUS - 1])
            place = center + way(center, place, walls)
    return place


@wp.func
def wall_velocity(b: int, x: wp.vec2d, walls: Walls) -> wp.vec2d:
    """Return the mean velocity in the step [m/s] of the point of wall b that is at x when the step begins."""
    if b > 0 and are_mobile(walls):
        return velocity_at(at(walls.pose, b - 1), x)
    return wp.vec2d()
