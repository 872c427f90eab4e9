"""The contact iteration: warm start, and corrections contact by contact (SPEC.md, step 2)."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from . import law
from .crew import Crew, share, slot_of
from .data import (
    FRAME_VELOCITY,
    GROUPS,
    WALLS,
    WATCHING,
    Contacts,
    Grains,
    Progress,
    Watch,
)
from .variant import Variant

f64 = wp.float64


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the kernels for one kind of scene."""
    half = wp.constant(f64(0.5))

    @wp.func
    def apply_pair(velocity: wp.array(dtype=wp.vec2d), contacts: Contacts, c: int, impulse: wp.vec2d):
        """v_i -= dv n m_j/(m_i+m_j) and v_j += dv n m_i/(m_i+m_j); impulse = dv n [m/s]."""
        i = contacts.pairs[c].i
        j = contacts.pairs[c].j
        if wp.static(variant.distinct_masses):
            weight = contacts.weights[c]
            velocity[i] = velocity[i] - impulse * weight[0]
            velocity[j] = velocity[j] + impulse * weight[1]
        else:
            velocity[i] = velocity[i] - impulse * half
            velocity[j] = velocity[j] + impulse * half

    @wp.func
    def correct_pair(velocity: wp.array(dtype=wp.vec2d), contacts: Contacts, c: int) -> f64:
        """One pair's correction, in place. Returns |dv|."""
        pair = contacts.pairs[c]
        vn = wp.dot(velocity[pair.i] - velocity[pair.j], pair.n)
        dv = law.pair_correction(vn, pair.dv, pair.gap_rate)
        apply_pair(velocity, contacts, c, dv * pair.n)
        contacts.pairs[c].dv = pair.dv + dv
        return wp.abs(dv)

    @wp.func
    def correct_wall(velocity: wp.array(dtype=wp.vec2d), contacts: Contacts, c: int) -> f64:
        """One grain's wall correction, in place. Returns |dv|."""
        wall = contacts.walls[c]
        vn = wp.dot(velocity[wall.i], wall.n)
        dv = law.outer_correction(vn, wall.dv, wall.gap_rate_out)
        if wp.static(variant.inner_wall):
            dv = dv - law.inner_correction(vn, wall.dv, wall.gap_rate_in)
        dv = dv - wall.dv
        velocity[wall.i] = velocity[wall.i] - dv * wall.n
        contacts.walls[c].dv = wall.dv + dv
        return wp.abs(dv)

    @wp.func
    def watch_grain(velocity: wp.array(dtype=wp.vec2d), watch: Watch, i: int):
        """Keep the largest speed that grain i has had in this step, relative to the frame."""
        watch.peak[i] = wp.max(watch.peak[i], wp.length_sq(velocity[i] - watch.frame[FRAME_VELOCITY]))

    @wp.kernel(module=variant.module)
    def start_pairs(
        crew: Crew, grains: Grains, contacts: Contacts, dt: f64, first_group: int, last_group: int
    ):
        """Iteration 0: freeze every pair's normal and gap, and re-apply the correction kept (warm start)."""
        groups = wp.min(last_group, contacts.count[GROUPS])
        for g in range(first_group, groups):
            first = contacts.group_start[g]
            last = contacts.group_start[g + 1]
            begin, end = share(crew, wp.tid(), first, last)
            for c in range(begin, end):
                pair = contacts.pairs[c]
                n, distance = law.normal(grains.position[pair.i], grains.position[pair.j])
                radius_i = grains.radius[pair.i if wp.static(variant.distinct_radii) else 0]
                radius_j = grains.radius[pair.j if wp.static(variant.distinct_radii) else 0]
                contacts.pairs[c].n = n
                contacts.pairs[c].gap_rate = law.pair_gap(distance, radius_i, radius_j) / dt
                contacts.pair_dv_start[c] = pair.dv
                apply_pair(grains.next_velocity, contacts, c, pair.dv * n)

    @wp.kernel(module=variant.module)
    def start_walls(crew: Crew, grains: Grains, contacts: Contacts, radius_in: f64, radius_out: f64, dt: f64):
        """Iteration 0 at the walls."""
        count = contacts.count[WALLS]
        begin, end = share(crew, wp.tid(), 0, count)
        for c in range(begin, end):
            wall = contacts.walls[c]
            n, distance = law.normal(wp.vec2d(f64(0.0), f64(0.0)), grains.position[wall.i])
            radius = grains.radius[wall.i if wp.static(variant.distinct_radii) else 0]
            contacts.walls[c].n = n
            contacts.walls[c].gap_rate_out = law.outer_gap(distance, radius, radius_out) / dt
            if wp.static(variant.inner_wall):
                contacts.walls[c].gap_rate_in = law.inner_gap(distance, radius, radius_in) / dt
            contacts.wall_dv_start[c] = wall.dv
            grains.next_velocity[wall.i] = grains.next_velocity[wall.i] - wall.dv * n

    @wp.kernel(module=variant.module)
    def sweep_pairs(
        crew: Crew,
        grains: Grains,
        contacts: Contacts,
        watch: Watch,
        progress: Progress,
        first_group: int,
        last_group: int,
    ):
        """Correct every pair of the groups [first_group, last_group), group after group."""
        watching = watch.flag[WATCHING]
        largest = f64(0.0)
        groups = wp.min(last_group, contacts.count[GROUPS])
        for g in range(first_group, groups):
            first = contacts.group_start[g]
            last = contacts.group_start[g + 1]
            begin, end = share(crew, wp.tid(), first, last)
            for c in range(begin, end):
                largest = wp.max(largest, correct_pair(grains.next_velocity, contacts, c))
                if watching != 0:
                    watch_grain(grains.next_velocity, watch, contacts.pairs[c].i)
                    watch_grain(grains.next_velocity, watch, contacts.pairs[c].j)
        wp.atomic_max(progress.zeta, slot_of(crew, wp.tid(), progress.zeta.shape[0]), largest)

    @wp.kernel(module=variant.module)
    def sweep_walls(crew: Crew, grains: Grains, contacts: Contacts, watch: Watch, progress: Progress):
        """Correct every grain that may reach a wall; no two share a grain."""
        largest = f64(0.0)
        count = contacts.count[WALLS]
        begin, end = share(crew, wp.tid(), 0, count)
        for c in range(begin, end):
            largest = wp.max(largest, correct_wall(grains.next_velocity, contacts, c))
            if watch.flag[WATCHING] != 0:
                watch_grain(grains.next_velocity, watch, contacts.walls[c].i)
        wp.atomic_max(progress.zeta, slot_of(crew, wp.tid(), progress.zeta.shape[0]), largest)

    return SimpleNamespace(
        start_pairs=start_pairs, start_walls=start_walls, sweep_pairs=sweep_pairs, sweep_walls=sweep_walls
    )
