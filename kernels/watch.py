"""Exact pruning: the proof that a pair or wall left out of the list would have done nothing.

When the list was built, grain i had about the velocity w_i. In a frame that moves with velocity u beside the
w_i, let s_i be how far grain i has strayed since from its straight path, and p_i the largest |v_i - w_i - u|
that it has had at any moment of the contact iteration. The list holds every pair with

    gap <= horizon |w_i - w_j| + reach_i + reach_j

as the gaps were then. A pair acts only if (v_i - v_j) . n > gap / dt. So as long as

    s_i + dt p_i <= reach_i  for every grain i,    and    elapsed + dt <= horizon,

an absent pair has gap >= dt (|w_i - w_j| + p_i + p_j) >= dt (v_i - v_j) . n at every moment and stays silent;
leaving it out gives the same bits (SPEC.md). The walls do not move with the frame: for them the path of the
frame itself is added.

p_i is seen after every single correction while WATCHING. An unwatched iteration changes no velocity by more
than INFLUENCE * zeta, where INFLUENCE is the largest sum of a grain's shares of its contacts; these changes
add up to DRIFT, with which all grains are looked at from time to time.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .crew import Crew, share
from .data import (
    BAD_GRAIN,
    DRIFT,
    ELAPSED,
    FRAME_REACH,
    FRAME_SHIFT,
    FRAME_VELOCITY,
    HORIZON,
    LOOK_DRIFT,
    MISSED,
    SLACK,
    WATCHING,
    Grains,
    Watch,
)
from .stage import kernels_of
from .variant import Variant

f64 = wp.float64


@wp.func
def strayed_velocity(velocity: wp.vec2d, watch: Watch, i: int) -> wp.vec2d:
    """v_i - w_i - u [m/s]."""
    return velocity - watch.built_velocity[i] - watch.frame[FRAME_VELOCITY]


@wp.func
def strayed(position: wp.vec2d, watch: Watch, i: int) -> f64:
    """s_i [m]."""
    straight = watch.built_position[i] + watch.scalar[ELAPSED] * watch.built_velocity[i]
    return wp.length(position - straight - watch.frame[FRAME_SHIFT])


@wp.func
def is_finite(x: wp.vec2d) -> bool:
    """Whether both components are numbers: infinity less infinity is none."""
    return x[0] - x[0] == f64(0.0) and x[1] - x[1] == f64(0.0)


@wp.func
def watch_grain(velocity: wp.vec2d, watch: Watch, i: int):
    """Keep the peak of grain i, and flag MISSED once its reach no longer allows it."""
    peak = wp.length_sq(strayed_velocity(velocity, watch, i))
    if peak > watch.peak[i]:
        watch.peak[i] = peak
        if peak > watch.limit[i]:
            watch.flag[MISSED] = 1


@wp.func
def look_at(velocity: wp.vec2d, watch: Watch, i: int):
    """Take what grain i may have reached unwatched, on the way to this velocity, into its peak."""
    peak = wp.length(strayed_velocity(velocity, watch, i)) + watch.scalar[LOOK_DRIFT]
    watch.peak[i] = wp.max(watch.peak[i], peak * peak)


@wp.func
def look_again(velocity: wp.array(dtype=wp.vec2d), watch: Watch, crew: Crew, tid: int):
    """Look at this worker's share of the grains."""
    begin, end = share(crew, tid, 0, velocity.shape[0])
    for i in range(begin, end):
        look_at(velocity[i], watch, i)


@cache
def stages(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the stages for one kind of scene."""

    @wp.func
    def clear(watch: Watch):
        """Forget what was seen; the first iteration is watched."""
        watch.frame[FRAME_VELOCITY] = wp.vec2d(f64(0.0), f64(0.0))
        watch.scalar[DRIFT] = f64(0.0)
        watch.flag[WATCHING] = 1
        watch.flag[MISSED] = 0
        watch.flag[BAD_GRAIN] = -1

    @wp.func
    def find_frame(i: int, grains: Grains, watch: Watch):
        """u, the mean of v_i - w_i: what all grains do together, such as falling, strays nobody."""
        n = grains.position.shape[0]
        wp.atomic_add(
            watch.frame, FRAME_VELOCITY, (grains.next_velocity[i] - watch.built_velocity[i]) / f64(n)
        )

    @wp.func
    def first_look(crew: Crew, tid: int, grains: Grains, watch: Watch, dt: f64):
        """The peaks before the first iteration, and what the reaches still allow."""
        n = grains.position.shape[0]
        begin, end = share(crew, tid, 0, n)
        for i in range(begin, end):
            watch.peak[i] = wp.length_sq(strayed_velocity(grains.next_velocity[i], watch, i))
            allowed = (watch.reach[i] - strayed(grains.position[i], watch, i)) / dt
            watch.limit[i] = wp.max(f64(0.0), allowed) * allowed

    @wp.func
    def verify(
        crew: Crew,
        tid: int,
        grains: Grains,
        watch: Watch,
        dt: f64,
        rounding: f64,
        reserve: f64,
        foreseen: f64,
    ):
        """Flag MISSED where a reach does not suffice, and BAD_GRAIN where a number is not finite.

        Before the iteration, a reserve of so many slacks is asked for, and peaks are foreseen, so many times
        those of the last step.
        """
        least = rounding + reserve * watch.scalar[SLACK]
        n = grains.position.shape[0]
        begin, end = share(crew, tid, 0, n)
        for i in range(begin, end):
            x = grains.position[i]
            peak = wp.max(wp.sqrt(watch.peak[i]) + watch.scalar[DRIFT], foreseen * watch.recent[i])
            used = strayed(x, watch, i) + dt * peak
            if not is_finite(x + dt * grains.next_velocity[i]):
                wp.atomic_max(watch.flag, BAD_GRAIN, i)
            elif not (used + least <= watch.reach[i]):
                watch.flag[MISSED] = 1
        path = wp.length(watch.frame[FRAME_SHIFT]) + dt * wp.length(watch.frame[FRAME_VELOCITY])
        if not (path + least <= watch.scalar[FRAME_REACH]):
            watch.flag[MISSED] = 1
        if not (watch.scalar[ELAPSED] + f64(0.5) * dt <= watch.scalar[HORIZON]):
            watch.flag[MISSED] = 1

    @wp.func
    def remember(crew: Crew, tid: int, watch: Watch):
        """Keep what the step needed, for the reaches of the next list."""
        begin, end = share(crew, tid, 0, watch.peak.shape[0])
        for i in range(begin, end):
            watch.recent[i] = wp.sqrt(watch.peak[i]) + watch.scalar[DRIFT]

    @wp.func
    def shift_frame(watch: Watch, dt: f64):
        """The frame moves with the grains."""
        watch.frame[FRAME_SHIFT] = watch.frame[FRAME_SHIFT] + dt * watch.frame[FRAME_VELOCITY]
        watch.scalar[ELAPSED] = watch.scalar[ELAPSED] + dt

    return SimpleNamespace(
        clear=clear,
        find_frame=find_frame,
        first_look=first_look,
        verify=verify,
        remember=remember,
        shift_frame=shift_frame,
    )


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Kernels of the stages that are launched."""
    own = stages(variant)
    return kernels_of(
        variant.module, own.clear, own.find_frame, own.first_look, own.verify, own.remember, own.shift_frame
    )
