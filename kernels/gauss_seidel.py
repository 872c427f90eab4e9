"""Gauss-Seidel: corrections contact by contact, in place, sweep after sweep (MODEL.md, eqs. 5 to 8)."""

import warp as wp

from . import law
from .access import (
    dv_of,
    first_of,
    gap_rate_of,
    grain_of,
    inner_gap_rate_of,
    normal_of,
    outer_gap_rate_of,
    second_of,
    set_dv,
    set_velocity,
    set_wall_dv,
    velocity_of,
    wall_dv_of,
    wall_normal_of,
    weight_of,
)
from .segments import pairs_of, walls_of
from .stopping import decide_to_stop
from .threads import Team, partial_index
from .types import Contacts, Scene, Vectors
from .verlet import monitor, monitor_next
from .walls import has_inner, wall_projection

f64 = wp.float64


@wp.func
def weights_of(contacts: Contacts, c: int) -> wp.vec2d:
    """Parts of a pair's correction that its grains take."""
    if contacts.weights.shape[0] > 0:
        return weight_of(contacts.weights, c)
    return wp.vec2d(f64(0.5), f64(0.5))


@wp.func
def correct_pair(velocity: Vectors, contacts: Contacts, c: int) -> f64:
    """One pair's correction, in place. Returns |dv|."""
    i = first_of(contacts.pairs, c)
    j = second_of(contacts.pairs, c)
    n = normal_of(contacts.pairs, c)
    weight = weights_of(contacts, c)
    vi = velocity_of(velocity, i)
    vj = velocity_of(velocity, j)
    vn = wp.dot(vi - vj, n)
    dv_before = dv_of(contacts.pair_dv, c)
    dv = law.pair_correction(vn, dv_before, gap_rate_of(contacts.pairs, c))
    set_velocity(velocity, i, vi - dv * n * weight[0])
    set_velocity(velocity, j, vj + dv * n * weight[1])
    set_dv(contacts.pair_dv, c, dv_before + dv)
    return wp.abs(dv)


@wp.func
def correct_wall(velocity: Vectors, contacts: Contacts, c: int, inner: bool) -> f64:
    """One grain's wall correction, in place. Returns |dv|."""
    i = grain_of(contacts.walls, c)
    n = wall_normal_of(contacts.walls, c)
    v = velocity_of(velocity, i)
    vn = wp.dot(v, n)
    dv_before = wall_dv_of(contacts.walls, c)
    gap_rate_out = outer_gap_rate_of(contacts.walls, c)
    gap_rate_in = inner_gap_rate_of(contacts.walls, c)
    dv = wall_projection(vn, dv_before, gap_rate_out, gap_rate_in, inner) - dv_before
    set_velocity(velocity, i, v - dv * n)
    set_wall_dv(contacts.walls, c, dv_before + dv)
    return wp.abs(dv)


@wp.func
def sweep_pairs(team: Team, s: Scene, k: int):
    """Correct the pairs of a set."""
    zeta = f64(0.0)
    velocity = s.grains.next_velocity
    contacts = s.contacts
    begin, end = pairs_of(team, s, k)
    if s.verlet.flags.monitored == 0:
        c = begin
        while c < end:
            zeta = wp.max(zeta, correct_pair(velocity, contacts, c))
            c += 1
    else:
        for c in range(begin, end):
            change = correct_pair(velocity, contacts, c)
            if change > f64(0.0):
                zeta = wp.max(zeta, change)
                monitor(s, first_of(contacts.pairs, c))
                monitor(s, second_of(contacts.pairs, c))
    wp.atomic_max(s.partial.zeta, partial_index(team, s.partial.zeta.shape[0]), zeta)


@wp.func
def sweep_walls(team: Team, s: Scene):
    """Correct the grains that may reach a wall."""
    zeta = f64(0.0)
    velocity = s.grains.next_velocity
    contacts = s.contacts
    inner = has_inner(s.walls)
    begin, end = walls_of(team, s)
    c = begin
    while c < end:
        zeta = wp.max(zeta, correct_wall(velocity, contacts, c, inner))
        c += 1
    if s.verlet.flags.monitored != 0:
        for k in range(begin, end):
            monitor(s, grain_of(contacts.walls, k))
    wp.atomic_max(s.partial.zeta, partial_index(team, s.partial.zeta.shape[0]), zeta)


@wp.func
def decide(s: Scene):
    """What follows on a sweep."""
    decide_to_stop(s)
    monitor_next(s, s.verlet.numbers.max_row_sum * s.step.zeta)
