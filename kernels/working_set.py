"""The working set of the accelerated method: the contacts that are swept between two looks at all of them.

A look finds the contacts that carry a correction, or did a sweep back, and those that the velocities violate
or nearly do, and copies them side by side; sweeps touch nothing else, so that they stay in the cache. The
others have no correction and get none: what velocities do between two looks is no matter to the list's proof
(verlet.py).

A part's copies (chunks.py) lie where its contacts begin, so that threads select side by side.
"""

import warp as wp

from .access import (
    at,
    copy_pair,
    first_of,
    gap_rate_of,
    larger,
    put,
    read_wall,
    set_wall,
    set_wall_dv,
    vn_of,
    wall_dv_at,
)
from .chunks import CHUNK, chunks_in, wall_part_count
from .lanes import FOUR, end_of_fours, lanes
from .record import Scene, wall_count
from .stopping import gathered, is_going_on
from .threads import Team, keep_largest, thread_range
from .verlet import keep_peak
from .walls import WallContact, has_inner, outer_gap_rate, wall_projection

f64 = wp.float64
NEAR = wp.constant(f64(0.25))  # of the largest change of a correction: how near to a violation one is swept


@wp.func
def nearness(s: Scene) -> f64:
    """How near to a violation a wall contact is swept [m/s], and half as near as a pair is.

    Contacts that are violated now and then, in the last digits that still change, do not come and go so.
    """
    if s.step.iterations == 0:
        return f64(0.0)
    return wp.min(NEAR * s.step.zeta, s.tuning.nearest)


@wp.func
def see_skin(s: Scene, i: int):
    """Keep a grain's peak, and see whether its skin also allows for contacts that are near to a violation."""
    allowed = at(s.verlet.peak_limit, i) - nearness(s)
    peak = keep_peak(s, i, at(s.grains.next_velocity, i))
    if allowed < f64(0.0) or peak > allowed * allowed:
        s.verlet.flags.list_expired = 1


@wp.func
def put_back_pairs(s: Scene, part: int):
    """Write the corrections of a part's pairs where all pairs have theirs."""
    working = s.working
    bounds = at(working.pair_range, part)
    c = int(bounds[0])
    while c < bounds[1]:
        k = at(working.pair, c)
        put(s.contacts.pair_dv, k, at(working.pair_dv, c))
        put(s.momentum.pair_last, k, at(working.pair_last, c))
        c += 1


@wp.func
def put_back_walls(s: Scene, part: int):
    """Write the corrections of a part's wall contacts where all have theirs."""
    working = s.working
    bounds = at(working.wall_range, part)
    c = int(bounds[0])
    while c < bounds[1]:
        k = at(working.wall, c)
        set_wall_dv(s.contacts.walls, k, wall_dv_at(working.walls, c))
        put(s.momentum.wall_last, k, at(working.wall_last, c))
        c += 1


@wp.func
def pause_unless_listed(s: Scene):
    """Leave the iteration for a new list where one may be missing: the look is taken with that one."""
    if s.verlet.flags.list_expired != 0:
        s.control.iterating = 0
        s.control.unfinished = 1


@wp.func
def copy_of_pair(s: Scene, c: int, k: int):
    """Make the working pair at place c that of the contact at place k."""
    put(s.working.pair, c, k)
    copy_pair(s.working.pairs, c, s.contacts.pairs, k)
    put(s.working.gap_rate, c, gap_rate_of(s.contacts.pairs, k))
    put(s.working.pair_dv, c, at(s.contacts.pair_dv, k))
    put(s.working.pair_last, c, at(s.momentum.pair_last, k))
    if s.contacts.weights.shape[0] > 0:
        weight = at(s.contacts.weights, k)
        mu = weight[0] * at(s.grains.contact_mass, first_of(s.contacts.pairs, k))
        put(s.working.weights, c, wp.vec3d(weight[0], weight[1], mu))


def selecting(count: int) -> wp.Function:
    """Return the function that selects pairs of [begin, end), so many at a time (lanes.py).

    It takes `(scene, begin, end, place)`, the first place in the working set, and returns the place after the
    last pair, and by how much others are violated.
    """
    vector, numbers_at = lanes(count).vector, lanes(count).numbers_at

    @wp.func
    def select(s: Scene, begin: int, end: int, place: int):
        contacts = s.contacts
        near = f64(2.0) * nearness(s)
        violation = f64(0.0)
        free = int(place)
        c = int(begin)
        while c < end:
            vn = vector()
            for k in range(wp.static(count)):
                vn[k] = vn_of(s.grains.next_velocity, contacts.pairs, c + k)
            carried = numbers_at(contacts.pair_dv, c) + numbers_at(s.momentum.pair_last, c)
            for k in range(wp.static(count)):
                excess = vn[k] - gap_rate_of(contacts.pairs, c + k)
                carries = carried[k] > f64(0.0)
                violation = larger(violation, wp.where(carries, f64(0.0), excess))
                copy_of_pair(s, free, c + k)
                free += wp.where(carries or excess + near > f64(0.0), 1, 0)
            c += wp.static(count)
        return free, violation

    return select


select_four, select_one = selecting(FOUR), selecting(1)


@wp.func
def select_pairs(team: Team, s: Scene, k: int):
    """Select the pairs of a set that are swept, and see by how much others are violated."""
    violation = f64(0.0)
    start, stop = at(s.contacts.set_start, k), at(s.contacts.set_start, k + 1)
    first, last = thread_range(team, start // CHUNK, chunks_in(stop))
    for chunk in range(first, last):
        begin = wp.max(start, chunk * CHUNK)
        end = wp.min(stop, (chunk + 1) * CHUNK)
        rest = end_of_fours(begin, end)
        after_four, violation_of_four = select_four(s, begin, rest, begin)
        after, violation_of_one = select_one(s, rest, end, after_four)
        violation = larger(violation, larger(violation_of_four, violation_of_one))
        put(s.working.pair_range, chunk + k, wp.vec2i(begin, after))
    keep_largest(team, s.partial.zeta, violation)


@wp.func
def select_walls(team: Team, s: Scene):
    """Select the wall contacts that are swept, and see by how much others are violated."""
    violation = f64(0.0)
    near = nearness(s)
    inner = has_inner(s.walls)
    contact = WallContact()
    first, last = thread_range(team, 0, wall_part_count(s))
    for part in range(first, last):
        begin = part * CHUNK
        end = int(begin)
        c = int(begin)
        stop = wp.min(wall_count(s), begin + CHUNK)
        while c < stop:
            read_wall(s.contacts.walls, c, contact)
            before = at(s.momentum.wall_last, c)
            v = at(s.grains.next_velocity, contact.i)
            gap_out = outer_gap_rate(contact, v, s.walls)
            carries = contact.dv != f64(0.0) or before != f64(0.0)
            vn = wp.dot(v, contact.n)
            dv = wall_projection(vn, contact.dv, gap_out, contact.gap_rate_in, inner)
            nearly = wall_projection(vn, contact.dv, gap_out - near, contact.gap_rate_in - near, inner)
            set_wall(s.working.walls, end, contact)
            put(s.working.wall, end, c)
            put(s.working.wall_last, end, before)
            end += wp.where(carries or nearly != f64(0.0), 1, 0)
            violation = larger(violation, wp.where(carries, f64(0.0), wp.abs(dv)))
            c += 1
        put(s.working.wall_range, part, wp.vec2i(begin, end))
    keep_largest(team, s.partial.zeta, violation)


@wp.func
def see_whether_done(s: Scene):
    """Sweep on, unless that was the last sweep or, by zeta, all contacts are at rest.

    By zeta, what others are violated by is a change that is still to come, also of a step that ends with it.
    """
    violation = gathered(s.partial.zeta)
    iterations = s.step.iterations
    if iterations > 0 and s.stopping.on_residual == 0 and s.control.rejected == 0:
        s.step.zeta = wp.max(s.step.zeta, violation)
        if iterations <= s.history.zeta.shape[0]:
            put(s.history.zeta, iterations - 1, s.step.zeta)
    going_on = iterations == 0 or is_going_on(s, s.step.zeta)
    s.control.unfinished = 1 if going_on else 0
    s.control.iterating = s.control.unfinished
