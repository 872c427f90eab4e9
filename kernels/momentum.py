"""Accelerated Gauss-Seidel: momentum around a sweep that goes a little too far.

A sweep is coordinate descent on the dual objective of the step (SPEC.md, "Why it is hard"),

    phi = 1/2 sum_i m_i |v_i|^2 + sum_c mu_c dv_c gap_c / dt,    mu_c = m_i m_j / (m_i + m_j), m_i at a wall.

Between two sweeps, corrections x and velocities go on along the line from the last ones,
y = x + beta (x - last), with beta = (t - 1) / t', t' = (1 + sqrt(1 + 4 t^2)) / 2 (Nesterov 1983). With beta
grows the over-relaxation of the sweep (Young 1954), up to RELAXED. Here is the sweep from y, with what it has
done to phi; safeguard.py judges it, stops momentum, undoes sweeps, and goes on.

The sums that decide this are taken over chunks of fixed length and then in order, so that they, too, are
the same for any number of workers.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from . import law
from .access import dv_of, first_of, gap_rate_of, normal_of, second_of, set_dv, set_velocity, velocity_of
from .crew import Crew, share
from .data import GROUPS, PAIRS, WALLS, WATCHING, Contacts, Grains, Watch
from .features import functions
from .stage import kernels_of
from .sweep import stages as sweep_stages
from .variant import Variant
from .watch import watch_grain

f64 = wp.float64
CHUNK = wp.constant(128)
ENOUGH = wp.constant(f64(0.99))  # part of its own decrease of phi that a sweep must keep
RELAXATION = wp.constant(f64(0.25))  # by how much a sweep goes too far at beta = 1, at first
TIME, BETA, RELAXED = (wp.constant(k) for k in range(3))


@wp.struct
class Momentum:
    """What lies one sweep back, and the parts of sums, by chunk."""

    pair_last: wp.array(dtype=f64)  # corrections before the last sweep [m/s]
    wall_last: wp.array(dtype=f64)
    last_velocity: wp.array(dtype=wp.vec2d)  # velocities that go with them [m/s]
    pair_part: wp.array(dtype=wp.vec2d)  # cost in phi less gain, and slope of phi along the momentum
    wall_part: wp.array(dtype=wp.vec2d)
    grain_part: wp.array(dtype=wp.vec3d)  # sums of m s.(v + y) and m v.v, largest s.s, where y = v + beta s
    scalar: wp.array(dtype=f64)  # TIME, BETA, RELAXED
    undo: wp.array(dtype=wp.int32)  # whether the last sweep is undone


@wp.func
def chunks_in(count: int) -> int:
    """How many chunks hold so many elements."""
    return (count + CHUNK - 1) // CHUNK


@wp.func
def wall_cost(dv: f64, gap_rate_out: f64, gap_rate_in: f64) -> f64:
    """The linear part of phi of a grain's walls, by unit mass: dv > 0 is carried by the outer one."""
    return wp.where(dv >= f64(0.0), dv * gap_rate_out, -dv * gap_rate_in)


@wp.func
def relaxation_of(momentum: Momentum) -> f64:
    """How many times its own correction a contact is given."""
    return f64(1.0) + momentum.scalar[RELAXED] * momentum.scalar[BETA]


@cache
def stages(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the stages for one kind of scene."""
    weights_of, mass_of = sweep_stages(variant).weights_of, functions(variant).mass_of
    half = wp.constant(f64(0.5))

    @wp.func
    def mass_in_phi(grains: Grains, i: int) -> f64:
        """Mass of a grain; where all masses are equal, phi is by unit mass."""
        if wp.static(variant.distinct_masses):
            return mass_of(grains, i)
        return f64(1.0)

    @wp.func
    def correct_pair(
        grains: Grains, contacts: Contacts, momentum: Momentum, c: int, beta: f64, relaxation: f64
    ) -> wp.vec3d:
        """One pair's correction from y, in place. Returns |dv|, cost in phi less gain, slope."""
        i = first_of(contacts.pairs, c)
        j = second_of(contacts.pairs, c)
        n = normal_of(contacts.pairs, c)
        gap_rate = gap_rate_of(contacts.pairs, c)
        weight = weights_of(contacts, c)
        x = dv_of(contacts.pair_dv, c)
        ahead = beta * (x - dv_of(momentum.pair_last, c))
        vi = velocity_of(grains.next_velocity, i)
        vj = velocity_of(grains.next_velocity, j)
        excess = wp.dot(vi - vj, n) - gap_rate
        dv = law.pair_correction(relaxation * excess, x + ahead, f64(0.0))
        set_velocity(grains.next_velocity, i, vi - dv * n * weight[0])
        set_velocity(grains.next_velocity, j, vj + dv * n * weight[1])
        set_dv(momentum.pair_last, c, x)
        set_dv(contacts.pair_dv, c, x + ahead + dv)
        mu = mass_in_phi(grains, i) * weight[0]
        rise = gap_rate * ahead - ENOUGH * dv * (excess - half * dv)
        return wp.vec3d(wp.abs(dv), mu * rise, -mu * dv * (ahead + dv))

    @wp.func
    def correct_wall(
        grains: Grains, contacts: Contacts, momentum: Momentum, c: int, beta: f64, relaxation: f64
    ) -> wp.vec3d:
        """One grain's wall correction from y, in place. Returns |dv|, cost in phi less gain, slope."""
        wall = contacts.walls[c]
        gap_rate_in = -wall.gap_rate_out
        y = wall.dv + beta * (wall.dv - momentum.wall_last[c])
        vn = wp.dot(grains.next_velocity[wall.i], wall.n)
        new = law.outer_correction(relaxation * vn, y, relaxation * wall.gap_rate_out)
        if wp.static(variant.inner_wall):
            gap_rate_in = wall.gap_rate_in
            new = new - law.inner_correction(relaxation * vn, y, relaxation * gap_rate_in)
        dv = new - y
        grains.next_velocity[wall.i] = grains.next_velocity[wall.i] - dv * wall.n
        momentum.wall_last[c] = wall.dv
        contacts.walls[c].dv = new
        cost_x = wall_cost(wall.dv, wall.gap_rate_out, gap_rate_in)
        cost_y = wall_cost(y, wall.gap_rate_out, gap_rate_in)
        gain = dv * (vn - half * dv) - (wall_cost(new, wall.gap_rate_out, gap_rate_in) - cost_y)
        mu = mass_in_phi(grains, wall.i)
        return wp.vec3d(wp.abs(dv), mu * (cost_y - cost_x - ENOUGH * gain), -mu * dv * (new - wall.dv))

    @wp.func
    def sweep_turn(
        crew: Crew, tid: int, grains: Grains, contacts: Contacts, watch: Watch, momentum: Momentum, group: int
    ) -> f64:
        """Correct this worker's share of the pairs of a group. Returns the largest |dv|."""
        largest = f64(0.0)
        beta = momentum.scalar[BETA]
        relaxation = relaxation_of(momentum)
        watching = watch.flag[WATCHING]
        start = contacts.group_start[group]
        stop = contacts.group_start[group + 1]
        begin, end = share(crew, tid, start // CHUNK, chunks_in(stop))
        for k in range(begin, end):
            part = wp.vec2d(f64(0.0), f64(0.0))
            c = wp.max(start, k * CHUNK)
            last = wp.min(stop, (k + 1) * CHUNK)
            while c < last:
                result = correct_pair(grains, contacts, momentum, c, beta, relaxation)
                largest = wp.max(largest, result[0])
                part = part + wp.vec2d(result[1], result[2])
                if watching != 0:
                    i = first_of(contacts.pairs, c)
                    watch_grain(velocity_of(grains.next_velocity, i), watch, i)
                    j = second_of(contacts.pairs, c)
                    watch_grain(velocity_of(grains.next_velocity, j), watch, j)
                c += 1
            momentum.pair_part[k + group] = part
        return largest

    @wp.func
    def sweep_all_walls(
        crew: Crew, tid: int, grains: Grains, contacts: Contacts, watch: Watch, momentum: Momentum
    ) -> f64:
        """Correct this worker's share of the grains that may reach a wall. Returns the largest |dv|."""
        largest = f64(0.0)
        beta = momentum.scalar[BETA]
        relaxation = relaxation_of(momentum)
        begin, end = share(crew, tid, 0, chunks_in(contacts.count[WALLS]))
        for k in range(begin, end):
            part = wp.vec2d(f64(0.0), f64(0.0))
            for c in range(k * CHUNK, wp.min(contacts.count[WALLS], (k + 1) * CHUNK)):
                result = correct_wall(grains, contacts, momentum, c, beta, relaxation)
                largest = wp.max(largest, result[0])
                part = part + wp.vec2d(result[1], result[2])
                if watch.flag[WATCHING] != 0:
                    i = contacts.walls[c].i
                    watch_grain(grains.next_velocity[i], watch, i)
            momentum.wall_part[k] = part
        return largest

    @wp.func
    def begin(crew: Crew, tid: int, grains: Grains, contacts: Contacts, momentum: Momentum):
        """Start without momentum; parts of chunks that no group has stay zero."""
        first, last = share(crew, tid, 0, grains.position.shape[0])
        for i in range(first, last):
            momentum.last_velocity[i] = grains.next_velocity[i]
        first, last = share(crew, tid, 0, chunks_in(grains.position.shape[0]))
        for k in range(first, last):
            momentum.grain_part[k] = wp.vec3d(f64(0.0), f64(0.0), f64(0.0))
        first, last = share(crew, tid, 0, contacts.count[PAIRS])
        for c in range(first, last):
            momentum.pair_last[c] = contacts.pair_dv[c]
        first, last = share(crew, tid, 0, contacts.count[WALLS])
        for c in range(first, last):
            momentum.wall_last[c] = contacts.walls[c].dv
        parts = chunks_in(contacts.count[PAIRS]) + contacts.count[GROUPS]
        first, last = share(crew, tid, 0, parts)
        for k in range(first, last):
            momentum.pair_part[k] = wp.vec2d(f64(0.0), f64(0.0))
        momentum.scalar[TIME] = f64(1.0)
        momentum.scalar[BETA] = f64(0.0)
        momentum.scalar[RELAXED] = RELAXATION
        momentum.undo[0] = 0

    return SimpleNamespace(
        mass_in_phi=mass_in_phi,
        sweep_turn=sweep_turn,
        sweep_all_walls=sweep_all_walls,
        begin=begin,
    )


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Kernels of the stages that are launched."""
    own = stages(variant)
    return kernels_of(variant.module, own.begin)
