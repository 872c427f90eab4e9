"""Accelerated Gauss-Seidel: Nesterov momentum around the sweep, gradient restart, monotone safeguard.

A sweep is exact coordinate descent on the dual objective of the step (SPEC.md, "Why it is hard"),

    phi = 1/2 sum_i m_i |v_i|^2 + sum_c mu_c dv_c gap_c / dt,    mu_c = m_i m_j / (m_i + m_j), m_i at a wall.

Between two sweeps, corrections x and velocities go on along the line from the last ones,
y = x + beta (x - last), with beta = (t - 1) / t', t' = (1 + sqrt(1 + 4 t^2)) / 2 (Nesterov 1983). Momentum
starts anew, t = 1, when it points up the gradient (O'Donoghue and Candes 2015). A sweep that does not make
good what going on to y has cost in phi is undone, so that phi falls from sweep to sweep.

The sums that decide this are taken over chunks of fixed length and then in order, so that they, too, are
the same for any number of workers.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from . import law
from .access import dv_of, first_of, gap_rate_of, normal_of, second_of, set_dv, set_velocity, velocity_of
from .crew import Crew, share
from .data import GROUPS, PAIRS, WALLS, WATCHING, Contacts, Grains, Progress, Watch
from .features import functions
from .stage import kernels_of
from .sweep import stages as sweep_stages
from .variant import Variant
from .watch import look_at, watch_grain

f64 = wp.float64
CHUNK = wp.constant(128)
ENOUGH = wp.constant(f64(0.99))  # part of its own decrease of phi that a sweep must keep
ROUNDING = wp.constant(f64(2.0e-16))
TIME, BETA = (wp.constant(k) for k in range(2))


@wp.struct
class Momentum:
    """What lies one sweep back, and the parts of sums, by chunk."""

    pair_last: wp.array(dtype=f64)  # corrections before the last sweep [m/s]
    wall_last: wp.array(dtype=f64)
    last_velocity: wp.array(dtype=wp.vec2d)  # velocities that go with them [m/s]
    pair_part: wp.array(dtype=wp.vec2d)  # cost in phi less gain, and slope of phi along the momentum
    wall_part: wp.array(dtype=wp.vec2d)
    grain_part: wp.array(dtype=wp.vec3d)  # sums of m s.v, m s.s and m v.v, where s is v less last velocity
    scalar: wp.array(dtype=f64)  # TIME, BETA
    undo: wp.array(dtype=wp.int32)  # whether the last sweep is undone


@wp.func
def chunks_in(count: int) -> int:
    """How many chunks hold so many elements."""
    return (count + CHUNK - 1) // CHUNK


@wp.func
def go_on(x: f64, last: f64, beta: f64) -> f64:
    """Return y = x + beta (x - last); x itself without momentum."""
    y = x
    if beta > f64(0.0):
        y = x + beta * (x - last)
    return y


@wp.func
def wall_cost(dv: f64, gap_rate_out: f64, gap_rate_in: f64) -> f64:
    """The linear part of phi of a grain's walls, by unit mass: dv > 0 is carried by the outer one."""
    return wp.where(dv >= f64(0.0), dv * gap_rate_out, -dv * gap_rate_in)


@cache
def stages(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the stages for one kind of scene."""
    weights_of, mass_of = sweep_stages(variant).weights_of, functions(variant).mass_of
    half = wp.constant(f64(0.5))

    @wp.func
    def correct_pair(grains: Grains, contacts: Contacts, momentum: Momentum, c: int) -> wp.vec3d:
        """One pair's correction from y, in place. Returns |dv|, cost in phi less gain, slope."""
        i = first_of(contacts.pairs, c)
        j = second_of(contacts.pairs, c)
        n = normal_of(contacts.pairs, c)
        gap_rate = gap_rate_of(contacts.pairs, c)
        weight = weights_of(contacts, c)
        last = momentum.pair_last[c]
        x = wp.where(momentum.undo[0] != 0, last, dv_of(contacts.pair_dv, c))
        y = go_on(x, last, momentum.scalar[BETA])
        vi = velocity_of(grains.next_velocity, i)
        vj = velocity_of(grains.next_velocity, j)
        vn = wp.dot(vi - vj, n)
        dv = law.pair_correction(vn, y, gap_rate)
        set_velocity(grains.next_velocity, i, vi - dv * n * weight[0])
        set_velocity(grains.next_velocity, j, vj + dv * n * weight[1])
        momentum.pair_last[c] = x
        set_dv(contacts.pair_dv, c, y + dv)
        mu = mass_of(grains, i) * weight[0]
        gain = dv * (vn - gap_rate - half * dv)
        cost = gap_rate * (y - x)
        return wp.vec3d(wp.abs(dv), mu * (cost - ENOUGH * gain), -mu * dv * (y + dv - x))

    @wp.func
    def correct_wall(grains: Grains, contacts: Contacts, momentum: Momentum, c: int) -> wp.vec3d:
        """One grain's wall correction from y, in place. Returns |dv|, cost in phi less gain, slope."""
        wall = contacts.walls[c]
        gap_rate_in = -wall.gap_rate_out
        last = momentum.wall_last[c]
        x = wp.where(momentum.undo[0] != 0, last, wall.dv)
        y = go_on(x, last, momentum.scalar[BETA])
        vn = wp.dot(grains.next_velocity[wall.i], wall.n)
        new = law.outer_correction(vn, y, wall.gap_rate_out)
        if wp.static(variant.inner_wall):
            gap_rate_in = wall.gap_rate_in
            new = new - law.inner_correction(vn, y, gap_rate_in)
        dv = new - y
        grains.next_velocity[wall.i] = grains.next_velocity[wall.i] - dv * wall.n
        momentum.wall_last[c] = x
        contacts.walls[c].dv = y + dv
        cost_x = wall_cost(x, wall.gap_rate_out, gap_rate_in)
        cost_y = wall_cost(y, wall.gap_rate_out, gap_rate_in)
        gain = dv * (vn - half * dv) - (wall_cost(y + dv, wall.gap_rate_out, gap_rate_in) - cost_y)
        mu = mass_of(grains, wall.i)
        return wp.vec3d(wp.abs(dv), mu * (cost_y - cost_x - ENOUGH * gain), -mu * dv * (y + dv - x))

    @wp.func
    def sweep_group(
        crew: Crew, tid: int, grains: Grains, contacts: Contacts, watch: Watch, momentum: Momentum, group: int
    ) -> f64:
        """Correct this worker's share of the pairs of a group. Returns the largest |dv|."""
        largest = f64(0.0)
        start = contacts.group_start[group]
        stop = contacts.group_start[group + 1]
        begin, end = share(crew, tid, start // CHUNK, chunks_in(stop))
        for k in range(begin, end):
            part = wp.vec2d(f64(0.0), f64(0.0))
            for c in range(wp.max(start, k * CHUNK), wp.min(stop, (k + 1) * CHUNK)):
                result = correct_pair(grains, contacts, momentum, c)
                largest = wp.max(largest, result[0])
                part = part + wp.vec2d(result[1], result[2])
                if watch.flag[WATCHING] != 0:
                    i = contacts.pairs[c].i
                    watch_grain(grains.next_velocity[i], watch, i)
                    j = contacts.pairs[c].j
                    watch_grain(grains.next_velocity[j], watch, j)
            momentum.pair_part[k + group] = part
        return largest

    @wp.func
    def sweep_all_walls(
        crew: Crew, tid: int, grains: Grains, contacts: Contacts, watch: Watch, momentum: Momentum
    ) -> f64:
        """Correct this worker's share of the grains that may reach a wall. Returns the largest |dv|."""
        largest = f64(0.0)
        begin, end = share(crew, tid, 0, chunks_in(contacts.count[WALLS]))
        for k in range(begin, end):
            part = wp.vec2d(f64(0.0), f64(0.0))
            for c in range(k * CHUNK, wp.min(contacts.count[WALLS], (k + 1) * CHUNK)):
                result = correct_wall(grains, contacts, momentum, c)
                largest = wp.max(largest, result[0])
                part = part + wp.vec2d(result[1], result[2])
                if watch.flag[WATCHING] != 0:
                    i = contacts.walls[c].i
                    watch_grain(grains.next_velocity[i], watch, i)
            momentum.wall_part[k] = part
        return largest

    @wp.func
    def judge_sweep(contacts: Contacts, momentum: Momentum, grains: int):
        """Undo a sweep after which phi has risen; choose how far to go on after the others."""
        part = wp.vec2d(f64(0.0), f64(0.0))
        for k in range(chunks_in(contacts.count[PAIRS]) + contacts.count[GROUPS]):
            part = part + momentum.pair_part[k]
        for k in range(chunks_in(contacts.count[WALLS])):
            part = part + momentum.wall_part[k]
        energy = wp.vec3d(f64(0.0), f64(0.0), f64(0.0))
        for k in range(chunks_in(grains)):
            energy = energy + momentum.grain_part[k]
        beta = momentum.scalar[BETA]
        rise = part[0] + beta * (energy[0] + half * beta * energy[1] - ROUNDING * energy[2])
        momentum.undo[0] = 1 if beta > f64(0.0) and rise > f64(0.0) else 0
        if momentum.undo[0] != 0 or part[1] > f64(0.0):
            momentum.scalar[TIME] = f64(1.0)
        t = momentum.scalar[TIME]
        longer = half * (f64(1.0) + wp.sqrt(f64(1.0) + f64(4.0) * t * t))
        momentum.scalar[BETA] = (t - f64(1.0)) / longer
        momentum.scalar[TIME] = wp.where(momentum.undo[0] != 0, f64(1.0), longer)

    @wp.func
    def advance(crew: Crew, tid: int, grains: Grains, watch: Watch, momentum: Momentum):
        """Take this worker's share of the velocities on to y, or, undone, back to the last ones."""
        n = grains.position.shape[0]
        beta = momentum.scalar[BETA]
        begin, end = share(crew, tid, 0, chunks_in(n))
        for k in range(begin, end):
            part = wp.vec3d(f64(0.0), f64(0.0), f64(0.0))
            for i in range(k * CHUNK, wp.min(n, (k + 1) * CHUNK)):
                v = grains.next_velocity[i]
                look_at(v, watch, i)
                if momentum.undo[0] != 0:
                    v = momentum.last_velocity[i]
                s = v - momentum.last_velocity[i]
                m = mass_of(grains, i)
                part = part + wp.vec3d(m * wp.dot(s, v), m * wp.dot(s, s), m * wp.dot(v, v))
                momentum.last_velocity[i] = v
                grains.next_velocity[i] = v + beta * s
                watch_grain(grains.next_velocity[i], watch, i)
            momentum.grain_part[k] = part

    @wp.func
    def settle(crew: Crew, tid: int, grains: Grains, watch: Watch, progress: Progress):
        """End with this worker's share of the velocities; rebuilt ones leave rounding errors behind."""
        begin, end = share(crew, tid, 0, grains.position.shape[0])
        for i in range(begin, end):
            look_at(grains.next_velocity[i], watch, i)
            if progress.checking[0] != 0:
                grains.next_velocity[i] = grains.rebuilt_velocity[i]

    @wp.func
    def begin(crew: Crew, tid: int, grains: Grains, contacts: Contacts, momentum: Momentum):
        """Start without momentum; parts of chunks that no group has stay zero."""
        first, last = share(crew, tid, 0, grains.position.shape[0])
        for i in range(first, last):
            momentum.last_velocity[i] = grains.next_velocity[i]
        parts = chunks_in(contacts.count[PAIRS]) + contacts.count[GROUPS]
        first, last = share(crew, tid, 0, parts)
        for k in range(first, last):
            momentum.pair_part[k] = wp.vec2d(f64(0.0), f64(0.0))
        momentum.scalar[TIME] = f64(1.0)
        momentum.scalar[BETA] = f64(0.0)
        momentum.undo[0] = 0

    return SimpleNamespace(
        sweep_group=sweep_group,
        sweep_all_walls=sweep_all_walls,
        judge_sweep=judge_sweep,
        advance=advance,
        settle=settle,
        begin=begin,
    )


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Kernels of the stages that are launched."""
    own = stages(variant)
    return kernels_of(variant.module, own.begin)
