"""The working set of the accelerated method: the contacts swept between two scans of all contacts.

A scan selects the contacts that have a correction now or had one before the last sweep, and the contacts that
the velocities violate or almost violate. It copies them to contiguous arrays. Without friction, sweeps access
no other array of contacts, so that these arrays stay in the cache. All contacts outside the set have no
correction and get none, so velocities between two scans do not matter to the list's proof (verlet.py).

The copies of a chunk (contacts.py) begin at the index of its first contact, so that threads select in
parallel.
"""

import warp as wp

from .. import law
from ..access import at, bodies_of, contact_at, larger, named, put
from ..contacts import chunks_of_set, contacts_of_chunk, gap_rates_now, is_wall_set
from ..record import Scene, has_friction, has_rolling, has_swept, has_weights, is_driven, pair_count
from ..search.verlet import keep_peak
from ..team.threads import Team, take_max, thread_range, update_max
from ..types import ContactsByRef, CorrectionByRef, Floats, Ints
from ..walls.driven import closing_speed
from .lanes import FOUR, end_of_fours, lanes
from .stopping import is_recorded, stop_or_sweep, stops_on_zeta

f64 = wp.float64
NEAR = wp.constant(f64(0.25))  # distance from a violation at which a contact is swept, in units of zeta


@wp.func
def nearness(s: Scene) -> f64:
    """Return the margin [m/s]: wall contacts with vn > gap / dt - margin are swept, and pairs with twice it.

    So contacts whose violation changes only in the last digits do not enter and leave the set repeatedly.
    """
    if not has_swept(s):
        return f64(0.0)
    return wp.min(NEAR * s.step.zeta, s.tuning.nearest)


@wp.func
def check_peak(s: Scene, i: int):
    """Update the peak deviation p_i of body i; the list expires if p_i plus `nearness` exceeds its limit."""
    allowed = at(s.verlet.peak_limit, i) - nearness(s)
    peak = keep_peak(s, i, at(s.grains.next_velocity, i))
    if allowed < f64(0.0) or peak > allowed * allowed:
        s.verlet.list_expired = 1


@wp.func
def empty(s: Scene, k: int):
    """Remove all contacts from chunk k of the working set, and set its sums to 0."""
    put(s.momentum.contact_sums, k, wp.vec2d(f64(0.0), f64(0.0)))
    put(s.working.range, k, wp.vec2i(0, 0))


@wp.func
def scatter(s: Scene, chunk: int):
    """Copy the corrections of a chunk of the working set back to all contacts."""
    bounds = at(s.working.range, chunk)
    scatter_correction(s.working.index, bounds, s.contacts.dv, s.working.contacts.dv)
    scatter_correction(s.working.index, bounds, s.contacts.dvt, s.working.contacts.dvt)
    scatter_correction(s.working.index, bounds, s.contacts.dvr, s.working.contacts.dvr)


@wp.func
def scatter_correction(index: Ints, bounds: wp.vec2i, target: CorrectionByRef, source: CorrectionByRef):
    """Copy one kind of correction of a chunk (range `bounds`) back, if the scene has it."""
    if source.now.shape[0] > 0:
        scatter_numbers(index, bounds, target.now, source.now)
        scatter_numbers(index, bounds, target.last, source.last)


@wp.func
def scatter_numbers(index: Ints, bounds: wp.vec2i, target: Floats, source: Floats):
    """Copy the numbers of a chunk (range `bounds` of `source`) back to `target`, the array of all contacts.

    `index` has the index in `target` of every number of the working set.
    """
    c = int(bounds[0])
    while c < bounds[1]:
        put(target, at(index, c), at(source, c))
        c += 1


@wp.func
def copy_corrections(target: ContactsByRef, k: int, source: ContactsByRef, c: int):
    """Copy the corrections of contact c of `source` to contact k of `target`."""
    copy_correction(target.dv, k, source.dv, c)
    if target.dvt.now.shape[0] > 0:
        copy_correction(target.dvt, k, source.dvt, c)
    if target.dvr.now.shape[0] > 0:
        copy_correction(target.dvr, k, source.dvr, c)


@wp.func
def copy_correction(target: CorrectionByRef, k: int, source: CorrectionByRef, c: int):
    """Copy one kind of correction, now and before the last sweep."""
    put(target.now, k, at(source.now, c))
    put(target.last, k, at(source.last, c))


@wp.func
def select(s: Scene, c: int, k: int):
    """Copy contact k to index c of the working set."""
    contact = contact_at(s.contacts.contact, k)
    put(s.working.index, c, k)
    put(s.working.contacts.contact, c, contact)
    copy_corrections(s.working.contacts, c, s.contacts, k)
    if has_weights(s):
        weight = at(s.contacts.weights, k)
        put(s.working.contacts.weights, c, weight)
        i, _ = bodies_of(contact)
        put(s.working.mass, c, weight[0] * at(s.grains.contact_mass, i))
        if has_friction(s):
            put(s.working.contacts.rim_weights, c, at(s.contacts.rim_weights, k))
    if has_rolling(s):
        put(s.working.contacts.roll_weights, c, at(s.contacts.roll_weights, k))


def selecting(count: int) -> wp.Function:
    """Return the function `(scene, begin, end, first)` that selects pairs, `count` at a time (lanes.py).

    It copies those of the pairs begin to end - 1 that need a sweep to the working set, from index `first` on.
    It returns the index after the last copy, and the largest violation of the pairs without a correction
    [m/s].
    """
    numbers_at, approach, gap_rates = lanes(count).numbers_at, lanes(count).approach, lanes(count).gap_rates

    @wp.func
    def select_some(s: Scene, begin: int, end: int, first: int):
        pairs = s.contacts.contact
        now = s.contacts.dv.now
        last = s.contacts.dv.last
        near = f64(2.0) * nearness(s)
        violation = f64(0.0)
        free = int(first)
        c = int(begin)
        while c < end:
            excess = approach(s.grains.next_velocity, pairs, c) - gap_rates(pairs, c)
            carried = numbers_at(now, c) + numbers_at(last, c)
            for k in range(wp.static(count)):
                carries = carried[k] > f64(0.0)
                violation = larger(violation, wp.where(carries, f64(0.0), excess[k]))
                select(s, free, c + k)
                free += wp.where(carries or excess[k] + near > f64(0.0), 1, 0)
            c += wp.static(count)
        return free, violation

    return select_some


select_four, select_one = selecting(FOUR), selecting(1)


@wp.func
def select_pairs(s: Scene, begin: int, end: int):
    """Copy the pairs that need a sweep to the working set: with a correction, or (almost) violated.

    Four pairs at a time are tested, then one. Returns the index after the last copy, and the largest
    violation of pairs without a correction [m/s].
    """
    rest = end_of_fours(begin, end)
    after_four, violation_of_four = select_four(s, begin, rest, begin)
    after, violation_of_one = select_one(s, rest, end, after_four)
    return after, larger(violation_of_four, violation_of_one)


def selecting_walls(driven: bool) -> wp.Function:
    """Return the function `(scene, begin, end)` that selects contacts with walls; `driven`: a wall is driven.

    It copies contacts that need a sweep to the working set. It returns the index after the last copy, and the
    largest violation of contacts without a correction [m/s].
    """

    @named(f"select_{'driven_' if driven else ''}walls")
    def select_some(s: Scene, begin: int, end: int):
        near, velocity = nearness(s), s.grains.next_velocity
        violation = f64(0.0)
        free = int(begin)
        c = int(begin)
        while c < end:
            contact, dv = contact_at(s.contacts.contact, c), at(s.contacts.dv.now, c)
            i, j = bodies_of(contact)
            n = contact.n
            carries = dv != f64(0.0) or at(s.contacts.dv.last, c) != f64(0.0)
            if wp.static(driven):
                change = closing_speed(s, velocity, i, j, n) - contact.gap_rate
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
def select_set(team: Team, s: Scene, k: int):
    """Copy the contacts of the independent set k that need a sweep to the working set.

    Take the largest violation of contacts without a correction [m/s] into `partial.zeta`.
    """
    violation = f64(0.0)
    begin_chunks, end_chunks = chunks_of_set(s, k)
    first, last = thread_range(team, begin_chunks, end_chunks)
    at_wall = is_wall_set(s, k)
    for chunk in range(first, last):
        begin, end = contacts_of_chunk(s, k, chunk)
        after, worst = int(begin), f64(0.0)
        if at_wall and is_driven(s):
            after, worst = select_driven_walls(s, begin, end)
        elif at_wall:
            after, worst = select_walls(s, begin, end)
        else:
            after, worst = select_pairs(s, begin, end)
        violation = larger(violation, worst)
        put(s.working.range, chunk, wp.vec2i(begin, after))
    update_max(team, s.partial.zeta, violation)


@wp.func
def end_scan(s: Scene):
    """Stop or sweep after a scan.

    If the tolerance bounds zeta, zeta includes the violation of contacts without a correction.
    """
    violation = take_max(s.partial.zeta)
    if has_swept(s) and stops_on_zeta(s) and s.control.rejected == 0:
        s.step.zeta = wp.max(s.step.zeta, violation)
        if is_recorded(s):
            put(s.zeta_history, s.step.iterations - 1, s.step.zeta)
    stop_or_sweep(s)
