"""The working set of the accelerated method: the contacts that are swept between two scans of all contacts.

A scan finds the contacts that carry a correction, or did one sweep before, and those that the velocities
violate or nearly do, and copies them to contiguous arrays. Without friction, sweeps touch no other array of
contacts, so that they stay in the cache. All other contacts have no correction and get none, so velocities
between two scans do not matter to the list's proof (verlet.py).

The copies of a part (contacts.py) begin at the index of its first contact: threads select in parallel.
"""

import warp as wp

from . import law
from .access import (
    at,
    copy_contact,
    first_of,
    gap_rate_of,
    larger,
    named,
    normal_of,
    put,
    second_of,
)
from .contacts import CHUNK, chunks_of_set, gap_rates_now, is_wall_set
from .driven import closing_speed
from .lanes import FOUR, end_of_fours, lanes
from .record import Scene, has_friction, has_weights, is_driven, pair_count
from .stopping import stop_or_sweep, stops_on_zeta
from .threads import Team, reduce_max, thread_range, update_max
from .types import Floats, WorkingSet
from .verlet import keep_peak

f64 = wp.float64
NEAR = wp.constant(f64(0.25))  # of the largest change of a correction: how near to a violation one is swept


@wp.func
def nearness(s: Scene) -> f64:
    """Return how near to a violation a wall contact must be to be swept [m/s]; for a pair it is twice that.

    So contacts whose violation changes in the last digits only do not enter and leave the set.
    """
    if s.step.iterations == 0:
        return f64(0.0)
    return wp.min(NEAR * s.step.zeta, s.tuning.nearest)


@wp.func
def check_peak(s: Scene, i: int):
    """Update a body's peak; the list expires if its skin does not allow for contacts near a violation."""
    allowed = at(s.verlet.peak_limit, i) - nearness(s)
    peak = keep_peak(s, i, at(s.grains.next_velocity, i))
    if allowed < f64(0.0) or peak > allowed * allowed:
        s.verlet.flags.list_expired = 1


@wp.func
def empty(s: Scene, k: int):
    """Empty part k of the working set."""
    put(s.momentum.contact_part, k, wp.vec2d(f64(0.0), f64(0.0)))
    put(s.working.range, k, wp.vec2i(0, 0))


@wp.func
def scatter(s: Scene, part: int):
    """Copy the corrections of a part of the working set back to all contacts."""
    working, bounds = s.working, at(s.working.range, part)
    scatter_numbers(working, bounds, s.contacts.dv, working.contacts.dv)
    scatter_numbers(working, bounds, s.contacts.last_dv, working.contacts.last_dv)
    if has_friction(s):
        scatter_numbers(working, bounds, s.contacts.dvt, working.contacts.dvt)
        scatter_numbers(working, bounds, s.contacts.last_dvt, working.contacts.last_dvt)


@wp.func
def scatter_numbers(working: WorkingSet, bounds: wp.vec2i, target: Floats, source: Floats):
    """Copy numbers of a part of the working set back to those of all contacts."""
    c = int(bounds[0])
    while c < bounds[1]:
        put(target, at(working.index, c), at(source, c))
        c += 1


@wp.func
def select(s: Scene, c: int, k: int):
    """Copy contact k to index c of the working set."""
    put(s.working.index, c, k)
    copy_contact(s.working.contacts.contact, c, s.contacts.contact, k)
    put(s.working.contacts.dv, c, at(s.contacts.dv, k))
    put(s.working.contacts.last_dv, c, at(s.contacts.last_dv, k))
    if has_weights(s):
        weight = at(s.contacts.weights, k)
        put(s.working.contacts.weights, c, weight)
        put(s.working.mass, c, weight[0] * at(s.grains.contact_mass, first_of(s.contacts.contact, k)))


@wp.func
def closing_speed_of(s: Scene, c: int) -> f64:
    """Return vn of a pair [m/s] (eq. 5)."""
    v, contact = s.grains.next_velocity, s.contacts.contact
    return wp.dot(at(v, first_of(contact, c)) - at(v, second_of(contact, c)), normal_of(contact, c))


def selecting(count: int) -> wp.Function:
    """Return the function that selects pairs of [begin, end), `count` at a time (lanes.py).

    It takes `(scene, begin, end, place)`, the first index in the working set, and returns the index after the
    last pair, and the largest violation of pairs that carry no correction.
    """
    vector, numbers_at = lanes(count).vector, lanes(count).numbers_at

    @wp.func
    def select_some(s: Scene, begin: int, end: int, place: int):
        contacts = s.contacts
        near = f64(2.0) * nearness(s)
        violation = f64(0.0)
        free = int(place)
        c = int(begin)
        while c < end:
            vn = vector()
            for k in range(wp.static(count)):
                vn[k] = closing_speed_of(s, c + k)
            carried = numbers_at(contacts.dv, c) + numbers_at(s.contacts.last_dv, c)
            for k in range(wp.static(count)):
                excess = vn[k] - gap_rate_of(contacts.contact, c + k)
                carries = carried[k] > f64(0.0)
                violation = larger(violation, wp.where(carries, f64(0.0), excess))
                select(s, free, c + k)
                free += wp.where(carries or excess + near > f64(0.0), 1, 0)
            c += wp.static(count)
        return free, violation

    return select_some


select_four, select_one = selecting(FOUR), selecting(1)


@wp.func
def select_pairs(s: Scene, begin: int, end: int):
    """Select pairs, four at a time and then those that are left. Returns what `selecting` does."""
    rest = end_of_fours(begin, end)
    after_four, violation_of_four = select_four(s, begin, rest, begin)
    after, violation_of_one = select_one(s, rest, end, after_four)
    return after, larger(violation_of_four, violation_of_one)


def selecting_walls(driven: bool) -> wp.Function:
    """Return the function that selects contacts with walls; with `driven`, forces drive some of the walls.

    It takes `(scene, begin, end)` and returns what `selecting` does.
    """

    @named(f"select_{'driven_' if driven else ''}walls")
    def select_some(s: Scene, begin: int, end: int):
        near, velocity, contact = nearness(s), s.grains.next_velocity, s.contacts.contact
        violation = f64(0.0)
        free = int(begin)
        c = int(begin)
        while c < end:
            i, n, dv = first_of(contact, c), normal_of(contact, c), at(s.contacts.dv, c)
            carries = dv != f64(0.0) or at(s.contacts.last_dv, c) != f64(0.0)
            if wp.static(driven):
                change = closing_speed(s, velocity, i, second_of(contact, c), n) - gap_rate_of(contact, c)
                is_near = change + near > f64(0.0)
            else:
                v = at(velocity, i)
                gap, back = gap_rates_now(s.contacts, c, v)
                change = wp.abs(law.projection(wp.dot(v, n), dv, gap, back))
                is_near = law.projection(wp.dot(v, n), dv, gap - near, back - near) != f64(0.0)
            violation = larger(violation, wp.where(carries, f64(0.0), change))
            if carries or is_near:
                select(s, free, c)
                if wp.static(not driven) and s.contacts.limits.shape[0] > 0:
                    limits = at(s.contacts.limits, c - pair_count(s))
                    put(s.working.contacts.limits, free - pair_count(s), limits)
                free += 1
            c += 1
        return free, violation

    return select_some


select_walls, select_driven_walls = selecting_walls(False), selecting_walls(True)


@wp.func
def select_tangential(s: Scene, begin: int, end: int):
    """Copy what selected contacts have with friction, from index begin to end of the working set."""
    c = int(begin)
    while c < end:
        k = at(s.working.index, c)
        put(s.working.contacts.dvt, c, at(s.contacts.dvt, k))
        put(s.working.contacts.last_dvt, c, at(s.contacts.last_dvt, k))
        if has_weights(s):
            put(s.working.contacts.rim_weights, c, at(s.contacts.rim_weights, k))
        c += 1


@wp.func
def select_set(team: Team, s: Scene, k: int):
    """Select the contacts of a set that are swept, and find the largest violation of the others."""
    violation = f64(0.0)
    start, stop = at(s.contacts.set_start, k), at(s.contacts.set_start, k + 1)
    first_chunk, end_chunk, origin, part = chunks_of_set(s, k)
    first, last = thread_range(team, first_chunk, end_chunk)
    at_wall = is_wall_set(s, k)
    for chunk in range(first, last):
        begin = wp.max(start, origin + chunk * CHUNK)
        end = wp.min(stop, origin + (chunk + 1) * CHUNK)
        after, worst = int(begin), f64(0.0)
        if at_wall and is_driven(s):
            after, worst = select_driven_walls(s, begin, end)
        elif at_wall:
            after, worst = select_walls(s, begin, end)
        else:
            after, worst = select_pairs(s, begin, end)
        violation = larger(violation, worst)
        if has_friction(s):
            select_tangential(s, begin, after)
        put(s.working.range, part + chunk, wp.vec2i(begin, after))
    update_max(team, s.partial.zeta, violation)


@wp.func
def end_scan(s: Scene):
    """Stop or sweep after a scan.

    If the tolerance is on zeta, the violation of contacts outside the set counts as a change still to come.
    """
    violation = reduce_max(s.partial.zeta)
    iterations = s.step.iterations
    if iterations > 0 and stops_on_zeta(s) and s.control.rejected == 0:
        s.step.zeta = wp.max(s.step.zeta, violation)
        if iterations <= s.history.zeta.shape[0]:
            put(s.history.zeta, iterations - 1, s.step.zeta)
    stop_or_sweep(s)
