"""Exact pruning: the proof that a pair or wall left out of the list would have done nothing.

An absent pair acts only if (v_i - v_j) . n > gap / dt at some moment of the iteration. The list holds every
pair with gap <= reach_i + reach_j when it was built. Measured in a frame that moves with velocity u, grain i
has since moved by s_i and its speed never exceeded p_i. As long as

    s_i + dt p_i <= reach_i        for every grain i,

every absent pair has gap >= dt (p_i + p_j) >= dt (v_i - v_j) . n, so it stays silent (SPEC.md: leaving it out
gives the same bits). For the walls, which do not move with the frame, the frame's own path is added.

p_i is the peak seen after every single correction while WATCHING, plus DRIFT otherwise: an unwatched
iteration changes no velocity by more than INFLUENCE * zeta, where INFLUENCE is the largest sum of a grain's
shares of its contacts.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .crew import Crew, share
from .data import (
    BAD_GRAIN,
    DRIFT,
    FRAME_REACH,
    FRAME_SHIFT,
    FRAME_VELOCITY,
    INFLUENCE,
    MISSED,
    WATCHING,
    Grains,
    Watch,
)
from .variant import Variant

f64 = wp.float64


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the kernels for one kind of scene."""

    @wp.kernel(module=variant.module)
    def clear(watch: Watch):
        """Forget what was seen; the first iteration is watched."""
        watch.frame[FRAME_VELOCITY] = wp.vec2d(f64(0.0), f64(0.0))
        watch.scalar[DRIFT] = f64(0.0)
        watch.flag[WATCHING] = 1
        watch.flag[MISSED] = 0
        watch.flag[BAD_GRAIN] = -1

    @wp.kernel(module=variant.module)
    def find_frame(crew: Crew, grains: Grains, watch: Watch):
        """The frame moves with the mean velocity: a falling cloud is at rest in its own frame."""
        n = grains.position.shape[0]
        total = wp.vec2d(f64(0.0), f64(0.0))
        begin, end = share(crew, wp.tid(), 0, n)
        for i in range(begin, end):
            total = total + grains.next_velocity[i]
        wp.atomic_add(watch.frame, FRAME_VELOCITY, total / f64(n))

    @wp.kernel(module=variant.module)
    def first_look(crew: Crew, grains: Grains, watch: Watch):
        """The peaks before the first iteration."""
        n = grains.position.shape[0]
        u = watch.frame[FRAME_VELOCITY]
        begin, end = share(crew, wp.tid(), 0, n)
        for i in range(begin, end):
            watch.peak[i] = wp.length_sq(grains.next_velocity[i] - u)

    @wp.func
    def used_reach(grains: Grains, watch: Watch, i: int, dt: f64) -> f64:
        """s_i + dt p_i [m]."""
        moved = grains.position[i] - watch.built_position[i] - watch.frame[FRAME_SHIFT]
        return wp.length(moved) + dt * (wp.sqrt(watch.peak[i]) + watch.scalar[DRIFT])

    @wp.func
    def used_frame_reach(watch: Watch, dt: f64) -> f64:
        """How far the frame itself has come, and comes in this step [m]."""
        return wp.length(watch.frame[FRAME_SHIFT]) + dt * wp.length(watch.frame[FRAME_VELOCITY])

    @wp.kernel(module=variant.module)
    def verify(crew: Crew, grains: Grains, watch: Watch, dt: f64, reserve: f64):
        """Flag MISSED where a reach, less a reserve [m], is not enough, and BAD_GRAIN where a number is not finite."""
        n = grains.position.shape[0]
        begin, end = share(crew, wp.tid(), 0, n)
        for i in range(begin, end):
            if not wp.isfinite(grains.position[i] + dt * grains.next_velocity[i]):
                wp.atomic_max(watch.flag, BAD_GRAIN, i)
            elif not (used_reach(grains, watch, i, dt) + reserve <= watch.reach[i]):
                watch.flag[MISSED] = 1
        if not (used_frame_reach(watch, dt) + reserve <= watch.scalar[FRAME_REACH]):
            watch.flag[MISSED] = 1

    @wp.kernel(module=variant.module)
    def renew_reach(grains: Grains, watch: Watch, slack: f64, dt: f64):
        """Reaches for a new list: what the step has needed so far and a fifth more, and the slack [m]."""
        i = wp.tid()
        peak = wp.sqrt(watch.peak[i]) + watch.scalar[DRIFT]
        watch.reach[i] = slack + f64(1.2) * dt * peak
        watch.built_position[i] = grains.position[i]
        if i == 0:
            watch.frame[FRAME_SHIFT] = wp.vec2d(f64(0.0), f64(0.0))
            watch.scalar[FRAME_REACH] = slack + f64(1.2) * dt * wp.length(watch.frame[FRAME_VELOCITY])
            watch.scalar[INFLUENCE] = f64(0.0)

    @wp.kernel(module=variant.module)
    def shift_frame(watch: Watch, dt: f64):
        """The frame moves with the grains."""
        watch.frame[FRAME_SHIFT] = watch.frame[FRAME_SHIFT] + dt * watch.frame[FRAME_VELOCITY]

    return SimpleNamespace(
        clear=clear,
        find_frame=find_frame,
        first_look=first_look,
        verify=verify,
        renew_reach=renew_reach,
        shift_frame=shift_frame,
    )
