"""Warm start across lists: the corrections of the old list are found again in the new one."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from . import law
from .data import INFLUENCE, Contacts, Grains, Pair, Watch
from .detect import Rows
from .stage import kernels_of
from .variant import Variant

f64 = wp.float64


@cache
def stages(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the stages for one kind of scene."""

    @wp.func
    def save_pairs(
        i: int, rows: Rows, slot: wp.array(dtype=wp.int32), contacts: Contacts, pair_dv: wp.array(dtype=f64)
    ):
        """Corrections at the start of the step, in lexicographic order."""
        for k in range(rows.start[i], rows.start[i + 1]):
            pair_dv[k] = contacts.pair_dv_start[slot[k]]

    @wp.func
    def hold_pairs(
        i: int,
        grains: Grains,
        watch: Watch,
        old: Rows,
        old_dv: wp.array(dtype=f64),
        rows: Rows,
        lost: wp.array(dtype=wp.int32),
    ):
        """A pair that carries a correction must stay listed: where it is lost, widen its grains' reaches."""
        k = rows.start[i]
        for k_old in range(old.start[i], old.start[i + 1]):
            j = old.neighbor[k_old]
            while k < rows.start[i + 1] and rows.neighbor[k] < j:
                k = k + 1
            listed = False
            if k < rows.start[i + 1]:
                listed = rows.neighbor[k] == j
            if old_dv[k_old] != f64(0.0) and not listed:
                half = f64(0.5) * wp.length(grains.position[j] - grains.position[i])
                wp.atomic_max(watch.reach, i, half)
                wp.atomic_max(watch.reach, j, half)
                lost[0] = 1

    @wp.func
    def fill_slots(
        i: int,
        grains: Grains,
        old: Rows,
        old_dv: wp.array(dtype=f64),
        rows: Rows,
        slot: wp.array(dtype=wp.int32),
        contacts: Contacts,
    ):
        """Write every pair in its slot, with the correction that it carried in the old list, or zero."""
        k_old = old.start[i]
        for k in range(rows.start[i], rows.start[i + 1]):
            j = rows.neighbor[k]
            pair = Pair()
            pair.i = i
            pair.j = j
            dv = f64(0.0)
            while k_old < old.start[i + 1] and old.neighbor[k_old] < j:
                k_old = k_old + 1
            if k_old < old.start[i + 1] and old.neighbor[k_old] == j:
                dv = old_dv[k_old]
            contacts.pairs[slot[k]] = pair
            contacts.pair_dv[slot[k]] = dv
            contacts.pair_dv_start[slot[k]] = dv
            if wp.static(variant.distinct_masses):
                mass_i = grains.mass[i]
                mass_j = grains.mass[j]
                contacts.weights[slot[k]] = wp.vec2d(
                    law.share_of_mass(mass_i, mass_j), law.share_of_mass(mass_j, mass_i)
                )

    @wp.func
    def weigh(
        i: int, rows: Rows, slot: wp.array(dtype=wp.int32), contacts: Contacts, influence: wp.array(dtype=f64)
    ):
        """Sum of every grain's shares of its contacts, one for the walls included."""
        for k in range(rows.start[i], rows.start[i + 1]):
            weight = wp.vec2d(f64(0.5), f64(0.5))
            if wp.static(variant.distinct_masses):
                weight = contacts.weights[slot[k]]
            wp.atomic_add(influence, i, weight[0])
            wp.atomic_add(influence, rows.neighbor[k], weight[1])

    @wp.func
    def find_influence(i: int, influence: wp.array(dtype=f64), watch: Watch):
        """The largest change of a grain's velocity in one iteration, in units of zeta."""
        wp.atomic_max(watch.scalar, INFLUENCE, influence[i] + f64(1.0))

    return SimpleNamespace(
        save_pairs=save_pairs,
        hold_pairs=hold_pairs,
        fill_slots=fill_slots,
        weigh=weigh,
        find_influence=find_influence,
    )


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Kernels of the stages that are launched."""
    own = stages(variant)
    return kernels_of(
        variant.module, own.save_pairs, own.hold_pairs, own.fill_slots, own.weigh, own.find_influence
    )
