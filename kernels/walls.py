"""The walls of an annulus as contacts: formulas of their law. Walls of another shape are written here.

A grain has one accumulated correction dv_b for both walls: > 0 is carried by the outer one, < 0 by the inner
one (MODEL.md, eq. 8). A wall's normal starts at the origin. For a step, a wall is its tangent; a round outer
wall lets a grain's gap know how far the grain slides along it (eq. 18).
"""

import warp as wp

from . import law

f64 = wp.float64


@wp.struct
class Walls:
    """Where the walls are."""

    radius_in: f64  # [m]; 0: there is no inner wall
    radius_out: f64  # [m]
    round: wp.int32  # whether the outer wall is a circle within a step as well, or its tangent


@wp.struct
class WallContact:
    """A grain that may reach a wall: its unit normal and accumulated correction dv_b [m/s]."""

    n: wp.vec2d
    gap_rate_out: f64
    gap_rate_in: f64
    reach: f64  # A_i / dt of eq. 18 [m/s]: no speed along a round wall may be higher
    dv: f64
    i: wp.int32


@wp.func
def has_inner(walls: Walls) -> bool:
    """Whether there is an inner wall."""
    return walls.radius_in > f64(0.0)


@wp.func
def outer_gap(distance: f64, radius: f64, walls: Walls) -> f64:
    """Free distance between a grain and the outer wall [m]."""
    return walls.radius_out - distance - radius


@wp.func
def inner_gap(distance: f64, radius: f64, walls: Walls) -> f64:
    """Free distance between a grain and the inner wall [m]."""
    return distance - walls.radius_in - radius


@wp.func
def frozen_wall(contact: WallContact, position: wp.vec2d, radius: f64, walls: Walls, dt: f64) -> WallContact:
    """The contact with the normal and the gaps that a grain at this position [m] has for a step."""
    n, distance = law.normal(wp.vec2d(f64(0.0), f64(0.0)), position)
    frozen = contact
    frozen.n = n
    frozen.reach = (walls.radius_out - radius) / dt
    frozen.gap_rate_out = outer_gap(distance, radius, walls) / dt
    if has_inner(walls):
        frozen.gap_rate_in = inner_gap(distance, radius, walls) / dt
    return frozen


@wp.func
def speed_along(v: wp.vec2d, n: wp.vec2d) -> f64:
    """Velocity along a wall [m/s]."""
    return n[0] * v[1] - n[1] * v[0]


@wp.func
def outer_gap_rate(contact: WallContact, v: wp.vec2d, walls: Walls) -> f64:
    """gap_out / dt of a grain of this velocity [m/s]: a round wall leaves less than its tangent (eq. 18)."""
    if walls.round == 0:
        return contact.gap_rate_out
    reach = contact.reach
    along = speed_along(v, contact.n)
    root = wp.sqrt(wp.max(f64(0.0), reach * reach - along * along))
    return contact.gap_rate_out - (reach - root)


@wp.func
def wall_projection(vn: f64, dv: f64, gap_rate_out: f64, gap_rate_in: f64, inner: bool) -> f64:
    """What dv_b has to become for the grain to keep clear of the walls [m/s] (eq. 8)."""
    projected = wp.max(f64(0.0), vn + dv - gap_rate_out)
    if inner:
        projected = projected - wp.max(f64(0.0), -vn - dv - gap_rate_in)
    return projected


@wp.func
def wall_residual(vn: f64, contact: WallContact, inner: bool) -> f64:
    """The natural residual of a grain's walls, each apart [m/s] (eq. 12)."""
    worst = law.natural_residual(vn, wp.max(contact.dv, f64(0.0)), contact.gap_rate_out)
    if inner:
        dv_in = wp.max(-contact.dv, f64(0.0))
        worst = wp.max(worst, law.natural_residual(-vn, dv_in, contact.gap_rate_in))
    return worst


@wp.func
def wall_cost(dv: f64, gap_rate_out: f64, gap_rate_in: f64) -> f64:
    """The linear part of phi (eq. 14) of a grain's walls, by unit mass [m2/s2]."""
    return wp.where(dv >= f64(0.0), dv * gap_rate_out, -dv * gap_rate_in)


@wp.func
def wall_overlap(position: wp.vec2d, radius: f64, walls: Walls) -> f64:
    """How far a grain overlaps a wall [m]; negative where it does not."""
    distance = wp.length(position)
    worst = -outer_gap(distance, radius, walls)
    if has_inner(walls):
        worst = wp.max(worst, -inner_gap(distance, radius, walls))
    return worst


@wp.func
def is_near_wall(position: wp.vec2d, radius: f64, walls: Walls, reach: f64) -> bool:
    """Whether a wall is within reach [m] of a grain."""
    distance = wp.length(position)
    near = outer_gap(distance, radius, walls) <= reach
    if has_inner(walls):
        near = near or inner_gap(distance, radius, walls) <= reach
    return near
