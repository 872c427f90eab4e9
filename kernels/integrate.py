"""Newton's law without contacts, and the move (MODEL.md, "One step")."""

import warp as wp

from . import law
from .access import at, put
from .record import Scene, grain_count, rotates, time_after
from .walls.driven import acceleration_of_wall, place_driven_walls
from .walls.walls import place_walls

f64 = wp.float64


@wp.func
def begin_step(s: Scene):
    """Set gravity and place the mobile walls for the start of the step."""
    if s.gravity_rate != f64(0.0):
        s.gravity = law.turned_gravity(s.gravity_start, s.gravity_rate, time_after(s, s.steps))
    place_mobile_walls(s)


@wp.func
def place_mobile_walls(s: Scene):
    """Set the poses of mobile walls at the present time, and their velocities in the step from then on."""
    place_walls(s.walls, time_after(s, s.steps), time_after(s, s.steps + wp.int64(1)), s.dt)
    place_driven_walls(s)


@wp.func
def velocity_after_kick(s: Scene, v: wp.vec2d, acceleration: wp.vec2d, drag: f64, m: f64) -> wp.vec2d:
    """Return the velocity v of a body of mass m after acceleration [m/s2] and drag [kg/s] (eqs. 2, 16, 17).

    The scheme of the scene chooses the equation. Drag of a spin has the unit kg m2/s, and m is the inertia.
    """
    if s.leapfrog != 0:
        return law.leapfrog_velocity(v, acceleration, drag, m, s.dt, s.staggered != 0)
    return law.free_velocity(v, acceleration, drag, m, s.dt)


@wp.func
def free_velocity(s: Scene, i: int):
    """Compute v* of body i: a grain, with friction also its rim speed, or a driven wall (eq. 27)."""
    v = at(s.grains.velocity, i)
    if i < grain_count(s):
        v = velocity_after_kick(s, v, s.gravity, s.drag, at(s.grains.mass, i))
    else:
        v = velocity_after_kick(s, v, acceleration_of_wall(s, i), f64(0.0), f64(1.0))
    put(s.grains.free_velocity, i, v)
    if rotates(s, i):  # the spin obeys the law of velocities, with inertia (eq. 21)
        radius, spin = at(s.grains.radius, i), wp.vec2d(at(s.grains.spin, i), f64(0.0))
        inertia = f64(0.5) * at(s.grains.mass, i) * radius * radius
        spin = velocity_after_kick(s, spin, wp.vec2d(), s.spin_drag, inertia)
        put(s.grains.free_rim, i, radius * spin[0])


@wp.func
def move(s: Scene, i: int):
    """Move grain or driven wall i by dt times its corrected velocity (eqs. 3 and 24)."""
    x = at(s.grains.position, i)
    v = at(s.grains.next_velocity, i)
    put(s.grains.last_position, i, x)
    put(s.grains.last_velocity, i, at(s.grains.velocity, i))
    put(s.grains.position, i, x + s.dt * v)
    put(s.grains.velocity, i, v)
    if rotates(s, i):
        spin = at(s.grains.next_rim, i) / at(s.grains.radius, i)
        put(s.grains.last_spin, i, at(s.grains.spin, i))
        put(s.grains.spin, i, spin)
        put(s.grains.angle, i, at(s.grains.angle, i) + s.dt * spin)


@wp.func
def end_step(s: Scene):
    """Count the step, place mobile walls for the next one, and set `staggered` if the scheme is leapfrog."""
    s.steps = s.steps + wp.int64(1)
    place_mobile_walls(s)
    s.last_staggered = s.staggered
    if s.leapfrog != 0:
        s.staggered = 1
