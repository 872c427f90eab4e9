"""The walls of a scene as bodies that grains touch: which kinds there are, and where each body is.

Body 0 is the annulus (annulus.py), whose circles are the two sides of one wall; then come the walls inside
it, each with a `Shape`. A kind of wall is one file with three functions, which are called here: whether a
grain is near, the frame of their contact, and their overlap. Everything else treats contacts with walls and
with grains alike (contacts.py). For a step, a wall is its tangent. With a second kind, the functions choose
by shape[0].
"""

import warp as wp

from . import annulus, disc
from .access import at
from .annulus import Annulus
from .types import Shape

f64 = wp.float64


@wp.struct
class Walls:
    """The walls of a scene, by kind."""

    annulus: Annulus
    shape: wp.array(dtype=Shape)  # of the walls inside it
    surface: wp.array(dtype=wp.vec2d)  # friction, and speed along the tangent [m/s]; empty without friction


@wp.func
def wall_body_count(walls: Walls) -> int:
    """Return the number of bodies that are walls."""
    return 1 + walls.shape.shape[0]


@wp.func
def is_near_wall(b: int, x: wp.vec2d, radius: f64, walls: Walls, reach: f64) -> bool:
    """Return whether wall b is within reach [m] of a grain at x."""
    if b > 0:
        return disc.is_near(x, radius, at(walls.shape, b - 1), reach)
    return annulus.is_near(x, radius, walls.annulus, reach)


@wp.func
def wall_frame(b: int, x: wp.vec2d, radius: f64, walls: Walls):
    """Return normal, gap, gap on the other side, and reach [m] of the contact of a grain at x with wall b."""
    if b > 0:
        return disc.frame(x, radius, at(walls.shape, b - 1))
    return annulus.frame(x, radius, walls.annulus)


@wp.func
def wall_overlap(b: int, x: wp.vec2d, radius: f64, walls: Walls) -> f64:
    """Return how far a grain at x overlaps wall b [m]; negative where it does not."""
    if b > 0:
        return disc.overlap(x, radius, at(walls.shape, b - 1))
    return annulus.overlap(x, radius, walls.annulus)


@wp.func
def worst_overlap(x: wp.vec2d, radius: f64, walls: Walls) -> f64:
    """Return the largest overlap of a grain at x with any wall [m]."""
    worst = annulus.overlap(x, radius, walls.annulus)
    for b in range(1, wall_body_count(walls)):
        worst = wp.max(worst, wall_overlap(b, x, radius, walls))
    return worst
