"""The error of a solve, defined once and the same for every method and order: the natural residual.

    eta = max over contacts of | max(0, dv_c + vn - gap/dt) - dv_c |,

both walls apart, for the velocities that the corrections make of the free ones. These velocities are the
exact solution of a step whose gaps are changed by at most dt * eta: a contact that carries dv_c > 0 has
vn = gap/dt to within eta, one that does not has vn <= gap/dt + eta.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .crew import Crew, meet, share, slot_of
from .data import GROUPS, WALLS, Contacts, Grains, Progress
from .stage import kernels_of
from .sweep import stages as sweep_stages
from .variant import Variant

f64 = wp.float64


@wp.func
def unbalance(vn: f64, dv: f64, gap_rate: f64) -> f64:
    """| max(0, dv + vn - gap/dt) - dv | of one contact [m/s]."""
    return wp.abs(wp.max(f64(0.0), dv + vn - gap_rate) - dv)


@cache
def stages(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the functions for one kind of scene."""
    apply_pair = sweep_stages(variant).apply_pair

    @wp.func
    def free_share(crew: Crew, tid: int, grains: Grains):
        """Begin with this worker's share of the free velocities."""
        begin, end = share(crew, tid, 0, grains.position.shape[0])
        for i in range(begin, end):
            grains.rebuilt_velocity[i] = grains.free_velocity[i]

    @wp.func
    def rebuild_group(crew: Crew, tid: int, grains: Grains, contacts: Contacts, group: int):
        """Apply this worker's share of the corrections of a group's pairs."""
        begin, end = share(crew, tid, contacts.group_start[group], contacts.group_start[group + 1])
        for c in range(begin, end):
            apply_pair(grains.rebuilt_velocity, contacts, c, contacts.pair_dv[c] * contacts.pairs[c].n)

    @wp.func
    def rebuild_walls(crew: Crew, tid: int, grains: Grains, contacts: Contacts):
        """Apply this worker's share of the corrections at the walls."""
        begin, end = share(crew, tid, 0, contacts.count[WALLS])
        for c in range(begin, end):
            wall = contacts.walls[c]
            grains.rebuilt_velocity[wall.i] = grains.rebuilt_velocity[wall.i] - wall.dv * wall.n

    @wp.func
    def worst_of_group(crew: Crew, tid: int, grains: Grains, contacts: Contacts, group: int) -> f64:
        """The largest residual of this worker's share of a group's pairs."""
        worst = f64(0.0)
        begin, end = share(crew, tid, contacts.group_start[group], contacts.group_start[group + 1])
        for c in range(begin, end):
            pair = contacts.pairs[c]
            vn = wp.dot(grains.rebuilt_velocity[pair.i] - grains.rebuilt_velocity[pair.j], pair.n)
            worst = wp.max(worst, unbalance(vn, contacts.pair_dv[c], pair.gap_rate))
        return worst

    @wp.func
    def worst_of_walls(crew: Crew, tid: int, grains: Grains, contacts: Contacts) -> f64:
        """The largest residual of this worker's share of the walls."""
        worst = f64(0.0)
        begin, end = share(crew, tid, 0, contacts.count[WALLS])
        for c in range(begin, end):
            wall = contacts.walls[c]
            vn = wp.dot(grains.rebuilt_velocity[wall.i], wall.n)
            worst = wp.max(worst, unbalance(vn, wp.max(wall.dv, f64(0.0)), wall.gap_rate_out))
            if wp.static(variant.inner_wall):
                worst = wp.max(worst, unbalance(-vn, wp.max(-wall.dv, f64(0.0)), wall.gap_rate_in))
        return worst

    @wp.func
    def measure(crew: Crew, tid: int, grains: Grains, contacts: Contacts) -> f64:
        """Part of eta of this worker; CPU workers meet between the stages."""
        free_share(crew, tid, grains)
        meet(crew)
        for group in range(contacts.count[GROUPS]):
            rebuild_group(crew, tid, grains, contacts, group)
            meet(crew)
        rebuild_walls(crew, tid, grains, contacts)
        meet(crew)
        worst = worst_of_walls(crew, tid, grains, contacts)
        for group in range(contacts.count[GROUPS]):
            worst = wp.max(worst, worst_of_group(crew, tid, grains, contacts, group))
        return worst

    @wp.func
    def measure_all(crew: Crew, tid: int, grains: Grains, contacts: Contacts, progress: Progress):
        """Eta on a CPU, in one launch."""
        slot = slot_of(crew, tid, progress.residual.shape[0])
        progress.residual[slot] = measure(crew, tid, grains, contacts)

    @wp.func
    def begin_rebuild(crew: Crew, tid: int, grains: Grains, progress: Progress):
        """First launch of eta on a GPU."""
        if progress.checking[0] != 0:
            free_share(crew, tid, grains)

    @wp.func
    def rebuild_pairs(
        crew: Crew, tid: int, grains: Grains, contacts: Contacts, progress: Progress, group: int
    ):
        """Launch of one group on a GPU."""
        if progress.checking[0] != 0 and group < contacts.count[GROUPS]:
            rebuild_group(crew, tid, grains, contacts, group)

    @wp.func
    def finish_rebuild(crew: Crew, tid: int, grains: Grains, contacts: Contacts, progress: Progress):
        """Launch of the walls on a GPU."""
        if progress.checking[0] != 0:
            rebuild_walls(crew, tid, grains, contacts)

    @wp.func
    def find_worst(crew: Crew, tid: int, grains: Grains, contacts: Contacts, progress: Progress):
        """Last launch of eta on a GPU."""
        if progress.checking[0] != 0:
            worst = worst_of_walls(crew, tid, grains, contacts)
            for group in range(contacts.count[GROUPS]):
                worst = wp.max(worst, worst_of_group(crew, tid, grains, contacts, group))
            wp.atomic_max(progress.residual, slot_of(crew, tid, progress.residual.shape[0]), worst)

    return SimpleNamespace(
        measure=measure,
        measure_all=measure_all,
        begin_rebuild=begin_rebuild,
        rebuild_pairs=rebuild_pairs,
        finish_rebuild=finish_rebuild,
        find_worst=find_worst,
    )


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Kernels of the stages that are launched."""
    own = stages(variant)
    return kernels_of(
        variant.module,
        own.measure_all,
        own.begin_rebuild,
        own.rebuild_pairs,
        own.finish_rebuild,
        own.find_worst,
    )
