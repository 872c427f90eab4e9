"""When the contact iteration starts and stops, and whether the step is accepted: decided on the device."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .data import (
    ACCEPTED,
    BAD_GRAIN,
    CARRYING,
    DRIFT,
    INFLUENCE,
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
from .variant import Variant

f64 = wp.float64


@wp.struct
class Stop:
    """When to stop iterating, and when a sweep is calm enough not to be watched."""

    tolerance: f64  # on zeta [m/s]
    max_iterations: wp.int32
    calm: f64  # change of a grain's velocity that need not be watched, in slacks [1/s]


@wp.func
def is_power_of_two(number: int) -> bool:
    """Whether it is 1, 2, 4, 8, ..."""
    return number & (number - 1) == 0


@wp.func
def decide_after_iteration(watch: Watch, progress: Progress, stop: Stop):
    """Gather zeta; stop after the first iteration with zeta <= tolerance, or at max_iterations.

    The next sweep is watched if the last one was not calm; when unwatched ones have added up, all grains are
    looked at. An attempt in which a contact may have been missing is given up, but not at once, so that it
    shows how far all grains must reach.
    """
    zeta = f64(0.0)
    for slot in range(progress.zeta.shape[0]):
        zeta = wp.max(zeta, progress.zeta[slot])
        progress.zeta[slot] = f64(0.0)
    iterations = progress.report[ITERATIONS] + f64(1.0)
    progress.report[ITERATIONS] = iterations
    progress.report[ZETA] = zeta
    progress.iterating[0] = 0 if zeta <= stop.tolerance or iterations >= f64(stop.max_iterations) else 1
    if watch.flag[MISSED] != 0 and is_power_of_two(int(iterations)):
        progress.iterating[0] = 0
    change = watch.scalar[INFLUENCE] * zeta
    if watch.flag[WATCHING] == 0:
        watch.scalar[DRIFT] = watch.scalar[DRIFT] + change
    calm = stop.calm * watch.scalar[SLACK]
    watch.flag[WATCHING] = 1 if change > calm else 0
    watch.flag[LOOK] = 1 if watch.scalar[DRIFT] > calm else 0
    if watch.flag[LOOK] != 0:
        watch.scalar[LOOK_DRIFT] = watch.scalar[DRIFT]
        watch.scalar[DRIFT] = f64(0.0)


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the kernels for one kind of scene."""

    @wp.func
    def is_sound(watch: Watch) -> int:
        """Whether no contact was missing and every number is finite."""
        return 1 if watch.flag[MISSED] == 0 and watch.flag[BAD_GRAIN] < 0 else 0

    @wp.kernel(module=variant.module)
    def start(watch: Watch, progress: Progress):
        """Iterate if the list holds for the velocities before the first iteration."""
        for slot in range(progress.zeta.shape[0]):
            progress.zeta[slot] = f64(0.0)
            progress.residual[slot] = f64(0.0)
            progress.overlap[slot] = f64(0.0)
            progress.carrying[slot] = 0
        progress.report[ITERATIONS] = f64(0.0)
        progress.iterating[0] = is_sound(watch)

    @wp.kernel(module=variant.module)
    def judge(watch: Watch, progress: Progress):
        """Accept the step only if it is sound to the end."""
        progress.accepted[0] = is_sound(watch)
        progress.report[ACCEPTED] = f64(progress.accepted[0])

    @wp.kernel(module=variant.module)
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
