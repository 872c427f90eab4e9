"""Numbers that a step reports, and sums of them over a run (`warpgrains.solver.statistics`)."""

import warp as wp

from . import law
from .access import at, bodies_of, contact_at, larger, put
from .contacts import contact_count
from .record import Scene, grain_count
from .team.threads import Team, partial_index, take_max, thread_range, update_max
from .walls.contact import wall_overlap
from .walls.walls import way

f64 = wp.float64


@wp.func
def overlap_of(s: Scene, c: int) -> f64:
    """Return the overlap of the bodies of contact c, which is minus the gap [m]."""
    i, j = bodies_of(contact_at(s.contacts.contact, c))
    x, radius = at(s.grains.position, i), at(s.grains.radius, i)
    if j >= grain_count(s):
        return wall_overlap(j - grain_count(s), x, radius, s.walls)
    return -law.pair_gap(
        law.distance(wp.vec2d(), way(x, at(s.grains.position, j), s.walls)), radius, at(s.grains.radius, j)
    )


@wp.func
def overlaps(team: Team, s: Scene):
    """Write the worst overlap [m] of this thread's contacts, and the number with dv != 0, to `partial`."""
    worst = f64(0.0)
    active = int(0)
    c, end = thread_range(team, 0, contact_count(s))
    while c < end:
        worst = larger(worst, overlap_of(s, c))
        active += 1 if at(s.contacts.dv.now, c) != f64(0.0) else 0
        c += 1
    update_max(team, s.partial.overlap, worst)
    wp.atomic_add(s.partial.active, partial_index(team, s.partial.active.shape[0]), active)


@wp.func
def report(s: Scene):
    """Reduce the partial results of the threads, and add the results of the step to the sums of the run."""
    active = int(0)
    for k in range(s.partial.active.shape[0]):
        active += at(s.partial.active, k)
        put(s.partial.active, k, 0)
    s.step.active = active
    s.step.overlap = take_max(s.partial.overlap)
    s.reported = s.step
    done, total = s.step, s.statistics
    total.steps = total.steps + 1
    total.iterations = total.iterations + wp.int64(done.iterations)
    total.iterations_max = wp.max(total.iterations_max, done.iterations)
    total.residual = wp.max(total.residual, done.residual)
    total.overlap = wp.max(total.overlap, done.overlap)
    total.rebuilds = total.rebuilds + wp.int64(done.rebuilds)
    total.restarts = total.restarts + wp.int64(done.restarts)
    if done.converged == 0:
        total.unconverged = total.unconverged + 1
    s.statistics = total
