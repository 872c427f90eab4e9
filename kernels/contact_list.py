"""A list made anew: the old one set aside, and its corrections carried over (warm-start transfer)."""

import warp as wp

from . import law
from .access import (
    integer_at,
    number_at,
    set_grains,
    set_integer,
    set_number,
    set_triple,
    triple_at,
    vector_at,
)
from .neighbors import is_active
from .record import WITHOUT_ROOM, Scene, amid_sweeps, grain_count, is_accelerated
from .verlet import stayed_silent

f64 = wp.float64


@wp.func
def save_row(s: Scene, i: int):
    """Keep where a grain's pairs are; no wall is kept yet."""
    set_integer(s.workspace.old.start, i, integer_at(s.neighbors.start, i))
    set_triple(s.workspace.old_wall_dv, i, wp.vec3d(f64(0.0), f64(0.0), f64(0.0)))
    set_integer(s.workspace.was_at_wall, i, 0)


@wp.func
def save_pair(s: Scene, k: int):
    """Keep the pair at place k of the list, and the corrections of the one at place k in sweeping order."""
    last = f64(0.0)
    if is_accelerated(s):
        last = number_at(s.momentum.pair_last, k)
    dv = wp.vec3d(number_at(s.contacts.pair_dv, k), number_at(s.contacts.pair_dv_start, k), last)
    set_triple(s.workspace.old_pair_dv, k, dv)
    set_integer(s.workspace.old.neighbor, k, integer_at(s.neighbors.neighbor, k))
    set_integer(s.workspace.old_color, k, integer_at(s.workspace.color, k))
    set_integer(s.workspace.old_index, k, integer_at(s.workspace.sweep_index, k))
    set_integer(s.workspace.old_place, k, k)


@wp.func
def save_wall(s: Scene, c: int):
    """Keep a wall's corrections, by grain."""
    i = s.contacts.walls[c].i
    dv = wp.vec3d(s.contacts.walls[c].dv, s.contacts.wall_dv_start[c], f64(0.0))
    if is_accelerated(s):
        dv[2] = s.momentum.wall_last[c]
    s.workspace.old_wall_dv[i] = dv
    s.workspace.was_at_wall[i] = 1


@wp.func
def expire(s: Scene):
    """Ask for a new list, in the same step; iterations that were begun go on with it."""
    n = grain_count(s)
    s.workspace.old.start[n] = s.neighbors.start[n]
    s.step.rebuilds = s.step.rebuilds + 1
    s.control.resuming = 1 if s.step.iterations > 0 else 0
    s.control.unlisted = 1
    s.verlet.flags.missed = 0


@wp.func
def color_anew(s: Scene):
    """Ask for the sweeping order that the list alone tells, before the next step."""
    n = grain_count(s)
    s.workspace.old.start[n] = s.neighbors.start[n]
    s.control.recoloring = 0
    s.control.unordered = 1


@wp.func
def begin_list(s: Scene):
    """Search, at least once."""
    s.control.searching = 1


@wp.func
def keep_pair(s: Scene, i: int, j: int, k_old: int):
    """A pair that carries a correction must stay listed: where it is lost, widen its skins, search again."""
    if is_active(triple_at(s.workspace.old_pair_dv, integer_at(s.workspace.old_index, k_old))):
        half = f64(0.5) * wp.length(s.grains.position[j] - s.grains.position[i])
        wp.atomic_max(s.verlet.skin, i, half)
        wp.atomic_max(s.verlet.skin, j, half)
        s.control.searching = 1


@wp.func
def match_rows(s: Scene, i: int):
    """Find a grain's pairs in the list before, and those of that list that are lost."""
    rows, old = s.neighbors, s.workspace.old
    k_old, end_old = integer_at(old.start, i), integer_at(old.start, i + 1)
    k, end = integer_at(rows.start, i), integer_at(rows.start, i + 1)
    while k < end:
        j = integer_at(rows.neighbor, k)
        while k_old < end_old and integer_at(old.neighbor, k_old) < j:
            keep_pair(s, i, integer_at(old.neighbor, k_old), k_old)
            k_old += 1
        place = int(-1)
        if k_old < end_old and integer_at(old.neighbor, k_old) == j:
            place = k_old
            k_old += 1
        set_integer(s.workspace.old_place, k, place)
        k += 1
    while k_old < end_old:
        keep_pair(s, i, integer_at(old.neighbor, k_old), k_old)
        k_old += 1


@wp.func
def end_list(s: Scene):
    """Go on with the pairs found, or leave the step until there is room for them."""
    s.control.unlisted = 1 - s.control.roomy
    s.control.unordered = s.control.roomy
    if s.control.roomy == 0:
        s.step.outcome = WITHOUT_ROOM
        s.control.unsolved = 0


@wp.func
def transfer_warm_start(s: Scene, i: int):
    """Write a grain's pairs where they are swept, with the corrections of the old list, or zero."""
    k, end = integer_at(s.neighbors.start, i), integer_at(s.neighbors.start, i + 1)
    while k < end:
        j = integer_at(s.neighbors.neighbor, k)
        c = integer_at(s.workspace.sweep_index, k)
        k_old = integer_at(s.workspace.old_place, k)
        dv = wp.vec3d(f64(0.0), f64(0.0), f64(0.0))
        if k_old >= 0:
            dv = triple_at(s.workspace.old_pair_dv, integer_at(s.workspace.old_index, k_old))
        elif amid_sweeps(s) and not stayed_silent(s, i, j):
            s.verlet.flags.missed = 1
        set_grains(s.contacts.pairs, c, i, j)
        set_number(s.contacts.pair_dv, c, dv[0])
        set_number(s.contacts.pair_dv_start, c, dv[1])
        if is_accelerated(s):
            set_number(s.momentum.pair_last, c, dv[2])
        if s.contacts.weights.shape[0] > 0:
            mass_i = s.grains.contact_mass[i]
            mass_j = s.grains.contact_mass[j]
            s.contacts.weights[c] = wp.vec2d(law.mass_share(mass_i, mass_j), law.mass_share(mass_j, mass_i))
        k += 1


@wp.func
def find_row_sums(s: Scene):
    """The largest sum of a grain's shares of its contacts, one for the walls included, if it is monitored."""
    if is_accelerated(s):
        return
    n = grain_count(s)
    row_sum = s.workspace.row_sum
    for i in range(n):
        set_number(row_sum, i, f64(0.0))
    for i in range(n):
        own = number_at(row_sum, i)
        k, end = integer_at(s.neighbors.start, i), integer_at(s.neighbors.start, i + 1)
        while k < end:
            j = integer_at(s.neighbors.neighbor, k)
            weight = wp.vec2d(f64(0.5), f64(0.5))
            if s.contacts.weights.shape[0] > 0:
                weight = vector_at(s.contacts.weights, integer_at(s.workspace.sweep_index, k))
            own = own + weight[0]
            set_number(row_sum, j, number_at(row_sum, j) + weight[1])
            k += 1
        set_number(row_sum, i, own)
    largest = f64(0.0)
    for i in range(n):
        largest = wp.max(largest, number_at(row_sum, i) + f64(1.0))
    s.verlet.numbers.max_row_sum = largest
