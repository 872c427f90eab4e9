"""The contact iteration: warm start, and corrections contact by contact (SPEC.md, step 2)."""

from functools import cache
from types import SimpleNamespace

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
)
from .crew import Crew, meet, share
from .data import (
    GROUPS,
    WALLS,
    WATCHING,
    Contacts,
    Grains,
    Watch,
)
from .features import functions
from .stage import kernels_of
from .variant import Variant
from .watch import watch_grain

f64 = wp.float64


@cache
def stages(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the stages for one kind of scene."""
    radius_of = functions(variant).radius_of

    @wp.func
    def weights_of(contacts: Contacts, c: int) -> wp.vec2d:
        """Parts of a pair's correction that its grains take: m_j / (m_i + m_j) and m_i / (m_i + m_j)."""
        if wp.static(variant.distinct_masses):
            return contacts.weights[c]
        return wp.vec2d(f64(0.5), f64(0.5))

    @wp.func
    def apply_pair(velocity: wp.array(dtype=wp.vec2d), contacts: Contacts, c: int, impulse: wp.vec2d):
        """v_i -= dv n m_j / (m_i + m_j), v_j += dv n m_i / (m_i + m_j); impulse = dv n [m/s]."""
        i = contacts.pairs[c].i
        j = contacts.pairs[c].j
        weight = weights_of(contacts, c)
        velocity[i] = velocity[i] - impulse * weight[0]
        velocity[j] = velocity[j] + impulse * weight[1]

    @wp.func
    def correct_pair(velocity: wp.array(dtype=wp.vec2d), contacts: Contacts, c: int) -> f64:
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
    def correct_wall(velocity: wp.array(dtype=wp.vec2d), contacts: Contacts, c: int) -> f64:
        """One grain's wall correction, in place. Returns |dv|."""
        i = grain_of(contacts.walls, c)
        n = wall_normal_of(contacts.walls, c)
        v = velocity_of(velocity, i)
        vn = wp.dot(v, n)
        dv_before = wall_dv_of(contacts.walls, c)
        dv = law.outer_correction(vn, dv_before, outer_gap_rate_of(contacts.walls, c))
        if wp.static(variant.inner_wall):
            dv = dv - law.inner_correction(vn, dv_before, inner_gap_rate_of(contacts.walls, c))
        dv = dv - dv_before
        set_velocity(velocity, i, v - dv * n)
        set_wall_dv(contacts.walls, c, dv_before + dv)
        return wp.abs(dv)

    @wp.func
    def start_pair(grains: Grains, contacts: Contacts, c: int, dt: f64):
        """Freeze a pair's normal and gap, and re-apply the correction kept from the previous step."""
        pair = contacts.pairs[c]
        n, distance = law.normal(grains.position[pair.i], grains.position[pair.j])
        radius_i = radius_of(grains, pair.i)
        radius_j = radius_of(grains, pair.j)
        contacts.pairs[c].n = n
        contacts.pairs[c].gap_rate = law.pair_gap(distance, radius_i, radius_j) / dt
        contacts.pair_dv_start[c] = contacts.pair_dv[c]
        apply_pair(grains.next_velocity, contacts, c, contacts.pair_dv[c] * n)

    @wp.func
    def sweep_group(
        crew: Crew, tid: int, grains: Grains, contacts: Contacts, watch: Watch, group: int
    ) -> f64:
        """Correct this worker's share of the pairs of a group. Returns the largest |dv|."""
        largest = f64(0.0)
        begin, end = share(crew, tid, contacts.group_start[group], contacts.group_start[group + 1])
        if watch.flag[WATCHING] == 0:
            c = begin
            while c < end:
                largest = wp.max(largest, correct_pair(grains.next_velocity, contacts, c))
                c += 1
        else:
            for c in range(begin, end):
                change = correct_pair(grains.next_velocity, contacts, c)
                if change > f64(0.0):
                    largest = wp.max(largest, change)
                    i = contacts.pairs[c].i
                    watch_grain(velocity_of(grains.next_velocity, i), watch, i)
                    j = contacts.pairs[c].j
                    watch_grain(velocity_of(grains.next_velocity, j), watch, j)
        return largest

    @wp.func
    def sweep_all_walls(crew: Crew, tid: int, grains: Grains, contacts: Contacts, watch: Watch) -> f64:
        """Correct this worker's share of the grains that may reach a wall. Returns the largest |dv|."""
        largest = f64(0.0)
        begin, end = share(crew, tid, 0, contacts.count[WALLS])
        c = begin
        while c < end:
            largest = wp.max(largest, correct_wall(grains.next_velocity, contacts, c))
            c += 1
        if watch.flag[WATCHING] != 0:
            for k in range(begin, end):
                i = grain_of(contacts.walls, k)
                watch_grain(velocity_of(grains.next_velocity, i), watch, i)
        return largest

    @wp.func
    def start_pairs(
        crew: Crew, tid: int, grains: Grains, contacts: Contacts, dt: f64, first_group: int, last_group: int
    ):
        """Iteration 0 of the pairs (warm start), group after group."""
        for group in range(first_group, wp.min(last_group, contacts.count[GROUPS])):
            begin, end = share(crew, tid, contacts.group_start[group], contacts.group_start[group + 1])
            for c in range(begin, end):
                start_pair(grains, contacts, c, dt)
            meet(crew)

    @wp.func
    def start_walls(
        crew: Crew, tid: int, grains: Grains, contacts: Contacts, radius_in: f64, radius_out: f64, dt: f64
    ):
        """Iteration 0 of the walls."""
        begin, end = share(crew, tid, 0, contacts.count[WALLS])
        for c in range(begin, end):
            wall = contacts.walls[c]
            n, distance = law.normal(wp.vec2d(f64(0.0), f64(0.0)), grains.position[wall.i])
            radius = radius_of(grains, wall.i)
            contacts.walls[c].n = n
            contacts.walls[c].gap_rate_out = law.outer_gap(distance, radius, radius_out) / dt
            if wp.static(variant.inner_wall):
                contacts.walls[c].gap_rate_in = law.inner_gap(distance, radius, radius_in) / dt
            contacts.wall_dv_start[c] = wall.dv
            grains.next_velocity[wall.i] = grains.next_velocity[wall.i] - wall.dv * n

    return SimpleNamespace(
        weights_of=weights_of,
        apply_pair=apply_pair,
        sweep_group=sweep_group,
        sweep_all_walls=sweep_all_walls,
        start_pairs=start_pairs,
        start_walls=start_walls,
    )


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Kernels of the stages that are launched."""
    own = stages(variant)
    return kernels_of(variant.module, own.start_pairs, own.start_walls)
