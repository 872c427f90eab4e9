"""Walls on which a force acts, and that move as contacts let them (MODEL.md, eqs. 27 to 30).

Such a wall is one more body with a velocity, of one component. Its speed comes after the velocities of the
grains, in all arrays of velocities, and so do its mass and its numbers in the list's check (verlet.py). So
every stage that treats velocities treats it as well. A scene with a driven wall has an entry for each of its
walls; those that no force drives have the speed 0, which nothing changes.

The coordinate of the outer circle is its radius, and that of another wall its way along a direction. A row
on a driven line has the line's speed and coordinate, and its own entries stay 0. All contacts of a driven
wall share its speed. So one thread sweeps all contacts with walls, in the order of the loop over grains.
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
    """Return the body that has the speed and the coordinate of wall j."""
    return grain_count(s) + int(at(s.walls.drive, j - grain_count(s))[DriveOf.LEADER])


@wp.func
def levers(s: Scene, j: int, n: wp.vec2d) -> wp.vec2d:
    """Return how fast wall j moves along a normal n into it, and its tangent, at unit speed (eq. 28)."""
    if j == grain_count(s):
        return wp.vec2d(f64(1.0), f64(0.0))
    drive = at(s.walls.drive, j - grain_count(s))
    d = wp.vec2d(drive[DriveOf.DIRECTION_X], drive[DriveOf.DIRECTION_Y])
    return wp.vec2d(wp.dot(n, d), law.speed_along(d, n))


@wp.func
def shares_of_wall(s: Scene, i: int, j: int, lever: wp.vec2d) -> wp.vec2d:
    """Return how corrections of 1 m/s of grain i, normal and tangential, change wall j's speed (eq. 28)."""
    inverse_mass = at(s.walls.drive, j - grain_count(s))[DriveOf.INVERSE_MASS]
    return lever * at(s.grains.contact_mass, i) * inverse_mass


@wp.func
def closing_speed(s: Scene, velocity: Vectors, i: int, j: int, n: wp.vec2d) -> f64:
    """Return vn of grain i and wall j [m/s] (eq. 28)."""
    return wp.dot(at(velocity, i), n) - levers(s, j, n)[0] * at(velocity, leader_of(s, j))[0]


@wp.func
def change_speed(s: Scene, velocity: Vectors, i: int, j: int, n: wp.vec2d, dv: f64, dvt: f64):
    """Add the corrections [m/s] of a contact of grain i to the speed of wall j (eq. 29)."""
    leader, share = leader_of(s, j), shares_of_wall(s, i, j, levers(s, j, n))
    speed = at(velocity, leader)[0] + dv * share[0] + dvt * share[1]
    put(velocity, leader, wp.vec2d(speed, f64(0.0)))


@wp.func
def height_of_line(s: Scene, b: int) -> f64:
    """Return how far from the origin the grains' side of line b begins, along its normal [m]."""
    line, pose = at(s.walls.shape, b - 1), at(s.walls.pose, b - 1)
    x, y = line[1] + pose[PoseOf.SHIFT_X], line[2] + pose[PoseOf.SHIFT_Y]
    return x * line[3] + y * line[4]


@wp.func
def pressed_length(s: Scene, j: int) -> f64:
    """Return the length on which a pressure drives wall j outwards [m]; < 0 for the outer circle."""
    if j == grain_count(s):
        return -(TURN * s.walls.annulus.radius_out)
    drive = at(s.walls.drive, j - grain_count(s))
    first, last = int(drive[DriveOf.FROM_LINE]), int(drive[DriveOf.TO_LINE])
    if first == 0:
        return drive[DriveOf.LENGTH]
    return -(height_of_line(s, first) + height_of_line(s, last))


@wp.func
def acceleration_of_wall(s: Scene, j: int) -> wp.vec2d:
    """Return how force and pressure accelerate the coordinate of wall j [m/s2] (eq. 27)."""
    drive = at(s.walls.drive, j - grain_count(s))
    force = drive[DriveOf.FORCE]
    if drive[DriveOf.PRESSURE] != f64(0.0):
        force = drive[DriveOf.PRESSURE] * pressed_length(s, j)
    return wp.vec2d(force * drive[DriveOf.INVERSE_MASS], f64(0.0))


@wp.func
def place_driven_walls(s: Scene):
    """Move driven walls from where they are placed as given to where the force has taken them.

    The surface of a circle that turns has the speed of its present radius (eq. 23).
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
