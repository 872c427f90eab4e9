"""The contact iteration as a whole: sweeps, until the corrections no longer change.

On a CPU it is one launch, in which workers meet between the stages. On a GPU a launch ends before the next
begins, so every stage, and every group of a sweep, is a launch of its own.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from . import momentum, residual, safeguard, sweep
from .crew import Crew, meet, slot_of
from .data import GROUPS, INFLUENCE, LOOK, Contacts, Grains, Progress, Watch
from .iteration import (
    Stop,
    decide_after_check,
    decide_after_iteration,
    decide_to_rebuild,
    decide_what_to_watch,
    gather_zeta,
)
from .momentum import Momentum
from .stage import kernels_of
from .turns import begin_turns, end_turn, end_turns
from .variant import Variant
from .watch import look_again

f64 = wp.float64


@cache
def stages(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the stages for one kind of scene."""
    plain, ahead = sweep.stages(variant), momentum.stages(variant)
    measure = residual.stages(variant).measure
    plain_turn, plain_walls = plain.sweep_turn, plain.sweep_all_walls
    ahead_turn, ahead_walls = ahead.sweep_turn, ahead.sweep_all_walls
    between = safeguard.stages(variant)
    judge_sweep, go_on_ahead = between.judge_sweep, between.go_on

    @wp.func
    def sweep_turn(
        crew: Crew, tid: int, grains: Grains, contacts: Contacts, watch: Watch, momentum: Momentum, turn: int
    ) -> f64:
        """Sweep the pairs of a turn, by the scene's method. Returns the largest |dv|."""
        if wp.static(variant.accelerated):
            return ahead_turn(crew, tid, grains, contacts, watch, momentum, turn)
        return plain_turn(crew, tid, grains, contacts, watch, turn)

    @wp.func
    def sweep_all_walls(
        crew: Crew, tid: int, grains: Grains, contacts: Contacts, watch: Watch, momentum: Momentum
    ) -> f64:
        """Sweep this worker's share of the walls, by the scene's method. Returns the largest |dv|."""
        if wp.static(variant.accelerated):
            return ahead_walls(crew, tid, grains, contacts, watch, momentum)
        return plain_walls(crew, tid, grains, contacts, watch)

    @wp.func
    def decide(
        grains: Grains, contacts: Contacts, watch: Watch, progress: Progress, momentum: Momentum, stop: Stop
    ):
        """What follows on a sweep."""
        zeta = gather_zeta(progress)
        change = watch.scalar[INFLUENCE] * zeta
        undone = int(0)
        if wp.static(variant.accelerated):
            change = change + judge_sweep(contacts, momentum, grains.position.shape[0])
            undone = momentum.undo[0]
        decide_after_iteration(watch, progress, stop, zeta, undone)
        if wp.static(variant.accelerated):
            decide_to_rebuild(progress, undone)
        decide_what_to_watch(watch, stop, change)

    @wp.func
    def go_on(
        crew: Crew,
        tid: int,
        grains: Grains,
        contacts: Contacts,
        watch: Watch,
        progress: Progress,
        momentum: Momentum,
    ):
        """Do this worker's share of what comes between two sweeps."""
        if wp.static(variant.accelerated):
            go_on_ahead(crew, tid, grains, contacts, watch, progress, momentum)
        else:
            if watch.flag[LOOK] != 0:
                look_again(grains.next_velocity, watch, crew, tid)

    @wp.func
    def iterate(
        crew: Crew,
        tid: int,
        grains: Grains,
        contacts: Contacts,
        watch: Watch,
        progress: Progress,
        momentum: Momentum,
        stop: Stop,
    ):
        """The contact iteration on a CPU."""
        slot = slot_of(crew, tid, progress.zeta.shape[0])
        while progress.iterating[0] != 0:
            zeta = f64(0.0)
            first, last = begin_turns(crew, tid, contacts)
            for turn in range(first, last):
                zeta = wp.max(zeta, sweep_turn(crew, tid, grains, contacts, watch, momentum, turn))
                end_turn(crew, tid, contacts)
            end_turns(crew, contacts)
            zeta = wp.max(zeta, sweep_all_walls(crew, tid, grains, contacts, watch, momentum))
            progress.zeta[slot] = zeta
            meet(crew)
            if slot == 0:
                decide(grains, contacts, watch, progress, momentum, stop)
            meet(crew)
            if progress.checking[0] != 0:
                progress.residual[slot] = measure(crew, tid, grains, contacts)
                meet(crew)
                if slot == 0:
                    decide_after_check(progress, stop)
                meet(crew)
            go_on(crew, tid, grains, contacts, watch, progress, momentum)
            meet(crew)

    @wp.func
    def sweep_pairs(
        crew: Crew,
        tid: int,
        grains: Grains,
        contacts: Contacts,
        watch: Watch,
        progress: Progress,
        momentum: Momentum,
        group: int,
    ):
        """Correct the pairs of one group: a GPU's launch."""
        if group < contacts.count[GROUPS]:
            zeta = sweep_turn(crew, tid, grains, contacts, watch, momentum, group)
            wp.atomic_max(progress.zeta, slot_of(crew, tid, progress.zeta.shape[0]), zeta)

    @wp.func
    def sweep_walls(
        crew: Crew,
        tid: int,
        grains: Grains,
        contacts: Contacts,
        watch: Watch,
        progress: Progress,
        momentum: Momentum,
    ):
        """Correct every grain that may reach a wall: a GPU's launch."""
        zeta = sweep_all_walls(crew, tid, grains, contacts, watch, momentum)
        wp.atomic_max(progress.zeta, slot_of(crew, tid, progress.zeta.shape[0]), zeta)

    @wp.func
    def decide_here(
        grains: Grains, contacts: Contacts, watch: Watch, progress: Progress, momentum: Momentum, stop: Stop
    ):
        """What follows on a sweep: a GPU's launch."""
        decide(grains, contacts, watch, progress, momentum, stop)

    @wp.func
    def check_here(progress: Progress, stop: Stop):
        """What follows on a check of the residual: a GPU's launch."""
        if progress.checking[0] != 0:
            decide_after_check(progress, stop)

    @wp.func
    def go_on_here(
        crew: Crew,
        tid: int,
        grains: Grains,
        contacts: Contacts,
        watch: Watch,
        progress: Progress,
        momentum: Momentum,
    ):
        """What comes between two sweeps: a GPU's launch."""
        go_on(crew, tid, grains, contacts, watch, progress, momentum)

    return SimpleNamespace(
        iterate=iterate,
        sweep_pairs=sweep_pairs,
        sweep_walls=sweep_walls,
        decide_here=decide_here,
        check_here=check_here,
        go_on_here=go_on_here,
    )


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Kernels of the stages that are launched."""
    own = stages(variant)
    return kernels_of(
        variant.module,
        own.iterate,
        own.sweep_pairs,
        own.sweep_walls,
        own.decide_here,
        own.check_here,
        own.go_on_here,
    )
