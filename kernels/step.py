"""One whole step of one scene by one worker: what warpgrains/solver.py launches, in one go."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from . import iterate, iteration, measure, momentum, motion, rebuild, residual, sweep, watch
from .crew import Crew
from .data import BAD_GRAIN, GROUPS, ITERATIONS, PAIRS, WALLS
from .record import LISTING, REBUILDS, REDOS, SceneRecord
from .variant import Variant

f64 = wp.float64
SOLVED, WITHOUT_ROOM, FAILED = (wp.constant(k) for k in range(3))


@wp.func
def revert(s: SceneRecord):
    """Take back what an unfinished step did to the corrections."""
    for c in range(s.contacts.count[PAIRS]):
        s.contacts.pair_dv[c] = s.contacts.pair_dv_start[c]
    for c in range(s.contacts.count[WALLS]):
        s.contacts.walls[c].dv = s.contacts.wall_dv_start[c]


@cache
def stages(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the stages for one kind of scene."""
    moving, contact, watching = motion.stages(variant), sweep.stages(variant), watch.stages(variant)
    free_velocity, reset, move = moving.free_velocity, moving.reset, moving.move
    start_pairs, start_walls = contact.start_pairs, contact.start_walls
    clear, find_frame, first_look = watching.clear, watching.find_frame, watching.first_look
    verify, remember, shift_frame = watching.verify, watching.remember, watching.shift_frame
    deciding, loop = iteration.stages(variant), iterate.stages(variant).iterate
    start, judge, gather = deciding.start, deciding.judge, deciding.gather
    begin_momentum, measure_all = momentum.stages(variant).begin, residual.stages(variant).measure_all
    overlaps, listing = measure.stages(variant).overlaps, rebuild.stages(variant)
    set_old_aside, renew_reaches = listing.set_old_aside, listing.renew_reaches
    list_contacts = listing.list_contacts

    @wp.func
    def warm_start(crew: Crew, s: SceneRecord):
        """Freeze normals and gaps, and re-apply the corrections of the previous step (iteration 0)."""
        reset(crew, 0, s.grains)
        start_pairs(crew, 0, s.grains, s.contacts, s.dt, 0, s.contacts.count[GROUPS])
        start_walls(crew, 0, s.grains, s.contacts, s.radius_in, s.radius_out, s.dt)
        clear(s.watch)
        for i in range(s.grains.position.shape[0]):
            find_frame(i, s.grains, s.watch)
        first_look(crew, 0, s.grains, s.watch, s.dt)

    @wp.func
    def finish(crew: Crew, s: SceneRecord):
        """Move, and measure what the report tells."""
        measure_all(crew, 0, s.grains, s.contacts, s.progress)
        move(crew, 0, s.grains, s.dt)
        remember(crew, 0, s.watch)
        shift_frame(s.watch, s.dt)
        overlaps(crew, 0, s.grains, s.contacts, s.progress, s.radius_in, s.radius_out)
        gather(s.progress)

    @wp.func
    def attempt(crew: Crew, s: SceneRecord) -> bool:
        """Solve the step for the listed contacts, and take it if none was missing."""
        warm_start(crew, s)
        verify(crew, 0, s.grains, s.watch, s.dt, s.rounding, s.reserve, f64(1.0))
        start(s.watch, s.progress)
        if wp.static(variant.accelerated):
            begin_momentum(crew, 0, s.grains, s.contacts, s.momentum)
        loop(crew, 0, s.grains, s.contacts, s.watch, s.progress, s.momentum, s.stop)
        verify(crew, 0, s.grains, s.watch, s.dt, s.rounding, f64(0.0), f64(0.0))
        judge(s.watch, s.progress)
        if s.progress.accepted[0] != 0:
            finish(crew, s)
        return s.progress.accepted[0] != 0

    @wp.func
    def solve(crew: Crew, s: SceneRecord) -> int:
        """Advance by one time step; stop before it if it fails, and amid it if a list must grow."""
        if s.flag[LISTING] == 0:
            s.flag[REBUILDS] = 0
            s.flag[REDOS] = 0
            free_velocity(crew, 0, s.grains, s.gravity, s.drag, s.dt)
        outcome = int(-1)
        while outcome < 0:
            if s.flag[LISTING] != 0:
                if list_contacts(s):
                    s.flag[LISTING] = 0
                else:
                    outcome = WITHOUT_ROOM
            if s.flag[LISTING] == 0:
                if attempt(crew, s):
                    outcome = SOLVED
                elif s.watch.flag[BAD_GRAIN] >= 0:
                    revert(s)
                    outcome = FAILED
                else:
                    if s.progress.report[ITERATIONS] > f64(0.0):
                        s.flag[REDOS] = s.flag[REDOS] + 1
                    s.flag[REBUILDS] = s.flag[REBUILDS] + 1
                    set_old_aside(s)
                    renew_reaches(s)
                    s.flag[LISTING] = 1
        return outcome

    return SimpleNamespace(solve=solve)
