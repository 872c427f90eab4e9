"""The walls of a scene as bodies that grains touch: which kinds there are, and where each body is.

Body 0 is the annulus (annulus.py), whose circles are the two sides of one wall; then come the walls inside
it, each with a `Shape`. A kind of wall is one file. Of a wall without thickness it has the nearest point, of
another one the gap of a grain and the normal into the wall. Functions here choose by shape[0]. Everything
else treats contacts with walls and with grains alike (contacts.py). For a step, a wall is its tangent. A wall
that moves as given in advance is where it is at the end of the step (motion.py), and a driven one where it is
at its start (driven.py).
"""

import warp as wp

from . import annulus, arc, disc, law, segment
from .access import at, checked, put
from .annulus import Annulus
from .motion import from_frame, moving_time, pose_at, speed_of_surface, to_frame
from .types import MOST_NUMBERS, Drive, Motion, MotionOf, Pose, Shape

f64 = wp.float64


@wp.struct
class Walls:
    """The walls of a scene, by kind."""

    annulus: Annulus
    shape: wp.array(dtype=Shape)  # of the walls inside it
    motion: wp.array(dtype=Motion)  # of these, and
    pose: wp.array(dtype=Pose)  # where they are; both empty if none is mobile
    drive: wp.array(dtype=Drive)  # of all walls; empty if none is driven
    surface: wp.array(dtype=wp.vec2d)  # friction, and speed along the tangent [m/s]; empty without friction


@wp.func
def wall_body_count(walls: Walls) -> int:
    """Return the number of bodies that are walls."""
    return 1 + walls.shape.shape[0]


@wp.func
def nearest_on(x: wp.vec2d, shape: Shape) -> wp.vec2d:
    """Return the point nearest to x of a wall without thickness, which grains touch there [m].

    Without a branch for its kind it is x itself, so that the normal is NaN, and so are velocities next to it.
    """
    if shape[0] == segment.KIND:
        return segment.nearest(x, shape)
    if shape[0] == arc.KIND:
        return arc.nearest(x, shape)
    return x


@wp.func
def shape_gap(x: wp.vec2d, radius: f64, shape: Shape) -> f64:
    """Return the free distance between a grain at x and a wall inside the annulus [m]."""
    if shape[0] == disc.KIND:
        return disc.gap(x, radius, shape)
    return law.distance(x, nearest_on(x, shape)) - radius


@wp.func
def shape_normal(x: wp.vec2d, shape: Shape) -> wp.vec2d:
    """Return the unit normal from a grain at x into a wall inside the annulus."""
    if shape[0] == disc.KIND:
        return disc.normal(x, shape)
    n, _ = law.normal(x, nearest_on(x, shape))
    return n


@wp.func
def are_mobile(walls: Walls) -> bool:
    """Return whether a wall inside the annulus is mobile: it moves as given in advance, or is driven."""
    return walls.pose.shape[0] > 0


@wp.func
def place_walls(walls: Walls, begin: f64, end: f64):
    """Place mobile walls where they are at the end of a step, from time begin to time end [s]."""
    for k in range(walls.motion.shape[0]):
        put(walls.pose, k, pose_at(at(walls.motion, k), begin, end))


@wp.func
def wall_path(b: int, walls: Walls, begin: f64, end: f64) -> f64:
    """Return how far a point of wall b moves from time begin to time end [s] at most [m]."""
    if are_mobile(walls) and b > 0:
        motion = at(walls.motion, b - 1)
        return (moving_time(motion, end) - moving_time(motion, begin)) * motion[MotionOf.SPEED]
    return f64(0.0)


@wp.func
def place_at(b: int, x: wp.vec2d, walls: Walls) -> wp.vec2d:
    """Return the place of a point x in the frame of wall b > 0 [m]."""
    if are_mobile(walls):
        return to_frame(at(walls.pose, b - 1), x)
    return x


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
    """Return whether the circle about a wall at rest is within reach [m] of x: a test that costs little."""
    ...


@wp.func_native(checked(IS_NEAR + NEXT))
def next_near(shapes: wp.array(dtype=Shape), begin: int, x: wp.vec2d, reach: f64) -> int:
    """Return the first index from `begin` on of a wall at rest whose circle is within reach [m] of x."""
    ...


@wp.func
def is_near_wall(b: int, x: wp.vec2d, radius: f64, walls: Walls, reach: f64) -> bool:
    """Return whether wall b is within reach [m] of a grain at x, or has no gap there, which is NaN."""
    if b > 0:
        place, shape = place_at(b, x, walls), at(walls.shape, b - 1)
        if is_near_circle(shape, place, radius + reach):  # `and` would compute both
            return not (shape_gap(place, radius, shape) > reach)
        return False
    return annulus.is_near(x, radius, walls.annulus, reach)


@wp.func
def wall_frame(b: int, x: wp.vec2d, radius: f64, walls: Walls):
    """Return normal, gap, gap on the other side, and reach [m] of the contact of a grain at x with wall b.

    A wall inside the annulus has no other side, and is its tangent: both are inf.
    """
    if b > 0:
        place, shape = place_at(b, x, walls), at(walls.shape, b - 1)
        n = shape_normal(place, shape)
        if are_mobile(walls):
            n = from_frame(at(walls.pose, b - 1), n)
        return n, shape_gap(place, radius, shape), f64(wp.inf), f64(wp.inf)
    return annulus.frame(x, radius, walls.annulus)


@wp.func
def surface_speed(b: int, x: wp.vec2d, n: wp.vec2d, walls: Walls) -> f64:
    """Return the speed of wall b at a point x of it along the tangent of a normal n [m/s] (eq. 23)."""
    surface = at(walls.surface, b)
    if b > 0:
        return surface[1] + speed_of_surface(at(walls.pose, b - 1), x, n)
    return surface[1]


@wp.func
def wall_overlap(b: int, x: wp.vec2d, radius: f64, walls: Walls) -> f64:
    """Return how far a grain at x overlaps wall b [m]; negative where it does not."""
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
