"""Gauss-Seidel: corrections contact by contact, in place, sweep after sweep (MODEL.md, eqs. 5 to 8).

Grains are monitored where a correction is large (verlet.py), a block of pairs at a time: whether a correction
is large cannot be foreseen, and to find it out pair by pair costs a processor as much as the correction.
"""

import warp as wp

from . import law
from .access import (
    at,
    checked,
    first_of,
    gap_rate_of,
    larger,
    lowest_bit,
    normal_of,
    put,
    read_wall,
    second_of,
    set_wall_dv,
)
from .record import Scene, wall_count
from .segments import pairs_of
from .stopping import decide_to_stop, gathered
from .threads import BLOCK, MOMENTS, Team, keep_largest, partial_index, thread_range
from .types import Contacts, Vectors
from .verlet import add_unmonitored, least_monitored_correction, monitor
from .walls import WallContact, has_inner, outer_gap_rate, wall_projection

f64 = wp.float64
NONE, ONE = wp.constant(wp.uint64(0)), wp.constant(wp.uint64(1))


@wp.func_native(
    checked("""
#if !defined(__CUDA_ARCH__)
    moments.data[k] = vi;
    moments.data[k + 1] = vj;
#endif
""")
)
def note_moment(moments: Vectors, k: int, vi: wp.vec2d, vj: wp.vec2d):
    """Keep what a correction has made of two velocities: another of its block may change them again."""
    ...


@wp.func_native(
    checked("""
#if defined(__CUDA_ARCH__)
    return velocity.data[i];
#else
    return moments.data[k];
#endif
""")
)
def moment_at(moments: Vectors, k: int, velocity: Vectors, i: int) -> wp.vec2d:
    """Read one of them. On a GPU it is the velocity of i still: all pairs of a launch are of one set."""
    ...


@wp.func
def correct_pair(
    velocity: Vectors, contacts: Contacts, c: int, weight: wp.vec2d, moments: Vectors, k: int
) -> f64:
    """One pair's correction, in place; its grains take these shares of it. Returns |dv|."""
    i = first_of(contacts.pairs, c)
    j = second_of(contacts.pairs, c)
    n = normal_of(contacts.pairs, c)
    vi = at(velocity, i)
    vj = at(velocity, j)
    vn = wp.dot(vi - vj, n)
    dv_before = at(contacts.pair_dv, c)
    dv = law.pair_correction(vn, dv_before, gap_rate_of(contacts.pairs, c))
    vi = vi - dv * n * weight[0]
    vj = vj + dv * n * weight[1]
    put(velocity, i, vi)
    put(velocity, j, vj)
    put(contacts.pair_dv, c, dv_before + dv)
    note_moment(moments, k, vi, vj)
    return wp.abs(dv)


@wp.func
def correct_wall(velocity: Vectors, contacts: Contacts, c: int, wall: WallContact, inner: bool) -> f64:
    """One grain's wall correction, in place. Returns |dv|."""
    v = at(velocity, wall.i)
    vn = wp.dot(v, wall.n)
    dv = wall_projection(vn, wall.dv, wall.gap_rate_out, wall.gap_rate_in, inner) - wall.dv
    put(velocity, wall.i, v - dv * wall.n)
    set_wall_dv(contacts.walls, c, wall.dv + dv)
    return wp.abs(dv)


@wp.func(inline=False)
def correct_block(s: Scene, begin: int, end: int, k: int):
    """Correct a block, its moments from place k on. Returns the largest |dv|, and bits of the large ones."""
    velocity = s.grains.next_velocity
    contacts = s.contacts
    moments = s.partial.moments
    large = least_monitored_correction(s)
    zeta, bits = f64(0.0), wp.uint64(0)
    c = int(begin)
    if contacts.weights.shape[0] > 0:
        while c < end:
            weight = at(contacts.weights, c)
            change = correct_pair(velocity, contacts, c, weight, moments, k + 2 * (c - begin))
            zeta = larger(zeta, change)
            bits = (bits << ONE) | wp.where(change > large, ONE, NONE)
            c += 1
    else:
        equal = wp.vec2d(f64(0.5), f64(0.5))
        while c < end:
            change = correct_pair(velocity, contacts, c, equal, moments, k + 2 * (c - begin))
            zeta = larger(zeta, change)
            bits = (bits << ONE) | wp.where(change > large, ONE, NONE)
            c += 1
    return zeta, bits


@wp.func
def monitor_block(s: Scene, begin: int, end: int, k: int, bits: wp.uint64):
    """Monitor both grains of the pairs of a block that have a bit."""
    velocity, pairs, moments = s.grains.next_velocity, s.contacts.pairs, s.partial.moments
    left = bits
    while left != NONE:
        c = end - 1 - lowest_bit(left)
        left = left & (left - ONE)
        i, j = first_of(pairs, c), second_of(pairs, c)
        moment = k + 2 * (c - begin)
        monitor(s, i, moment_at(moments, moment, velocity, i))
        monitor(s, j, moment_at(moments, moment + 1, velocity, j))


@wp.func
def sweep_pairs(team: Team, s: Scene, k: int):
    """Correct the pairs of a set."""
    zeta = f64(0.0)
    moment = MOMENTS * partial_index(team, s.partial.zeta.shape[0])
    begin, end = pairs_of(team, s, k)
    while begin < end:
        stop = wp.min(begin + BLOCK, end)
        change, bits = correct_block(s, begin, stop, moment)
        zeta = larger(zeta, change)
        monitor_block(s, begin, stop, moment, bits)
        begin = stop
    keep_largest(team, s.partial.zeta, zeta)


@wp.func
def sweep_walls(team: Team, s: Scene):
    """Correct the grains that may reach a wall."""
    zeta = f64(0.0)
    velocity = s.grains.next_velocity
    contacts = s.contacts
    inner = has_inner(s.walls)
    begin, end = thread_range(team, 0, wall_count(s))
    wall = WallContact()
    large = least_monitored_correction(s)
    c = begin
    while c < end:
        read_wall(contacts.walls, c, wall)
        wall.gap_rate_out = outer_gap_rate(wall, at(velocity, wall.i), s.walls)
        change = correct_wall(velocity, contacts, c, wall, inner)
        zeta = larger(zeta, change)
        if change > large:
            monitor(s, wall.i, at(velocity, wall.i))
        c += 1
    keep_largest(team, s.partial.zeta, zeta)


@wp.func
def decide(s: Scene):
    """What follows on a sweep."""
    decide_to_stop(s, gathered(s.partial.zeta))
    add_unmonitored(s)
