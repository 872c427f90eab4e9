"""Gauss-Seidel: corrections contact by contact, in place, sweep after sweep (MODEL.md, eqs. 5 to 8)."""

import warp as wp

from . import law
from .access import (
    first_of,
    gap_rate_of,
    larger,
    normal_of,
    number_at,
    read_wall,
    second_of,
    set_number,
    set_vector,
    set_wall_dv,
    vector_at,
)
from .record import Scene
from .segments import pairs_of, walls_of
from .stopping import decide_to_stop, gathered
from .threads import Team, partial_index
from .types import Contacts, Vectors
from .verlet import add_unmonitored, least_monitored_correction, monitor, monitor_pair
from .walls import WallContact, has_inner, outer_gap_rate, wall_projection

f64 = wp.float64


@wp.func
def correct_pair(velocity: Vectors, contacts: Contacts, c: int, weight: wp.vec2d) -> f64:
    """One pair's correction, in place; its grains take these shares of it. Returns |dv|."""
    i = first_of(contacts.pairs, c)
    j = second_of(contacts.pairs, c)
    n = normal_of(contacts.pairs, c)
    vi = vector_at(velocity, i)
    vj = vector_at(velocity, j)
    vn = wp.dot(vi - vj, n)
    dv_before = number_at(contacts.pair_dv, c)
    dv = law.pair_correction(vn, dv_before, gap_rate_of(contacts.pairs, c))
    set_vector(velocity, i, vi - dv * n * weight[0])
    set_vector(velocity, j, vj + dv * n * weight[1])
    set_number(contacts.pair_dv, c, dv_before + dv)
    return wp.abs(dv)


@wp.func
def correct_wall(velocity: Vectors, contacts: Contacts, c: int, wall: WallContact, inner: bool) -> f64:
    """One grain's wall correction, in place. Returns |dv|."""
    v = vector_at(velocity, wall.i)
    vn = wp.dot(v, wall.n)
    dv = wall_projection(vn, wall.dv, wall.gap_rate_out, wall.gap_rate_in, inner) - wall.dv
    set_vector(velocity, wall.i, v - dv * wall.n)
    set_wall_dv(contacts.walls, c, wall.dv + dv)
    return wp.abs(dv)


@wp.func
def sweep_pairs(team: Team, s: Scene, k: int):
    """Correct the pairs of a set."""
    zeta = f64(0.0)
    velocity = s.grains.next_velocity
    contacts = s.contacts
    begin, end = pairs_of(team, s, k)
    large = least_monitored_correction(s)
    equal = wp.vec2d(f64(0.5), f64(0.5))
    c = begin
    if contacts.weights.shape[0] > 0:
        while c < end:
            change = correct_pair(velocity, contacts, c, vector_at(contacts.weights, c))
            zeta = larger(zeta, change)
            if change > large:
                monitor_pair(s, contacts.pairs[c])
            c += 1
    else:
        while c < end:
            change = correct_pair(velocity, contacts, c, equal)
            zeta = larger(zeta, change)
            if change > large:
                monitor_pair(s, contacts.pairs[c])
            c += 1
    wp.atomic_max(s.partial.zeta, partial_index(team, s.partial.zeta.shape[0]), zeta)


@wp.func
def sweep_walls(team: Team, s: Scene):
    """Correct the grains that may reach a wall."""
    zeta = f64(0.0)
    velocity = s.grains.next_velocity
    contacts = s.contacts
    inner = has_inner(s.walls)
    begin, end = walls_of(team, s)
    wall = WallContact()
    large = least_monitored_correction(s)
    c = begin
    while c < end:
        read_wall(contacts.walls, c, wall)
        wall.gap_rate_out = outer_gap_rate(wall, vector_at(velocity, wall.i), s.walls)
        change = correct_wall(velocity, contacts, c, wall, inner)
        zeta = larger(zeta, change)
        if change > large:
            monitor(s, wall.i, f64(0.0))
        c += 1
    wp.atomic_max(s.partial.zeta, partial_index(team, s.partial.zeta.shape[0]), zeta)


@wp.func
def decide(s: Scene):
    """What follows on a sweep."""
    decide_to_stop(s, gathered(s.partial.zeta))
    add_unmonitored(s)
