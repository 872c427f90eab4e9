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
    second_of,
)
from .contacts import back_rate_of, gap_rate_now, is_wall_set
from .record import Scene
from .segments import contacts_of
from .stopping import decide_to_stop, gathered
from .threads import BLOCK, MOMENTS, Team, keep_largest, partial_index
from .types import Vectors
from .verlet import add_unmonitored, least_monitored_correction, monitor

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


def sweeping(weighted: bool, at_wall: bool) -> wp.Function:
    """Return the function that corrects contacts, in place, and monitors their grains.

    It takes `(scene, begin, end, k)`, moments from place k on, and returns the largest |dv|.
    """

    @wp.func
    def correct(s: Scene, c: int, k: int) -> f64:
        """Correct one contact; its grains take their shares of it. Returns |dv|."""
        velocity, contacts = s.grains.next_velocity, s.contacts
        i = first_of(contacts.contact, c)
        n = normal_of(contacts.contact, c)
        vi = at(velocity, i)
        dv_before = at(contacts.dv, c)
        dv = f64(0.0)
        if wp.static(at_wall):
            projected = law.projection(wp.dot(vi, n), dv_before, gap_rate_now(s, c, vi), back_rate_of(s, c))
            dv = projected - dv_before
            vi = vi - dv * n
            note_moment(s.partial.moments, k, vi, vi)
        else:
            j = second_of(contacts.contact, c)
            weight = wp.vec2d(f64(0.5), f64(0.5))
            if wp.static(weighted):
                weight = at(contacts.weights, c)
            vj = at(velocity, j)
            dv = law.pair_correction(wp.dot(vi - vj, n), dv_before, gap_rate_of(contacts.contact, c))
            vi = vi - dv * n * weight[0]
            vj = vj + dv * n * weight[1]
            put(velocity, j, vj)
            note_moment(s.partial.moments, k, vi, vj)
        put(velocity, i, vi)
        put(contacts.dv, c, dv_before + dv)
        return wp.abs(dv)

    @wp.func(inline=False)
    def correct_block(s: Scene, begin: int, end: int, k: int):
        """Correct a block of contacts. Returns the largest |dv|, and bits of the large ones."""
        large = least_monitored_correction(s)
        zeta, bits = f64(0.0), wp.uint64(0)
        c = int(begin)
        while c < end:
            change = correct(s, c, k + 2 * (c - begin))
            zeta = larger(zeta, change)
            bits = (bits << ONE) | wp.where(change > large, ONE, NONE)
            c += 1
        return zeta, bits

    @wp.func
    def monitor_block(s: Scene, begin: int, end: int, k: int, bits: wp.uint64):
        """Monitor the grains of the contacts of a block that have a bit."""
        velocity, contact, moments = s.grains.next_velocity, s.contacts.contact, s.partial.moments
        left = bits
        while left != NONE:
            c = end - 1 - lowest_bit(left)
            left = left & (left - ONE)
            moment = k + 2 * (c - begin)
            i = first_of(contact, c)
            monitor(s, i, moment_at(moments, moment, velocity, i))
            if wp.static(not at_wall):
                j = second_of(contact, c)
                monitor(s, j, moment_at(moments, moment + 1, velocity, j))

    @wp.func
    def sweep_blocks(s: Scene, begin: int, end: int, k: int) -> f64:
        zeta = f64(0.0)
        c = int(begin)
        while c < end:
            stop = wp.min(c + BLOCK, end)
            change, bits = correct_block(s, c, stop, k)
            zeta = larger(zeta, change)
            monitor_block(s, c, stop, k, bits)
            c = stop
        return zeta

    return sweep_blocks


sweep_equal, sweep_weighted, sweep_walls = (
    sweeping(False, False),
    sweeping(True, False),
    sweeping(False, True),
)


@wp.func
def sweep(team: Team, s: Scene, k: int):
    """Correct the contacts of a set."""
    zeta = f64(0.0)
    moment = MOMENTS * partial_index(team, s.partial.zeta.shape[0])
    begin, end = contacts_of(team, s, k)
    if is_wall_set(s, k):
        zeta = sweep_walls(s, begin, end, moment)
    elif s.contacts.weights.shape[0] > 0:
        zeta = sweep_weighted(s, begin, end, moment)
    else:
        zeta = sweep_equal(s, begin, end, moment)
    keep_largest(team, s.partial.zeta, zeta)


@wp.func
def decide(s: Scene):
    """What follows on a sweep."""
    decide_to_stop(s, gathered(s.partial.zeta))
    add_unmonitored(s)
