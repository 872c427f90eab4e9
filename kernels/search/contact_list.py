"""Stages that save the old list, sort the new contacts, and transfer the corrections (warm start)."""

import warp as wp

from .. import law
from ..access import add, at, clear, put, raise_to
from ..contacts import value_at
from ..record import (
    Phase,
    Scene,
    grain_count,
    has_friction,
    has_rolling,
    has_swept,
    has_weights,
    is_accelerated,
)
from ..sweeps.rolling import find_roll_weights
from ..types import Contact, CorrectionByRef, Ints
from ..walls.walls import way
from .cells import prefix_sum

f64 = wp.float64
ROOT_TWO = wp.constant(f64(2.0**0.5))


@wp.func
def listed_count(s: Scene) -> int:
    """Return the number of contacts in the rows of the list."""
    return at(s.neighbors.start, grain_count(s))


@wp.func
def pair_end(start: Ints, neighbor: Ints, i: int) -> int:
    """Return the index in `neighbor` after the last pair of row i, where contacts with walls begin."""
    n = start.shape[0] - 1
    begin, k = at(start, i), at(start, i + 1)
    while k > begin and at(neighbor, wp.max(k - 1, 0)) >= n:
        k -= 1
    return k


@wp.func
def save_row(s: Scene, i: int):
    """Copy start[i], the index at which row i of the list begins, to `old_start`."""
    put(s.neighbors.old_start, i, at(s.neighbors.start, i))


@wp.func
def save_contact(s: Scene, k: int):
    """Save the second body and the corrections of the contact at index k in the rows of the list."""
    c = at(s.neighbors.sweep_index, k)
    put(s.neighbors.old_neighbor, k, at(s.neighbors.neighbor, k))
    save(s.contacts.dv, k, c)
    save(s.contacts.dvt, k, c)
    save(s.contacts.dvr, k, c)


@wp.func
def save(correction: CorrectionByRef, k: int, c: int):
    """Save one kind of correction of a contact: index c in the order of the sweep, k in the list's rows."""
    if correction.saved.shape[0] > 0:
        values = wp.vec3d(at(correction.now, c), at(correction.start, c), value_at(correction.last, c))
        put(correction.saved, k, values)


@wp.func
def restore(correction: CorrectionByRef, k: int, c: int):
    """Set one kind of correction of contact c to that saved at index k of the old list, or to 0 if k < 0."""
    if correction.saved.shape[0] > 0:
        values = wp.vec3d()
        if k >= 0:
            values = at(correction.saved, k)
        put(correction.now, c, values[0])
        put(correction.start, c, values[1])
        if correction.last.shape[0] > 0:
            put(correction.last, c, values[2])


@wp.func
def expire(s: Scene):
    """Count a rebuild of the list, and choose how the step continues after it.

    Accelerated sweeps resume with the new list, plain sweeps start again.
    """
    n = grain_count(s)
    put(s.neighbors.old_start, n, at(s.neighbors.start, n))
    s.step.rebuilds = s.step.rebuilds + 1
    s.control.resuming = 0
    if has_swept(s):
        if is_accelerated(s):
            s.control.resuming = 1
        else:
            s.step.restarts = s.step.restarts + 1


@wp.func
def fill_rows(s: Scene):
    """Sort the contacts in `found` into the rows of the list: by first, then by second body.

    There are two counting sorts. The end of each bucket is counted down to its start.
    """
    found, by_second, start, second = (
        s.neighbors.found,
        s.neighbors.by_second,
        s.neighbors.start,
        s.neighbors.second,
    )
    clear(start)
    clear(second)
    k, slots = int(0), at(s.neighbors.slots, 0)
    while k < slots:
        pair = at(found, k)
        if pair[0] >= 0:
            add(start, pair[0], 1)
            add(second, pair[1], 1)
        k += 1
    prefix_sum(start, start)
    prefix_sum(second, second)
    while k > 0:
        k -= 1
        pair = at(found, k)
        if pair[0] >= 0:
            put(by_second, add(second, pair[1], -1) - 1, pair)
    k = int(at(s.neighbors.total, 0))
    while k > 0:
        k -= 1
        pair = at(by_second, k)
        put(s.neighbors.neighbor, add(start, pair[0], -1) - 1, pair[1])


@wp.func
def is_active(dv: wp.vec3d) -> bool:
    """Return whether a contact carries a correction now, at the start of the step, or before the last sweep.

    `dv` has these three corrections, as in `Correction.saved`.
    """
    return dv[0] != f64(0.0) or dv[1] != f64(0.0) or dv[2] != f64(0.0)


@wp.func
def keep_pair(s: Scene, i: int, j: int, k_old: int):
    """Repeat the search so that it finds pair (i, j) of the old list, if the pair carries a correction.

    k_old is the index of the pair in the old list. The skins of both grains are widened for the search.
    """
    if is_active(at(s.contacts.dv.saved, k_old)):
        half = f64(0.5) * wp.length(way(at(s.grains.position, i), at(s.grains.position, j), s.walls))
        raise_to(s.verlet.skin, i, half)
        raise_to(s.verlet.skin, j, half)
        s.control.phase = Phase.SEARCH


@wp.func
def match_rows(s: Scene, i: int):
    """Write to `old_index`, for each contact of grain i, the contact's index in the old list, or -1.

    Repeat the search if the new list lacks a pair of the old list that carries a correction.
    """
    rows = s.neighbors
    k_old, end_old = at(rows.old_start, i), at(rows.old_start, i + 1)
    k, end = at(rows.start, i), at(rows.start, i + 1)
    while k < end:
        j = at(rows.neighbor, k)
        while k_old < end_old and at(rows.old_neighbor, k_old) < j:
            keep_pair(s, i, at(rows.old_neighbor, k_old), k_old)
            k_old += 1
        k_found = int(-1)
        if k_old < end_old and at(rows.old_neighbor, k_old) == j:
            k_found = k_old
            k_old += 1
        put(s.neighbors.old_index, k, k_found)
        k += 1
    while k_old < end_old:
        keep_pair(s, i, at(rows.old_neighbor, k_old), k_old)
        k_old += 1


@wp.func
def transfer_warm_start(s: Scene, i: int):
    """Write the contacts of row i at their indices in the order of the sweep.

    Each has the corrections of the old list, or 0 if the old list did not hold the contact.
    """
    k, end = at(s.neighbors.start, i), at(s.neighbors.start, i + 1)
    while k < end:
        j = at(s.neighbors.neighbor, k)
        c = at(s.neighbors.sweep_index, k)
        k_old = at(s.neighbors.old_index, k)
        contact = Contact()
        contact.i = wp.uint32(2 * i)
        contact.j = wp.uint32(2 * j)
        put(s.contacts.contact, c, contact)
        restore(s.contacts.dv, k_old, c)
        restore(s.contacts.dvt, k_old, c)
        restore(s.contacts.dvr, k_old, c)
        if has_weights(s):
            find_weights(s, c, i, j)
        if has_rolling(s):
            find_roll_weights(s, c, i, j)
        k += 1


@wp.func
def find_weights(s: Scene, c: int, i: int, j: int):
    """Write `weights` and `rim_weights` of contact c between grain i and grain or wall j (eqs. 7 and 22)."""
    mass_i, mass_j = at(s.grains.contact_mass, i), f64(0.0)
    weight = wp.vec2d(f64(1.0), f64(0.0))
    if j < grain_count(s):
        mass_j = at(s.grains.contact_mass, j)
        weight = wp.vec2d(law.mass_share(mass_i, mass_j), law.mass_share(mass_j, mass_i))
    put(s.contacts.weights, c, weight)
    if has_friction(s):
        rim_i, rim_j = weight[0] * (f64(2.0) * mass_i / at(s.grains.rim_mass, i)), f64(0.0)
        if j < grain_count(s):
            rim_j = weight[1] * (f64(2.0) * mass_j / at(s.grains.rim_mass, j))
        put(s.contacts.rim_weights, c, wp.vec3d(f64(1.0) / (f64(1.0) + rim_i + rim_j), rim_i, rim_j))


@wp.func
def find_row_sums(s: Scene):
    """Find max_row_sum, the largest sum of a grain's mass shares over its contacts, for plain sweeps only.

    The share in a contact with a wall is 1.
    """
    if is_accelerated(s):
        return
    n, row_sum, largest = grain_count(s), s.neighbors.row_sum, f64(0.0)
    for i in range(n):
        put(row_sum, i, f64(0.0))
    for i in range(n):
        own = at(row_sum, i)  # sum over pairs with earlier grains
        k, end = at(s.neighbors.start, i), at(s.neighbors.start, i + 1)
        while k < end:
            j = at(s.neighbors.neighbor, k)
            weight = wp.vec2d(wp.where(j < n, f64(0.5), f64(1.0)), f64(0.5))
            if has_weights(s):
                weight = at(s.contacts.weights, at(s.neighbors.sweep_index, k))
            own = own + weight[0]
            if j < n:
                put(row_sum, j, at(row_sum, j) + weight[1])
            k += 1
        largest = wp.max(largest, own)
    if has_friction(s):
        largest = ROOT_TWO * largest  # tangential corrections may be as large as normal ones
    s.verlet.max_row_sum = largest
