"""When the contact iteration starts and stops, and whether the step is accepted: decided on the device."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .data import (
    ACCEPTED,
    BAD_GRAIN,
    CARRYING,
    DRIFT,
    ITERATIONS,
    LOOK,
    LOOK_DRIFT,
    MISSED,
    OVERLAP,
    RESIDUAL,
    SLACK,
    WATCHING,
    ZETA,
    Progress,
    Watch,
)
from .stage import kernels_of
from .variant import Variant

f64 = wp.float64
CHECK_EVERY = wp.constant(10)  # iterations between two checks of the residual
REBUILD_EVERY = wp.constant(100)  # iterations with momentum between two times that velocities are rebuilt
NEARLY = wp.constant(f64(2.0))  # times the tolerance: a zeta from which the residual is worth a check


@wp.struct
class Stop:
    """When to stop iterating, and when a sweep is calm enough not to be watched."""

    on_residual: wp.int32  # whether the tolerance is on the residual, or on zeta
    tolerance: f64  # [m/s]
    max_iterations: wp.int32
    calm: f64  # change of a grain's velocity that need not be watched, in slacks [1/s]


@wp.func
def is_power_of_two(number: int) -> bool:
    """Whether it is 1, 2, 4, 8, ..."""
    return number & (number - 1) == 0


@wp.func
def gather_zeta(progress: Progress) -> f64:
    """The largest |dv| of the iteration, over all workers."""
    zeta = f64(0.0)
    for slot in range(progress.zeta.shape[0]):
        zeta = wp.max(zeta, progress.zeta[slot])
        progress.zeta[slot] = f64(0.0)
    progress.report[ZETA] = zeta
    return zeta


@wp.func
def decide_after_iteration(watch: Watch, progress: Progress, stop: Stop, zeta: f64, undone: int):
    """Stop after the first iteration with zeta <= tolerance, or at max_iterations; or ask for the residual.

    An attempt in which a contact may have been missing is given up, but not at once, so that it shows how far
    all grains must reach.
    """
    iterations = int(progress.report[ITERATIONS]) + 1
    progress.report[ITERATIONS] = f64(iterations)
    progress.iterating[0] = 1 if iterations < stop.max_iterations else 0
    progress.checking[0] = 0
    if stop.on_residual != 0:
        sparse = iterations == 1 or iterations % CHECK_EVERY == 0
        if undone == 0 and sparse and zeta <= NEARLY * stop.tolerance:
            progress.checking[0] = 1
    elif undone == 0 and zeta <= stop.tolerance:
        progress.iterating[0] = 0
    if watch.flag[MISSED] != 0 and is_power_of_two(iterations):
        progress.iterating[0] = 0


@wp.func
def decide_after_check(progress: Progress, stop: Stop):
    """Stop on residual <= tolerance."""
    residual = f64(0.0)
    for slot in range(progress.residual.shape[0]):
        residual = wp.max(residual, progress.residual[slot])
        progress.residual[slot] = f64(0.0)
    if stop.on_residual != 0 and residual <= stop.tolerance:
        progress.iterating[0] = 0


@wp.func
def decide_to_rebuild(progress: Progress, undone: int):
    """Ask for velocities rebuilt from the corrections, with which the residual comes."""
    if undone == 0 and int(progress.report[ITERATIONS]) % REBUILD_EVERY == 0:
        progress.checking[0] = 1


@wp.func
def decide_what_to_watch(watch: Watch, stop: Stop, change: f64):
    """Watch the next sweep if the last was not calm; look at all grains when unwatched ones have added up.

    The change is the most that the velocity of a grain has changed by [m/s].
    """
    calm = stop.calm * watch.scalar[SLACK]
    if watch.flag[WATCHING] == 0:
        watch.scalar[DRIFT] = watch.scalar[DRIFT] + change
    watch.flag[WATCHING] = 1 if change > calm else 0
    watch.flag[LOOK] = 1 if watch.scalar[DRIFT] > calm else 0
    if watch.flag[LOOK] != 0:
        watch.scalar[LOOK_DRIFT] = watch.scalar[DRIFT]
        watch.scalar[DRIFT] = f64(0.0)


@cache
def stages(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the stages for one kind of scene."""

    @wp.func
    def is_sound(watch: Watch) -> int:
        """Whether no contact was missing and every number is finite."""
        return 1 if watch.flag[MISSED] == 0 and watch.flag[BAD_GRAIN] < 0 else 0

    @wp.func
    def start(watch: Watch, progress: Progress):
        """Iterate if the list holds for the velocities before the first iteration."""
        for slot in range(progress.zeta.shape[0]):
            progress.zeta[slot] = f64(0.0)
            progress.residual[slot] = f64(0.0)
            progress.overlap[slot] = f64(0.0)
            progress.carrying[slot] = 0
        progress.report[ITERATIONS] = f64(0.0)
        progress.iterating[0] = is_sound(watch)

    @wp.func
    def judge(watch: Watch, progress: Progress):
        """Accept the step only if it is sound to the end."""
        progress.accepted[0] = is_sound(watch)
        progress.checking[0] = 1
        progress.report[ACCEPTED] = f64(progress.accepted[0])

    @wp.func
    def gather(progress: Progress):
        """Gather what the workers have measured."""
        residual = f64(0.0)
        overlap = f64(0.0)
        carrying = int(0)
        for slot in range(progress.overlap.shape[0]):
            residual = wp.max(residual, progress.residual[slot])
            overlap = wp.max(overlap, progress.overlap[slot])
            carrying += progress.carrying[slot]
        progress.report[RESIDUAL] = residual
        progress.report[OVERLAP] = overlap
        progress.report[CARRYING] = f64(carrying)

    return SimpleNamespace(start=start, judge=judge, gather=gather)


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Kernels of the stages that are launched."""
    own = stages(variant)
    return kernels_of(variant.module, own.start, own.judge, own.gather)
