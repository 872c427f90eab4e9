"""Coulomb friction and rotation (MODEL.md, eqs. 21 to 25), as stages that only scenes with friction have.

A visit to a contact corrects the normal velocity, as without friction, and then the velocity at which the two
surfaces slip. For discs the two do not depend on each other but for Coulomb's bound, so that one visit solves
the contact exactly.

Rotation is kept as the rim speed, the radius times the spin: no contact needs a radius then.
"""

import warp as wp

from . import law
from .access import (
    at,
    first_of,
    gap_rate_of,
    larger,
    normal_of,
    put,
    second_of,
)
from .contacts import apply, contacts_of, gap_rates_now, is_wall_set, surface_of
from .driven import missing_correction, push_wall
from .gauss_seidel import correct_driven_wall, correcting_sets, in_blocks, keep_velocities
from .record import Scene, grain_count, is_accelerated, is_driven, pair_count
from .residual import keeping_worst
from .threads import Team
from .types import Floats, Vectors
from .verlet import least_monitored_correction, monitor
from .warm_start import freeze

f64 = wp.float64
THIRD = wp.constant(f64(1.0 / 3.0))
ROOT_TWO = wp.constant(f64(2.0**0.5))


@wp.func
def free_spin(s: Scene, i: int):
    """Find the rim speed without contacts (eq. 21)."""
    radius, spin = at(s.grains.radius, i), at(s.grains.spin, i)
    inertia = law.inertia(at(s.grains.mass, i), radius)
    if s.scheme.leapfrog != 0:
        spin = law.leapfrog_spin(spin, s.spin_drag, inertia, s.dt, s.scheme.staggered != 0)
    else:
        spin = law.free_spin(spin, s.spin_drag, inertia, s.dt)
    put(s.grains.free_rim, i, radius * spin)


@wp.func
def turn(s: Scene, i: int):
    """Take the spin from the rim speed that contacts have corrected, and turn the grain (eq. 24)."""
    spin = at(s.grains.next_rim, i) / at(s.grains.radius, i)
    put(s.grains.last_spin, i, at(s.grains.spin, i))
    put(s.grains.spin, i, spin)
    put(s.grains.angle, i, at(s.grains.angle, i) + s.dt * spin)


@wp.func
def rim_weights(s: Scene, c: int, at_wall: bool) -> wp.vec3d:
    """Return 1 / K_t of a contact, and the parts of a tangential correction that its rims take (eq. 22)."""
    if s.contacts.weights.shape[0] > 0:
        return at(s.contacts.rim_weights, c)
    if at_wall:
        return wp.vec3d(THIRD, f64(2.0), f64(0.0))
    return wp.vec3d(THIRD, f64(1.0), f64(1.0))


@wp.func
def find_rim_weights(s: Scene, i: int, j: int) -> wp.vec3d:
    """Compute the rim weights of a contact from the masses of grain i, and of grain or wall j."""
    k_i = f64(2.0) * at(s.grains.contact_mass, i) / at(s.grains.rim_mass, i)
    if j >= grain_count(s):
        return wp.vec3d(f64(1.0) / (f64(1.0) + k_i), k_i, f64(0.0))
    mass_i, mass_j = at(s.grains.contact_mass, i), at(s.grains.contact_mass, j)
    k_j = f64(2.0) * mass_j / at(s.grains.rim_mass, j)
    part_i = law.mass_share(mass_i, mass_j) * k_i
    part_j = law.mass_share(mass_j, mass_i) * k_j
    return wp.vec3d(f64(1.0) / (f64(1.0) + part_i + part_j), part_i, part_j)


@wp.func
def apply_both(s: Scene, velocity: Vectors, rim: Floats, c: int, dv: f64, dvt: f64, at_wall: bool):
    """Share normal and tangential correction of a contact out to its bodies."""
    contacts = s.contacts
    n = normal_of(contacts.contact, c)
    apply(contacts, velocity, c, dv * n + dvt * law.tangent(n), at_wall)
    if at_wall and is_driven(s):
        push_wall(s, velocity, c, dv)
    weights, i = rim_weights(s, c, at_wall), first_of(contacts.contact, c)
    put(rim, i, at(rim, i) - dvt * weights[1])
    if not at_wall:
        j = second_of(contacts.contact, c)
        put(rim, j, at(rim, j) - dvt * weights[2])


@wp.func
def begin_rim(s: Scene, i: int):
    """Begin with the free rim speed."""
    if s.control.resuming == 0:
        put(s.grains.next_rim, i, at(s.grains.free_rim, i))


@wp.func
def start_with_friction(team: Team, s: Scene, k: int):
    """Freeze the contacts of a set, and apply their corrections."""
    c, end = contacts_of(team, s, k)
    at_wall = is_wall_set(s, k)
    while c < end:
        freeze(s, c, at_wall)
        if s.control.resuming == 0:
            dv, dvt = at(s.contacts.dv_start, c), at(s.contacts.dvt_start, c)
            put(s.contacts.dv, c, dv)
            put(s.contacts.dvt, c, dvt)
            apply_both(s, s.grains.next_velocity, s.grains.next_rim, c, dv, dvt, at_wall)
        c += 1


@wp.func
def begin_rebuilt_rim(s: Scene, i: int):
    """Begin with the free rim speed."""
    put(s.grains.rebuilt_rim, i, at(s.grains.free_rim, i))


@wp.func
def rebuild_with_friction(team: Team, s: Scene, k: int):
    """Apply the corrections of the contacts of a set."""
    c, end = contacts_of(team, s, k)
    at_wall = is_wall_set(s, k)
    contacts, grains = s.contacts, s.grains
    while c < end:
        dv, dvt = at(contacts.dv, c), at(contacts.dvt, c)
        apply_both(s, grains.rebuilt_velocity, grains.rebuilt_rim, c, dv, dvt, at_wall)
        c += 1


@wp.func
def residual_of(s: Scene, c: int) -> f64:
    """Return the residual of a contact, the larger one of its normal and tangential part [m/s] (eq. 25)."""
    velocity, rim, contact = s.grains.rebuilt_velocity, s.grains.rebuilt_rim, s.contacts.contact
    dv, dvt, n = at(s.contacts.dv, c), at(s.contacts.dvt, c), normal_of(contact, c)
    i, j = first_of(contact, c), second_of(contact, c)
    at_wall = c >= pair_count(s)
    v, u = at(velocity, i), at(rim, i)
    gap, friction = gap_rate_of(contact, c), f64(s.friction)
    if at_wall:
        surface = surface_of(s, c)
        gap, _ = gap_rates_now(s.contacts, c, v)
        friction, u = surface[0], u - surface[1]
    else:
        v, u = v - at(velocity, j), u + at(rim, j)
    change = law.pair_correction(wp.dot(v, n), dv, gap)
    compliance = f64(1.0)
    if at_wall and is_driven(s):
        change, compliance = missing_correction(s, velocity, c)
    vt = wp.dot(v, law.tangent(n)) + u
    share = rim_weights(s, c, at_wall)[0]
    slip = law.friction_correction(share * vt, dvt, friction * (dv + change)) / share
    return wp.max(compliance * wp.abs(change), wp.abs(slip))


measure_with_friction = keeping_worst("measure_with_friction", residual_of)


def sweeping_pairs(weighted: bool) -> wp.Function:
    """Return the function that corrects pairs, as `gauss_seidel.sweeping_pairs` does, with their friction."""

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
        friction = f64(s.friction)
        large = least_monitored_correction(s)
        weight = wp.vec2d(f64(0.5), f64(0.5))
        rim_weight = wp.vec3d(THIRD, f64(1.0), f64(1.0))
        zeta, bits = f64(0.0), wp.uint64(0)
        c = int(begin)
        while c < end:
            i, j, n = first_of(contact, c), second_of(contact, c), normal_of(contact, c)
            if wp.static(weighted):
                weight = at(weights, c)
                rim_weight = at(rim_weights, c)
            vi, vj = at(velocity, i), at(velocity, j)
            ui, uj = at(rim, i), at(rim, j)
            dv_before, dvt_before = at(dvs, c), at(dvts, c)
            t, difference = law.tangent(n), vi - vj
            dv = law.pair_correction(wp.dot(difference, n), dv_before, gap_rate_of(contact, c))
            vt = wp.dot(difference, t) + ui + uj
            dv_after = dv_before + dv
            dvt = law.friction_correction(rim_weight[0] * vt, dvt_before, friction * dv_after)
            push = dv * n + dvt * t
            vi = vi - push * weight[0]
            vj = vj + push * weight[1]
            put(velocity, i, vi)
            put(velocity, j, vj)
            put(rim, i, ui - dvt * rim_weight[1])
            put(rim, j, uj - dvt * rim_weight[2])
            put(dvs, c, dv_after)
            put(dvts, c, dvt_before + dvt)
            keep_velocities(kept, k + 2 * (c - begin), vi, vj)
            change = larger(wp.abs(dv), wp.abs(dvt))
            zeta = larger(zeta, change)
            bits = (bits << wp.uint64(1)) | wp.where(change > large, wp.uint64(1), wp.uint64(0))
            c += 1
        return zeta, bits

    return in_blocks(correct_block)


sweep_equal, sweep_weighted = sweeping_pairs(False), sweeping_pairs(True)


def sweeping_walls(driven: bool) -> wp.Function:
    """Return the function that corrects contacts with walls, in place, and monitors their grains.

    It returns the largest change. `driven`: a force drives one of the walls.
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
            surface = surface_of(s, c)
            rim_weight = rim_weights(s, c, True)
            v, u, t = at(velocity, i), at(rim, i), law.tangent(n)
            dv_before, dvt_before = at(contacts.dv, c), at(contacts.dvt, c)
            if wp.static(driven):
                found = correct_driven_wall(s, c, dv_before)
                dv, change = found[0], found[1]
            else:
                gap, _ = gap_rates_now(contacts, c, v)
                dv = law.pair_correction(wp.dot(v, n), dv_before, gap)
                change = wp.abs(dv)
            vt = wp.dot(v, t) + (u - surface[1])
            dv_after = dv_before + dv
            dvt = law.friction_correction(rim_weight[0] * vt, dvt_before, surface[0] * dv_after)
            put(velocity, i, v - (dv * n + dvt * t))
            put(rim, i, u - dvt * rim_weight[1])
            put(contacts.dv, c, dv_after)
            put(contacts.dvt, c, dvt_before + dvt)
            change = larger(change, wp.abs(dvt))
            zeta = larger(zeta, change)
            if change > large:
                monitor(s, i, at(velocity, i))
            c += 1
        return zeta

    return sweep_walls


sweep_walls, sweep_driven_walls = sweeping_walls(False), sweeping_walls(True)
sweep_with_friction = correcting_sets(
    "sweep_with_friction", sweep_equal, sweep_weighted, sweep_walls, sweep_driven_walls
)


@wp.func
def save_tangential(s: Scene, k: int):
    """Keep the tangential corrections of the contact at place k of the list."""
    c = at(s.workspace.sweep_index, k)
    last = f64(0.0)
    if is_accelerated(s):
        last = at(s.momentum.last_dvt, c)
    put(s.workspace.old_dvt, k, wp.vec3d(at(s.contacts.dvt, c), at(s.contacts.dvt_start, c), last))


@wp.func
def transfer_tangential(s: Scene, i: int):
    """Write the tangential corrections of a grain's contacts where they are swept, or zero."""
    k, end = at(s.neighbors.start, i), at(s.neighbors.start, i + 1)
    while k < end:
        c, k_old = at(s.workspace.sweep_index, k), at(s.workspace.old_place, k)
        dvt = wp.vec3d(f64(0.0), f64(0.0), f64(0.0))
        if k_old >= 0:
            dvt = at(s.workspace.old_dvt, k_old)
        put(s.contacts.dvt, c, dvt[0])
        put(s.contacts.dvt_start, c, dvt[1])
        if is_accelerated(s):
            put(s.momentum.last_dvt, c, dvt[2])
        if s.contacts.weights.shape[0] > 0:
            put(s.contacts.rim_weights, c, find_rim_weights(s, i, at(s.neighbors.neighbor, k)))
        k += 1


@wp.func
def widen_row_sum(s: Scene):
    """Bound the change of a velocity in one iteration, tangential corrections as large as normal ones."""
    s.verlet.work.max_row_sum = ROOT_TWO * s.verlet.work.max_row_sum


@wp.func
def keep_tangential(s: Scene, c: int):
    """Let the next step start with the tangential correction of a contact."""
    put(s.contacts.dvt_start, c, at(s.contacts.dvt, c))
