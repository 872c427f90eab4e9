"""Walls that a force drives, and whose motion also depends on contacts (MODEL.md, eqs. 27 to 30).

A driven wall is a body whose velocity has one component. In all arrays of velocities, and in the arrays of
masses and of the list's check (verlet.py), the walls follow the grains. So every stage that treats the
velocities of grains also treats those of walls. A scene with a driven wall has an entry for each of its
walls. Walls that no force drives keep the speed 0.

The coordinate of the outer circle is its radius. The coordinate of another wall is its displacement along a
direction. A row on a driven line moves with the speed and the coordinate of the line, and its own entries
stay 0. All contacts of a driven wall change one speed. So one thread sweeps all contacts with walls, in the
order of the loop over grains.
"""

import warp as wp

from .. import law
from ..access import at, put
from ..record import Scene, grain_count, is_driven
from ..types import DriveOf, PoseOf, Vectors
from .motion import TURN

f64 = wp.float64


@wp.func
def leader_of(s: Scene, j: int) -> int:
    """Return the body whose speed and coordinate wall j has: for a row its line, otherwise wall j itself."""
    return grain_count(s) + int(at(s.walls.drive, j - grain_count(s))[DriveOf.LEADER])


@wp.func
def levers(s: Scene, j: int, n: wp.vec2d) -> wp.vec2d:
    """Return (g, g_t): the velocity of wall j along normal n and tangent if its speed is 1 (eqs. 28, 30b)."""
    if j == grain_count(s):
        return wp.vec2d(f64(1.0), f64(0.0))
    drive = at(s.walls.drive, j - grain_count(s))
    d = wp.vec2d(drive[DriveOf.DIRECTION_X], drive[DriveOf.DIRECTION_Y])
    return wp.vec2d(wp.dot(n, d), law.speed_along(d, n))


@wp.func
def shares_of_wall(s: Scene, i: int, j: int, lever: wp.vec2d) -> wp.vec2d:
    """Return (h, h_t), the changes of wall j's speed by a normal and a tangential correction of 1 m/s.

    They are those of eqs. 28 and 30b. The corrections are those of a contact of grain i; `lever` is (g, g_t),
    the result of `levers`.
    """
    inverse_mass = at(s.walls.drive, j - grain_count(s))[DriveOf.INVERSE_MASS]
    return lever * at(s.grains.contact_mass, i) * inverse_mass


@wp.func
def closing_speed(s: Scene, velocity: Vectors, i: int, j: int, n: wp.vec2d) -> f64:
    """Return the closing speed vn of grain i and wall j [m/s] (eq. 28)."""
    return wp.dot(at(velocity, i), n) - levers(s, j, n)[0] * at(velocity, leader_of(s, j))[0]


@wp.func
def change_speed(s: Scene, velocity: Vectors, i: int, j: int, n: wp.vec2d, dv: f64, dvt: f64):
    """Change the speed of wall j by the corrections dv, dvt [m/s] of a contact of grain i (eqs. 29, 30b).

    `velocity` is an array by body, changed in place; n is the normal of the contact.
    """
    leader, share = leader_of(s, j), shares_of_wall(s, i, j, levers(s, j, n))
    speed = at(velocity, leader)[0] + dv * share[0] + dvt * share[1]
    put(velocity, leader, wp.vec2d(speed, f64(0.0)))


@wp.func
def height_of_line(s: Scene, b: int) -> f64:
    """Return p . m [m] for a point p of line b and its unit normal m, which points to the grains (eq. 27)."""
    line, pose = at(s.walls.shape, b - 1), at(s.walls.pose, b - 1)
    x, y = line[1] + pose[PoseOf.SHIFT_X], line[2] + pose[PoseOf.SHIFT_Y]
    return x * line[3] + y * line[4]


@wp.func
def pressed_length(s: Scene, j: int) -> f64:
    """Return the length L on which a pressure acts on wall j [m] (eq. 27).

    It is < 0 for the outer circle, because a pressure shrinks the radius.
    """
    if j == grain_count(s):
        return -(TURN * s.walls.annulus.radius_out)
    drive = at(s.walls.drive, j - grain_count(s))
    first, last = int(drive[DriveOf.FROM_LINE]), int(drive[DriveOf.TO_LINE])
    if first == 0:
        return drive[DriveOf.LENGTH]
    return -(height_of_line(s, first) + height_of_line(s, last))


@wp.func
def acceleration_of_wall(s: Scene, j: int) -> wp.vec2d:
    """Return (acceleration of the coordinate of wall j by force or pressure [m/s2], 0) (eq. 27)."""
    drive = at(s.walls.drive, j - grain_count(s))
    force = drive[DriveOf.FORCE]
    if drive[DriveOf.PRESSURE] != f64(0.0):
        force = drive[DriveOf.PRESSURE] * pressed_length(s, j)
    return wp.vec2d(force * drive[DriveOf.INVERSE_MASS], f64(0.0))


@wp.func
def place_driven_walls(s: Scene):
    """Add the displacements of driven walls to their poses, and set the radius of the outer circle.

    If the outer circle turns, its surface speed is that of the present radius (eq. 23).
    """
    if not is_driven(s):
        return
    radius = at(s.grains.position, grain_count(s))[0]
    s.walls.annulus.radius_out = radius
    if s.walls.surface.shape[0] > 0:
        speed = radius * s.walls.annulus.angular_velocity_out
        put(s.walls.surface, 0, wp.vec2d(at(s.walls.surface, 0)[0], speed))
    for b in range(1, s.walls.drive.shape[0]):
        drive = at(s.walls.drive, b)
        if drive[DriveOf.INVERSE_MASS] > f64(0.0):
            path = at(s.grains.position, leader_of(s, grain_count(s) + b))[0]
            pose = at(s.walls.pose, b - 1)
            pose[PoseOf.SHIFT_X] = pose[PoseOf.SHIFT_X] + path * drive[DriveOf.DIRECTION_X]
            pose[PoseOf.SHIFT_Y] = pose[PoseOf.SHIFT_Y] + path * drive[DriveOf.DIRECTION_Y]
            put(s.walls.pose, b - 1, pose)
