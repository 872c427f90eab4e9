"""One step: a list of stages that reads as the algorithm (MODEL.md, "One step").

Whatever runs it asks the host for nothing but room for a list that has grown, and the corrections of a step
that its sweeps do not converge, and tells it the outcome. That an attempt goes on with another list
(`resuming`), and does not start again, is what stages of both see by themselves.
A scene without a list begins as one whose list has expired: no skin suffices, so nothing is iterated.
"""

from functools import cache

import warp as wp

from . import (
    accelerated,
    cells,
    coloring,
    contact_list,
    dealing,
    exact,
    friction,
    gauss_seidel,
    integrate,
    neighbors,
    residual,
    restart,
    skins,
    statistics,
    stopping,
    verlet,
    warm_start,
    working_set,
)
from .conditions import (
    accepted,
    attempting,
    corrected,
    fresh,
    iterating,
    looking,
    measuring,
    rebuilding,
    recoloring,
    rejected,
    roomy,
    sampling,
    searching,
    starting,
    tiled,
    unlisted,
    unordered,
    unsolved,
)
from .contacts import contact_count, part_count
from .record import grain_count
from .stages import Each, If, Serial, Sets, Shared, Stage, While, fuse

SEARCH = [
    Each(cells.bucket_count, cells.clear_cell),
    Each(grain_count, cells.count_in_cell, adds_up=True),
    Serial(cells.end_cells),
    Each(grain_count, cells.fill_cell, adds_up=True),
    Each(grain_count, neighbors.find_pairs, adds_up=True),
    Each(grain_count, neighbors.find_walls, adds_up=True),
    Serial(neighbors.see_whether_roomy),
    If(
        roomy,
        [
            Serial(neighbors.fill_rows),
            Each(grain_count, contact_list.match_rows, adds_up=True),
        ],
    ),
]

NEW_LIST = [
    Serial(contact_list.begin_list),
    While(searching, SEARCH),
    Serial(contact_list.end_list),
]

TILES = [Each(grain_count, coloring.gather), Serial(coloring.tile_pairs)]
DEAL_OUT = [*TILES, Each(grain_count, coloring.gather), Serial(dealing.deal_out)]


def only(wanted: bool, stages: list[Stage]) -> list[Stage]:
    """Return stages, or none where they are not wanted."""
    return stages if wanted else []


def sweeping_order(dealt: bool, has_friction: bool) -> list[Stage]:
    """Put the list in the order in which it is swept, and its corrections with it."""
    return [
        Serial(coloring.group_pairs),
        Serial(coloring.place_pairs),
        *(DEAL_OUT if dealt else [If(tiled, TILES)]),
        Serial(coloring.place_walls),
        Each(grain_count, contact_list.transfer_warm_start),
        *only(has_friction, [Each(grain_count, friction.transfer_tangential)]),
        Serial(contact_list.find_row_sums),
        *only(has_friction, [Serial(friction.widen_row_sum)]),
    ]


def warm_started(has_friction: bool) -> list[Stage]:
    """Begin an attempt: freeze the contacts, and apply the corrections of the last step."""
    return [
        Each(grain_count, warm_start.begin_attempt),
        *only(has_friction, [Each(grain_count, friction.begin_rim)]),
        Sets(friction.start_with_friction if has_friction else warm_start.start),
        Serial(verlet.clear_check),
        Serial(verlet.find_frame),
        Each(grain_count, verlet.begin_check),
        Serial(stopping.begin_iterating),
    ]


REBUILD = [
    Each(grain_count, residual.begin_rebuild),
    Sets(residual.rebuild),
    Shared(residual.measure_residual),
]

REBUILD_WITH_FRICTION = [
    Each(grain_count, residual.begin_rebuild),
    Each(grain_count, friction.begin_rebuilt_rim),
    Sets(friction.rebuild_with_friction),
    Shared(friction.measure_with_friction),
]

MEASURE = [*REBUILD, Serial(stopping.stop_on_residual)]
MEASURE_WITH_FRICTION = [*REBUILD_WITH_FRICTION, Serial(stopping.stop_on_residual)]


def plain_sweeps(sweep: wp.Function, measure: list[Stage]) -> list[Stage]:
    """Sweep all contacts until the changes, or the residual, are small."""
    return [
        While(
            iterating,
            [
                Sets(sweep),
                Serial(gauss_seidel.decide),
                If(sampling, [Each(grain_count, verlet.sample)]),
                If(measuring, measure),
            ],
        ),
    ]


GAUSS_SEIDEL = plain_sweeps(gauss_seidel.sweep, MEASURE)
GAUSS_SEIDEL_WITH_FRICTION = plain_sweeps(friction.sweep_with_friction, MEASURE_WITH_FRICTION)


PUT_BACK = [Each(part_count, working_set.put_back)]

PAUSE = [*PUT_BACK, Each(grain_count, working_set.see_skin), Serial(working_set.pause_unless_listed)]

LOOK = [
    Sets(working_set.select_set),
    Serial(working_set.see_whether_done),
]

ROLL_BACK = [
    Each(part_count, restart.roll_back),
    Each(grain_count, restart.roll_back_velocity),
]


def sweeps_ahead(decide: wp.Function, measure: list[Stage]) -> list[Stage]:
    """Sweep the working set with momentum, as far as two functions find it worth while."""
    return [
        Shared(accelerated.begin_momentum),
        While(
            iterating,
            [
                If(looking, PAUSE),
                If(
                    iterating,
                    [
                        If(measuring, [*PUT_BACK, *measure]),
                        If(rebuilding, [Each(grain_count, restart.take_rebuilt_velocity)]),
                    ],
                ),
                If(iterating, [If(looking, LOOK)]),
                If(
                    iterating,
                    [
                        Shared(restart.extrapolate),
                        Sets(accelerated.sweep_ahead),
                        Serial(decide),
                        If(rejected, ROLL_BACK),
                    ],
                ),
            ],
        ),
    ]


ACCELERATED = sweeps_ahead(restart.decide_ahead, MEASURE)

CORRECTED = [
    *REBUILD,
    Each(grain_count, exact.take_corrected_velocity),
    Serial(verlet.clear_check),
    Each(grain_count, verlet.begin_peak),
    Serial(exact.go_on),
]

EXACT = [
    If(corrected, CORRECTED),
    *sweeps_ahead(exact.decide_exactly, [*MEASURE, Serial(exact.stop_when_slow)]),
]

Kind = tuple[str, bool]
"""Method, and whether there is friction."""
METHODS: dict[Kind, list[Stage]] = {
    ("gauss-seidel", False): GAUSS_SEIDEL,
    ("accelerated", False): ACCELERATED,
    ("exact", False): EXACT,
    ("gauss-seidel", True): GAUSS_SEIDEL_WITH_FRICTION,
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
        Each(grain_count, integrate.move),
        *only(
            has_friction, [Each(grain_count, friction.turn), Each(contact_count, friction.keep_correction)]
        ),
        Serial(integrate.stagger),
        Each(grain_count, verlet.remember),
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
        Each(grain_count, skins.renew_skin),
        Serial(skins.find_lifetime),
    ]


def step(kind: Kind, dealt: bool = False) -> list[Stage]:
    """Return the stages of one step of a kind; `dealt` where threads are dealt tiles."""
    has_friction = kind[1]
    free = [
        Each(grain_count, integrate.free_velocity),
        *only(has_friction, [Each(grain_count, friction.free_spin)]),
    ]
    return [
        Serial(stopping.begin),
        If(starting, [Serial(integrate.begin_step), *free]),
        While(
            unsolved,
            [
                If(unlisted, NEW_LIST),
                If(unordered, sweeping_order(dealt, has_friction)),
                Serial(stopping.see_whether_listed),
                If(
                    attempting,
                    [
                        If(fresh, warm_started(has_friction)),
                        *METHODS[kind],
                        Each(grain_count, verlet.verify),
                        Serial(stopping.judge),
                        If(accepted, finish(has_friction)),
                        If(unlisted, expire(has_friction)),
                    ],
                ),
            ],
        ),
    ]


@cache
def fused_step(kind: Kind, dealt: bool) -> wp.Function:
    """Return the function that takes one step, `(team, scene)`."""
    return fuse(step(kind, dealt))
