"""What a step reports of its contacts."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from . import law
from .crew import Crew, share, slot_of
from .data import PAIRS, WALLS, Contacts, Grains, Progress
from .features import functions
from .stage import kernels_of
from .variant import Variant

f64 = wp.float64


@cache
def stages(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the stages for one kind of scene."""
    radius_of = functions(variant).radius_of

    @wp.func
    def overlaps(
        crew: Crew,
        tid: int,
        grains: Grains,
        contacts: Contacts,
        progress: Progress,
        radius_in: f64,
        radius_out: f64,
    ):
        """Worst overlap [m] of the listed contacts, and how many carry a correction.

        Contacts that are not listed have stayed silent, so they do not overlap.
        """
        worst = f64(0.0)
        carrying = int(0)
        count = contacts.count[PAIRS]
        begin, end = share(crew, tid, 0, count)
        for c in range(begin, end):
            pair = contacts.pairs[c]
            _n, distance = law.normal(grains.position[pair.i], grains.position[pair.j])
            worst = wp.max(
                worst, -law.pair_gap(distance, radius_of(grains, pair.i), radius_of(grains, pair.j))
            )
            carrying += 1 if contacts.pair_dv[c] != f64(0.0) else 0
        count = contacts.count[WALLS]
        begin, end = share(crew, tid, 0, count)
        for c in range(begin, end):
            wall = contacts.walls[c]
            distance = wp.length(grains.position[wall.i])
            worst = wp.max(worst, -law.outer_gap(distance, radius_of(grains, wall.i), radius_out))
            if wp.static(variant.inner_wall):
                worst = wp.max(worst, -law.inner_gap(distance, radius_of(grains, wall.i), radius_in))
            carrying += 1 if wall.dv != f64(0.0) else 0
        slot = slot_of(crew, tid, progress.overlap.shape[0])
        wp.atomic_max(progress.overlap, slot, worst)
        wp.atomic_add(progress.carrying, slot, carrying)

    return SimpleNamespace(overlaps=overlaps)


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Kernels of the stages that are launched."""
    own = stages(variant)
    return kernels_of(variant.module, own.overlaps)
