"""One step: a list of stages that reads as the algorithm (MODEL.md, "One step").

A step returns to the host in two cases: the list exceeds its capacity (WITHOUT_ROOM), or sweeps converge too
slowly and the host solves the step (SLOW). Conditions read the phase of the step (conditions.py); stopping.py
chooses it. Stages that differ when an attempt resumes with another list test `resuming` themselves.
A scene without a list begins like one whose list has expired: no skin suffices, so its first attempt iterates
nothing and asks for a list.
"""

from functools import cache
from typing import NamedTuple

import warp as wp

from . import (
    accelerated,
    accelerated_friction,
    cells,
    coloring,
    contact_list,
    exact,
    friction,
    gauss_seidel,
    integrate,
    momentum,
    neighbors,
    residual,
    skins,
    statistics,
    stopping,
    verlet,
    warm_start,
    working_set,
)
from .conditions import (
    accepted,
    answered,
    attempting,
    beginning,
    checking_list,
    expired,
    iterating,
    listed,
    measuring,
    recoloring,
    rejected,
    scanning,
    searching,
    starting,
    sweeping,
    unordered,
    unsolved,
)
from .contacts import contact_count, part_count
from .record import body_count, grain_count
from .stages import Each, If, Serial, Sets, Shared, Stage, While, fuse

SEARCH = [
    Each(cells.bucket_count, cells.clear_cell),
    Each(grain_count, cells.count_in_cell, atomic=True),
    Serial(cells.end_cells),
    Each(grain_count, cells.fill_cell, atomic=True),
    Each(grain_count, neighbors.find_pairs, atomic=True),
    Each(grain_count, neighbors.find_walls, atomic=True),
    Serial(neighbors.check_capacity),
    If(
        listed,
        [
            Serial(neighbors.fill_rows),
            Each(grain_count, contact_list.match_rows, atomic=True),
        ],
    ),
]

TILES = [Each(grain_count, coloring.gather), Serial(coloring.tile_pairs)]


def only(wanted: bool, stages: list[Stage]) -> list[Stage]:
    """Return stages, or none where they are not wanted."""
    return stages if wanted else []


def sweeping_order(has_friction: bool) -> list[Stage]:
    """Return the stages that sort the list and its corrections into sweeping order."""
    return [
        Serial(coloring.group_pairs),
        Serial(coloring.place_pairs),
        If(coloring.is_tiled, TILES),
        Serial(coloring.place_walls),
        Each(grain_count, contact_list.transfer_warm_start),
        *only(has_friction, [Each(grain_count, friction.transfer_tangential)]),
        Serial(contact_list.find_row_sums),
        *only(has_friction, [Serial(friction.widen_row_sum)]),
    ]


def warm_started(has_friction: bool) -> list[Stage]:
    """Begin an attempt: freeze the contacts, and apply the corrections of the last step."""
    return [
        Each(body_count, warm_start.begin_velocity),
        *only(has_friction, [Each(grain_count, friction.begin_rim)]),
        Sets(friction.start_with_friction if has_friction else warm_start.start),
        Serial(verlet.clear_check),
        Serial(verlet.find_frame),
        Each(body_count, verlet.begin_check),
        Serial(stopping.begin_iterating),
    ]


REBUILD = [
    Each(body_count, residual.begin_rebuild),
    Sets(residual.rebuild),
    Shared(residual.measure_residual),
]

REBUILD_WITH_FRICTION = [
    Each(body_count, residual.begin_rebuild),
    Each(grain_count, friction.begin_rebuilt_rim),
    Sets(friction.rebuild_with_friction),
    Shared(friction.measure_with_friction),
]


def plain_sweeps(sweep: wp.Function, rebuild: list[Stage]) -> list[Stage]:
    """Return the stages that sweep all contacts until the changes, or the residual, are small."""
    return [
        While(
            sweeping,
            [
                Sets(sweep),
                Serial(gauss_seidel.end_sweep),
                If(verlet.is_sampling_due, [Serial(verlet.begin_sampling), Each(body_count, verlet.sample)]),
                If(measuring, [*rebuild, Serial(stopping.end_measurement)]),
            ],
        ),
    ]


GAUSS_SEIDEL = plain_sweeps(gauss_seidel.sweep, REBUILD)
GAUSS_SEIDEL_WITH_FRICTION = plain_sweeps(friction.sweep_with_friction, REBUILD_WITH_FRICTION)


def accelerated_sweeps(has_friction: bool) -> list[Stage]:
    """Sweep the working set with momentum."""
    scatter = [
        Each(part_count, working_set.scatter),
        *only(has_friction, [Each(part_count, accelerated_friction.scatter_tangential)]),
    ]
    check_list = [*scatter, Each(body_count, working_set.check_peak), Serial(stopping.end_list_check)]
    take_rebuilt = [
        Each(body_count, momentum.take_rebuilt_velocity),
        *only(has_friction, [Each(grain_count, accelerated_friction.take_rebuilt_rim)]),
    ]
    measure = [
        *scatter,
        *(REBUILD_WITH_FRICTION if has_friction else REBUILD),
        If(stopping.is_rebuild_due, take_rebuilt),
        Serial(stopping.end_measurement),
    ]
    scan = [
        Sets(working_set.select_set),
        *only(has_friction, [Each(part_count, accelerated_friction.select_tangential)]),
        Serial(working_set.end_scan),
    ]
    return [
        Shared(accelerated.begin_momentum),
        *only(
            has_friction,
            [
                Each(grain_count, accelerated_friction.begin_last_rim),
                Each(contact_count, accelerated_friction.begin_last_dvt),
            ],
        ),
        While(
            iterating,
            [
                If(checking_list, check_list),
                If(measuring, measure),
                If(scanning, scan),
                If(
                    sweeping,
                    [Shared(momentum.extrapolate), *(SWEEP_WITH_FRICTION if has_friction else SWEEP)],
                ),
            ],
        ),
    ]


SWEEP = [
    Sets(accelerated.sweep_ahead),
    Serial(momentum.end_sweep_ahead),
    If(rejected, [Each(part_count, momentum.roll_back), Each(body_count, momentum.roll_back_velocity)]),
]

SWEEP_WITH_FRICTION = [
    Each(grain_count, accelerated_friction.extrapolate_rim),
    Sets(accelerated_friction.sweep_ahead_with_friction),
    Serial(accelerated_friction.end_capped_sweep),
]

ACCELERATED = accelerated_sweeps(False)

ANSWERED = [
    *REBUILD,
    Each(grain_count, exact.take_corrected_velocity),
    Serial(verlet.clear_check),
    Each(grain_count, verlet.begin_peak),
    Serial(stopping.end_correction),
]

EXACT = [If(answered, ANSWERED), *ACCELERATED]


class Kind(NamedTuple):
    """Kind of scenes that share kernels."""

    method: str
    has_friction: bool


METHODS: dict[Kind, list[Stage]] = {
    Kind("gauss-seidel", False): GAUSS_SEIDEL,
    Kind("accelerated", False): ACCELERATED,
    Kind("exact", False): EXACT,
    Kind("gauss-seidel", True): GAUSS_SEIDEL_WITH_FRICTION,
    Kind("accelerated", True): accelerated_sweeps(True),
}


def save(has_friction: bool) -> list[Stage]:
    """Keep the list and what its contacts carry, for the next list."""
    return [
        Each(grain_count, contact_list.save_row),
        Each(contact_list.listed_count, contact_list.save_contact),
        *only(has_friction, [Each(contact_list.listed_count, friction.save_tangential)]),
    ]


def finish(has_friction: bool) -> list[Stage]:
    """Move the grains, and report."""
    return [
        Each(body_count, integrate.move),
        *only(has_friction, [Each(grain_count, friction.turn)]),
        Each(contact_count, warm_start.keep_correction),
        *only(has_friction, [Each(contact_count, friction.keep_tangential)]),
        Serial(integrate.end_step),
        Each(body_count, verlet.remember),
        Serial(verlet.shift_frame),
        Shared(statistics.overlaps),
        Serial(statistics.report),
        Serial(statistics.add_step),
        If(recoloring, [*save(has_friction), Serial(contact_list.color_anew)]),
    ]


def expire(has_friction: bool) -> list[Stage]:
    """Ask for another list."""
    return [
        *save(has_friction),
        Serial(contact_list.expire),
        Serial(skins.adapt_base_skin),
        Each(body_count, skins.renew_skin),
        Serial(skins.renew_numbers),
    ]


def step(kind: Kind) -> list[Stage]:
    """Return the stages of one step of a kind."""
    has_friction = kind.has_friction
    free = [
        Each(grain_count, integrate.free_velocity),
        *only(has_friction, [Each(grain_count, friction.free_spin)]),
    ]
    return [
        Serial(stopping.begin),
        If(beginning, [Serial(integrate.begin_step), *free]),
        While(
            unsolved,
            [
                While(searching, SEARCH),
                If(unordered, sweeping_order(has_friction)),
                Serial(stopping.start_attempt),
                If(
                    attempting,
                    [
                        If(starting, warm_started(has_friction)),
                        *METHODS[kind],
                        Each(body_count, verlet.verify),
                        Serial(stopping.judge),
                        If(accepted, finish(has_friction)),
                        If(expired, expire(has_friction)),
                    ],
                ),
            ],
        ),
    ]


@cache
def fused_step(kind: Kind) -> wp.Function:
    """Return the function that takes one step, `(team, scene)`."""
    return fuse(step(kind))
