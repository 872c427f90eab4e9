"""Newton's law without contacts, and the move: stages 1 and 3 of a step (SPEC.md)."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from . import law
from .crew import Crew, share
from .data import Grains
from .features import functions
from .variant import Variant

f64 = wp.float64


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the kernels for one kind of scene."""
    mass_of = functions(variant).mass_of

    @wp.kernel(module=variant.module)
    def free_velocity(crew: Crew, grains: Grains, gravity: wp.vec2d, drag: f64, dt: f64):
        """v* = v + dt (g - drag / m v), explicit Euler."""
        n = grains.position.shape[0]
        begin, end = share(crew, wp.tid(), 0, n)
        for i in range(begin, end):
            v = grains.velocity[i]
            acceleration = wp.vec2d(f64(0.0), f64(0.0))
            if wp.static(variant.gravity):
                acceleration = gravity
            if wp.static(variant.drag):
                acceleration = acceleration - law.drag_deceleration(v, drag, mass_of(grains, i))
            if wp.static(variant.gravity or variant.drag):
                v = v + dt * acceleration
            grains.free_velocity[i] = v

    @wp.kernel(module=variant.module)
    def reset(crew: Crew, grains: Grains):
        """Start an attempt at the step: the velocities to correct are the free ones."""
        n = grains.position.shape[0]
        begin, end = share(crew, wp.tid(), 0, n)
        for i in range(begin, end):
            grains.next_velocity[i] = grains.free_velocity[i]

    @wp.kernel(module=variant.module)
    def move(crew: Crew, grains: Grains, dt: f64):
        """Positions: x += dt v, with the velocities that the contacts have corrected."""
        n = grains.position.shape[0]
        begin, end = share(crew, wp.tid(), 0, n)
        for i in range(begin, end):
            x = grains.position[i]
            v = grains.next_velocity[i]
            grains.last_position[i] = x
            grains.position[i] = x + dt * v
            grains.velocity[i] = v

    return SimpleNamespace(free_velocity=free_velocity, reset=reset, move=move)
