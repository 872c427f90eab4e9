"""Gauss-Seidel: corrections contact by contact, in place, sweep after sweep (MODEL.md, eqs. 5 to 8).

With friction, a visit corrects the normal velocity and then, by eq. 23, the velocity at which the surfaces
slip. For discs the two depend on each other by Coulomb's bound alone, so one visit solves a contact exactly.

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
    named,
    normal_of,
    put,
    second_of,
)
from .contacts import contacts_of, is_wall_set, surface_of, wall_change
from .driven import correct_wall
from .friction import THIRD, rim_weights
from .record import Scene, has_weights, is_driven
from .stopping import end_iteration
from .threads import Team, partial_index, reduce_max, update_max
from .types import Vectors
from .verlet import add_unmonitored, least_monitored_correction, monitor

f64 = wp.float64
BLOCK = wp.constant(64)  # pairs that a thread corrects before it monitors the grains of large corrections
KEPT = wp.constant(2 * BLOCK + 8)  # velocities of a thread: two a pair, and a gap that no cache line bridges
NONE, ONE = wp.constant(wp.uint64(0)), wp.constant(wp.uint64(1))


@wp.func_native(
    checked("""
#if !defined(__CUDA_ARCH__)
    kept.data[k] = vi;
    kept.data[k + 1] = vj;
#endif
""")
)
def keep_velocities(kept: Vectors, k: int, vi: wp.vec2d, vj: wp.vec2d):
    """Keep the two velocities after a correction, because a later pair of the block may change them."""
    ...


@wp.func_native(
    checked("""
#if defined(__CUDA_ARCH__)
    return velocity.data[i];
#else
    return kept.data[k];
#endif
""")
)
def kept_velocity(kept: Vectors, k: int, velocity: Vectors, i: int) -> wp.vec2d:
    """Return a kept velocity. A GPU reads that of grain i: the pairs of a launch are one independent set."""
    ...


def sweeping_pairs(weighted: bool, friction: bool) -> wp.Function:
    """Return the function that corrects pairs a block at a time, in place, and monitors their grains.

    It takes `(scene, begin, end, k)`, keeps velocities from index k on, and returns the largest change of a
    correction.
    """

    @wp.func(inline=False)
    def correct_block(s: Scene, begin: int, end: int, k: int):
        """Correct a block of pairs. Returns the largest change, and bits of the large ones."""
        velocity = s.grains.next_velocity  # assigned one by one: a tuple is read again for every pair
        rim = s.grains.next_rim
        contact = s.contacts.contact
        dvs = s.contacts.dv
        dvts = s.contacts.dvt
        weights = s.contacts.weights
        rim_weights = s.contacts.rim_weights
        kept = s.partial.kept_velocity
        mu = f64(s.friction)
        large = least_monitored_correction(s)
        weight = wp.vec2d(f64(0.5), f64(0.5))
        rim_weight = wp.vec3d(THIRD, f64(1.0), f64(1.0))
        zeta, bits = f64(0.0), wp.uint64(0)
        c = int(begin)
        while c < end:
            i, j, n = first_of(contact, c), second_of(contact, c), normal_of(contact, c)
            if wp.static(weighted):
                weight = at(weights, c)
            vi, vj = at(velocity, i), at(velocity, j)
            dv_before = at(dvs, c)
            difference = vi - vj
            dv = law.normal_change(wp.dot(difference, n), dv_before, gap_rate_of(contact, c))
            push, change = dv * n, wp.abs(dv)
            if wp.static(friction):
                if wp.static(weighted):
                    rim_weight = at(rim_weights, c)
                ui, uj, dvt_before = at(rim, i), at(rim, j), at(dvts, c)
                vt = law.pair_slip(difference, n, ui, uj)
                dvt = law.tangential_change(rim_weight[0] * vt, dvt_before, mu * (dv_before + dv))
                push = push + dvt * law.tangent(n)
                put(rim, i, ui - dvt * rim_weight[1])
                put(rim, j, uj - dvt * rim_weight[2])
                put(dvts, c, dvt_before + dvt)
                change = larger(change, wp.abs(dvt))
            vi = vi - push * weight[0]
            vj = vj + push * weight[1]
            put(velocity, i, vi)
            put(velocity, j, vj)
            put(dvs, c, dv_before + dv)
            keep_velocities(kept, k + 2 * (c - begin), vi, vj)
            zeta = larger(zeta, change)
            bits = (bits << ONE) | wp.where(change > large, ONE, NONE)
            c += 1
        return zeta, bits

    @wp.func
    def sweep_pairs(s: Scene, begin: int, end: int, k: int) -> f64:
        zeta = f64(0.0)
        c = int(begin)
        while c < end:
            stop = wp.min(c + BLOCK, end)
            change, bits = correct_block(s, c, stop, k)
            zeta = larger(zeta, change)
            monitor_block(s, c, stop, k, bits)
            c = stop
        return zeta

    return sweep_pairs


@wp.func
def monitor_block(s: Scene, begin: int, end: int, k: int, bits: wp.uint64):
    """Monitor both grains of the pairs of a block that have a bit."""
    velocity, contact, kept = s.grains.next_velocity, s.contacts.contact, s.partial.kept_velocity
    left = bits
    while left != NONE:
        c = end - 1 - lowest_bit(left)
        left = left & (left - ONE)
        i, j = first_of(contact, c), second_of(contact, c)
        place = k + 2 * (c - begin)
        monitor(s, i, kept_velocity(kept, place, velocity, i))
        monitor(s, j, kept_velocity(kept, place + 1, velocity, j))


@wp.func
def correct_driven_wall(s: Scene, c: int, dv_before: f64) -> wp.vec2d:
    """Correct the speed of the wall of a contact, and monitor it.

    Returns the change of dv, by which the grain is still to be corrected, and that of vn [m/s] (eq. 29).
    """
    velocity, contact = s.grains.next_velocity, s.contacts.contact
    i, j, n = first_of(contact, c), second_of(contact, c), normal_of(contact, c)
    found = correct_wall(s, velocity, i, j, n, dv_before, gap_rate_of(contact, c), f64(1.0))
    change = found[1] * wp.abs(found[0])
    if change > f64(0.0):
        monitor(s, j, at(velocity, j))  # its changes add up: it has more contacts than a grain
    return wp.vec2d(found[0], change)


def sweeping_walls(driven: bool, friction: bool) -> wp.Function:
    """Return the function that corrects contacts with walls, in place, and monitors their grains.

    It returns the largest change. `driven`: a force drives one of the walls (eq. 29).
    """

    @wp.func(inline=not driven)
    def sweep_walls(s: Scene, begin: int, end: int) -> f64:
        velocity = s.grains.next_velocity
        rim = s.grains.next_rim
        contacts = s.contacts
        large = least_monitored_correction(s)
        zeta = f64(0.0)
        c = int(begin)
        while c < end:
            i, n = first_of(contacts.contact, c), normal_of(contacts.contact, c)
            v = at(velocity, i)
            dv_before = at(contacts.dv, c)
            if wp.static(driven):
                found = correct_driven_wall(s, c, dv_before)
                dv, change = found[0], found[1]
            else:
                dv = wall_change(contacts, c, v, dv_before)
                change = wp.abs(dv)
            push = dv * n
            if wp.static(friction):
                surface, rim_weight = surface_of(s, c), rim_weights(s, c, True)
                u, dvt_before = at(rim, i), at(contacts.dvt, c)
                vt = law.wall_slip(v, n, u, surface[1])
                dvt = law.tangential_change(rim_weight[0] * vt, dvt_before, surface[0] * (dv_before + dv))
                push = push + dvt * law.tangent(n)
                put(rim, i, u - dvt * rim_weight[1])
                put(contacts.dvt, c, dvt_before + dvt)
                change = larger(change, wp.abs(dvt))
            put(velocity, i, v - push)
            put(contacts.dv, c, dv_before + dv)
            zeta = larger(zeta, change)
            if change > large:
                monitor(s, i, at(velocity, i))
            c += 1
        return zeta

    return sweep_walls


def plain_sweep(friction: bool) -> wp.Function:
    """Return the stage that corrects the contacts of a set."""
    sweep_equal, sweep_weighted = sweeping_pairs(False, friction), sweeping_pairs(True, friction)
    sweep_walls, sweep_driven_walls = sweeping_walls(False, friction), sweeping_walls(True, friction)

    @named(f"sweep{'_with_friction' * friction}")
    def sweep_set(team: Team, s: Scene, k: int):
        zeta = f64(0.0)
        first_kept = KEPT * partial_index(team, s.partial.zeta.shape[0])
        begin, end = contacts_of(team, s, k)
        if is_wall_set(s, k) and is_driven(s):
            zeta = sweep_driven_walls(s, begin, end)
        elif is_wall_set(s, k):
            zeta = sweep_walls(s, begin, end)
        elif has_weights(s):
            zeta = sweep_weighted(s, begin, end, first_kept)
        else:
            zeta = sweep_equal(s, begin, end, first_kept)
        update_max(team, s.partial.zeta, zeta)

    return sweep_set


sweep, sweep_with_friction = plain_sweep(False), plain_sweep(True)


@wp.func
def end_sweep(s: Scene):
    """Count a sweep, and choose what follows."""
    end_iteration(s, reduce_max(s.partial.zeta))
    add_unmonitored(s)
