"""What a step reports, and what is added up of the steps of a run (`warpgrains.solver.statistics`)."""

import warp as wp

from . import law
from .access import at, first_of, larger, put, read_wall, second_of
from .record import UNPROVED, Scene, pair_count, wall_count
from .stopping import gathered
from .threads import Team, keep_largest, partial_index, thread_range
from .walls import WallContact, wall_overlap

f64 = wp.float64


@wp.func
def overlaps(team: Team, s: Scene):
    """Worst overlap [m] of the listed contacts, and how many are active; all others have stayed silent.

    What they carry is what the next step starts with.
    """
    worst = f64(0.0)
    active = int(0)
    grains, contacts = s.grains, s.contacts
    c, last = thread_range(team, 0, pair_count(s))
    while c < last:
        i = first_of(contacts.pairs, c)
        j = second_of(contacts.pairs, c)
        distance = law.distance(at(grains.position, i), at(grains.position, j))
        gap = law.pair_gap(distance, at(grains.radius, i), at(grains.radius, j))
        worst = larger(worst, -gap)
        dv = at(contacts.pair_dv, c)
        put(contacts.pair_dv_start, c, dv)
        active += 1 if dv != f64(0.0) else 0
        c += 1
    wall = WallContact()
    c, end = thread_range(team, 0, wall_count(s))
    while c < end:
        read_wall(contacts.walls, c, wall)
        x, radius = at(grains.position, wall.i), at(grains.radius, wall.i)
        worst = larger(worst, wall_overlap(x, radius, s.walls))
        put(contacts.wall_dv_start, c, wall.dv)
        active += 1 if wall.dv != f64(0.0) else 0
        c += 1
    keep_largest(team, s.partial.overlap, worst)
    wp.atomic_add(s.partial.active, partial_index(team, s.partial.active.shape[0]), active)


@wp.func
def report(s: Scene):
    """Gather what the threads have measured."""
    active = int(0)
    for k in range(s.partial.active.shape[0]):
        active += at(s.partial.active, k)
        put(s.partial.active, k, 0)
    s.step.active = active
    s.step.overlap = gathered(s.partial.overlap)


@wp.func
def add_step(s: Scene):
    """Count one step, and ask for a search for a proof that it has no solution where that is worth it."""
    done = s.step
    total = s.statistics
    total.steps = total.steps + 1
    total.iterations = total.iterations + wp.int64(done.iterations)
    total.iterations_max = wp.max(total.iterations_max, done.iterations)
    total.residual = wp.max(total.residual, done.residual)
    total.overlap = wp.max(total.overlap, done.overlap)
    total.rebuilds = total.rebuilds + wp.int64(done.rebuilds)
    total.redos = total.redos + wp.int64(done.redos)
    if done.converged == 0:
        total.unconverged = total.unconverged + 1
        s.to_search = s.to_search - done.iterations
        if s.to_search <= 0:
            s.step.outcome = UNPROVED
    s.statistics = total
