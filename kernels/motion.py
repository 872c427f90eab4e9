"""Newton's law without contacts, and the move: stages 1 and 3 of a step (SPEC.md)."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from . import law
from .crew import Crew, share
from .data import Grains
from .features import functions
from .stage import kernels_of
from .variant import Variant

f64 = wp.float64


@cache
def stages(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the stages for one kind of scene."""
    mass_of = functions(variant).mass_of

    @wp.func
    def free_velocity(crew: Crew, tid: int, grains: Grains, gravity: wp.vec2d, drag: f64, dt: f64):
        """v* = v + dt (g - drag / m v), explicit Euler."""
        n = grains.position.shape[0]
        begin, end = share(crew, tid, 0, n)
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

    @wp.func
    def reset(crew: Crew, tid: int, grains: Grains):
        """Start an attempt at the step: the velocities to correct are the free ones."""
        n = grains.position.shape[0]
        begin, end = share(crew, tid, 0, n)
        for i in range(begin, end):
            grains.next_velocity[i] = grains.free_velocity[i]

    @wp.func
    def move(crew: Crew, tid: int, grains: Grains, dt: f64):
        """Positions: x += dt v, with the velocities that the contacts have corrected."""
        n = grains.position.shape[0]
        begin, end = share(crew, tid, 0, n)
        for i in range(begin, end):
            x = grains.position[i]
            v = grains.next_velocity[i]
            grains.last_position[i] = x
            grains.position[i] = x + dt * v
            grains.velocity[i] = v

    return SimpleNamespace(free_velocity=free_velocity, reset=reset, move=move)


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Kernels of the stages that are launched."""
    own = stages(variant)
    return kernels_of(variant.module, own.free_velocity, own.reset, own.move)
