"""A list made anew: the old one set aside, and its corrections carried over (warm-start transfer)."""

import warp as wp

from . import law
from .access import at, put, raise_to, read_wall, set_grains
from .neighbors import is_active
from .record import WITHOUT_ROOM, Scene, amid_sweeps, grain_count, is_accelerated
from .verlet import stayed_silent
from .walls import WallContact

f64 = wp.float64


@wp.func
def save_row(s: Scene, i: int):
    """Keep where a grain's pairs are; no wall is kept yet."""
    put(s.workspace.old.start, i, at(s.neighbors.start, i))
    put(s.workspace.old_wall_dv, i, wp.vec3d(f64(0.0), f64(0.0), f64(0.0)))
    put(s.workspace.was_at_wall, i, 0)


@wp.func
def save_pair(s: Scene, k: int):
    """Keep the pair at place k of the list, and the corrections of the one at place k in sweeping order."""
    last = f64(0.0)
    if is_accelerated(s):
        last = at(s.momentum.pair_last, k)
    dv = wp.vec3d(at(s.contacts.pair_dv, k), at(s.contacts.pair_dv_start, k), last)
    put(s.workspace.old_pair_dv, k, dv)
    put(s.workspace.old.neighbor, k, at(s.neighbors.neighbor, k))
    put(s.workspace.old_color, k, at(s.workspace.color, k))
    put(s.workspace.old_index, k, at(s.workspace.sweep_index, k))
    put(s.workspace.old_place, k, k)


@wp.func
def save_wall(s: Scene, c: int):
    """Keep a wall's corrections, by grain."""
    wall = WallContact()
    read_wall(s.contacts.walls, c, wall)
    dv = wp.vec3d(wall.dv, at(s.contacts.wall_dv_start, c), f64(0.0))
    if is_accelerated(s):
        dv[2] = at(s.momentum.wall_last, c)
    put(s.workspace.old_wall_dv, wall.i, dv)
    put(s.workspace.was_at_wall, wall.i, 1)


@wp.func
def expire(s: Scene):
    """Ask for a new list, in the same step; iterations that were begun go on with it."""
    n = grain_count(s)
    put(s.workspace.old.start, n, at(s.neighbors.start, n))
    s.step.rebuilds = s.step.rebuilds + 1
    s.control.resuming = 1 if s.step.iterations > 0 else 0
    s.control.unlisted = 1
    s.verlet.flags.missed = 0


@wp.func
def color_anew(s: Scene):
    """Ask for the sweeping order that the list alone tells, before the next step."""
    n = grain_count(s)
    put(s.workspace.old.start, n, at(s.neighbors.start, n))
    s.control.recoloring = 0
    s.control.unordered = 1


@wp.func
def begin_list(s: Scene):
    """Search, at least once."""
    s.control.searching = 1


@wp.func
def keep_pair(s: Scene, i: int, j: int, k_old: int):
    """A pair that carries a correction must stay listed: where it is lost, widen its skins, search again."""
    if is_active(at(s.workspace.old_pair_dv, at(s.workspace.old_index, k_old))):
        half = f64(0.5) * wp.length(at(s.grains.position, j) - at(s.grains.position, i))
        raise_to(s.verlet.skin, i, half)
        raise_to(s.verlet.skin, j, half)
        s.control.searching = 1


@wp.func
def match_rows(s: Scene, i: int):
    """Find a grain's pairs in the list before, and those of that list that are lost."""
    rows, old = s.neighbors, s.workspace.old
    k_old, end_old = at(old.start, i), at(old.start, i + 1)
    k, end = at(rows.start, i), at(rows.start, i + 1)
    while k < end:
        j = at(rows.neighbor, k)
        while k_old < end_old and at(old.neighbor, k_old) < j:
            keep_pair(s, i, at(old.neighbor, k_old), k_old)
            k_old += 1
        place = int(-1)
        if k_old < end_old and at(old.neighbor, k_old) == j:
            place = k_old
            k_old += 1
        put(s.workspace.old_place, k, place)
        k += 1
    while k_old < end_old:
        keep_pair(s, i, at(old.neighbor, k_old), k_old)
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
    k, end = at(s.neighbors.start, i), at(s.neighbors.start, i + 1)
    while k < end:
        j = at(s.neighbors.neighbor, k)
        c = at(s.workspace.sweep_index, k)
        k_old = at(s.workspace.old_place, k)
        dv = wp.vec3d(f64(0.0), f64(0.0), f64(0.0))
        if k_old >= 0:
            dv = at(s.workspace.old_pair_dv, at(s.workspace.old_index, k_old))
        elif amid_sweeps(s) and not stayed_silent(s, i, j):
            s.verlet.flags.missed = 1
        set_grains(s.contacts.pairs, c, i, j)
        put(s.contacts.pair_dv, c, dv[0])
        put(s.contacts.pair_dv_start, c, dv[1])
        if is_accelerated(s):
            put(s.momentum.pair_last, c, dv[2])
        if s.contacts.weights.shape[0] > 0:
            mass_i = at(s.grains.contact_mass, i)
            mass_j = at(s.grains.contact_mass, j)
            shares = wp.vec2d(law.mass_share(mass_i, mass_j), law.mass_share(mass_j, mass_i))
            put(s.contacts.weights, c, shares)
        k += 1


@wp.func
def find_row_sums(s: Scene):
    """The largest sum of a grain's shares of its contacts, one for the walls included, if it is monitored."""
    if is_accelerated(s):
        return
    n = grain_count(s)
    row_sum = s.workspace.row_sum
    for i in range(n):
        put(row_sum, i, f64(0.0))
    for i in range(n):
        own = at(row_sum, i)
        k, end = at(s.neighbors.start, i), at(s.neighbors.start, i + 1)
        while k < end:
            j = at(s.neighbors.neighbor, k)
            weight = wp.vec2d(f64(0.5), f64(0.5))
            if s.contacts.weights.shape[0] > 0:
                weight = at(s.contacts.weights, at(s.workspace.sweep_index, k))
            own = own + weight[0]
            put(row_sum, j, at(row_sum, j) + weight[1])
            k += 1
        put(row_sum, i, own)
    largest = f64(0.0)
    for i in range(n):
        largest = wp.max(largest, at(row_sum, i) + f64(1.0))
    s.verlet.numbers.max_row_sum = largest
