"""Newton's law without contacts, and the move (MODEL.md, "One step")."""

import warp as wp

from . import law
from .record import Scene

f64 = wp.float64


@wp.func
def begin_step(s: Scene):
    """Count lists and attempts anew."""
    s.step.rebuilds = 0
    s.step.redos = 0


@wp.func
def free_velocity(s: Scene, i: int):
    """v* (eq. 2)."""
    v = s.grains.velocity[i]
    s.grains.free_velocity[i] = law.free_velocity(v, s.gravity, s.drag, s.grains.mass[i], s.dt)


@wp.func
def move(s: Scene, i: int):
    """X += dt v, with the velocities that the contacts have corrected (eq. 3)."""
    x = s.grains.position[i]
    v = s.grains.next_velocity[i]
    s.grains.last_position[i] = x
    s.grains.last_velocity[i] = s.grains.velocity[i]
    s.grains.position[i] = x + s.dt * v
    s.grains.velocity[i] = v
