"""One step: a list of stages that reads as the algorithm (MODEL.md, "One step").

Whatever runs it asks the host for nothing but room for a list that has grown, and tells it the outcome.
"""

from .accelerated import begin_momentum, sweep_pairs_ahead, sweep_walls_ahead
from .coloring import gather, group_pairs, place_pairs, tile_pairs
from .conditions import (
    accepted,
    attempting,
    iterating,
    measuring,
    rebuilding,
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
from .contact_list import (
    begin_list,
    end_list,
    expire,
    find_row_sums,
    keep_active_pairs,
    save_pairs,
    save_wall,
    transfer_warm_start,
)
from .gauss_seidel import decide, sweep_pairs, sweep_walls
from .integrate import begin_step, free_velocity, move, overlaps, report
from .neighbors import (
    bucket_count,
    clear_cell,
    count_in_cell,
    fill_cell,
    fill_row,
    find_pairs,
    found_count,
    list_walls,
    see_whether_roomy,
    sort_row,
    start_cells,
)
from .residual import begin_rebuild, measure_residual, rebuild_from_pairs, rebuild_from_walls
from .restart import (
    decide_ahead,
    extrapolate,
    roll_back_pair,
    roll_back_velocity,
    roll_back_wall,
    take_rebuilt_velocity,
)
from .skins import adapt_base_skin, find_lifetime, renew_skin
from .stages import Each, If, Serial, Sets, Shared, Stage, While
from .statistics import add_step
from .stopping import begin, begin_iterating, judge, see_whether_listed, stop_on_residual
from .strips import make_strips
from .types import grain_count, pair_count, wall_count
from .verlet import begin_check, clear_check, find_frame, foresee, remember, sample, shift_frame, verify
from .warm_start import begin_attempt, start_pairs, start_walls

SEARCH = [
    Each(bucket_count, clear_cell),
    Each(grain_count, count_in_cell, adds_up=True),
    Serial(start_cells),
    Each(grain_count, fill_cell, adds_up=True),
    Each(grain_count, find_pairs, adds_up=True),
    Serial(see_whether_roomy),
    If(
        roomy,
        [
            Each(found_count, fill_row, adds_up=True),
            Each(grain_count, sort_row),
            Each(grain_count, keep_active_pairs, adds_up=True),
        ],
    ),
]

NEW_LIST = [
    Serial(begin_list),
    While(searching, SEARCH),
    If(roomy, [Serial(list_walls)]),
    Serial(end_list),
]

DEAL_OUT = [Each(grain_count, gather), Serial(make_strips)]


def sweeping_order(threaded: bool) -> list[Stage]:
    """Put the list in the order in which it is swept, and its corrections with it."""
    return [
        Serial(group_pairs),
        Serial(place_pairs),
        If(tiled, [Each(grain_count, gather), Serial(tile_pairs)]),
        *(DEAL_OUT if threaded else []),
        Each(grain_count, transfer_warm_start),
        Serial(find_row_sums),
    ]


WARM_START = [
    Each(grain_count, begin_attempt),
    Sets(start_pairs),
    Shared(start_walls),
    Serial(clear_check),
    Serial(find_frame),
    Each(grain_count, begin_check),
    Each(grain_count, foresee),
    Serial(begin_iterating),
]

MEASURE = [
    Each(grain_count, begin_rebuild),
    Sets(rebuild_from_pairs),
    Shared(rebuild_from_walls),
    Shared(measure_residual),
    Serial(stop_on_residual),
]

GAUSS_SEIDEL = [
    While(
        iterating,
        [
            Sets(sweep_pairs),
            Shared(sweep_walls),
            Serial(decide),
            If(sampling, [Each(grain_count, sample)]),
            If(measuring, MEASURE),
        ],
    ),
]

ACCELERATED = [
    Shared(begin_momentum),
    While(
        iterating,
        [
            Sets(sweep_pairs_ahead),
            Shared(sweep_walls_ahead),
            Serial(decide_ahead),
            If(sampling, [Each(grain_count, sample)]),
            If(
                rejected,
                [
                    Each(pair_count, roll_back_pair),
                    Each(wall_count, roll_back_wall),
                    Each(grain_count, roll_back_velocity),
                ],
            ),
            If(measuring, MEASURE),
            If(rebuilding, [Each(grain_count, take_rebuilt_velocity)]),
            If(iterating, [Shared(extrapolate)]),
        ],
    ),
]

METHODS = {"gauss-seidel": GAUSS_SEIDEL, "accelerated": ACCELERATED}

FINISH = [
    Each(grain_count, move),
    Each(grain_count, remember),
    Serial(shift_frame),
    Shared(overlaps),
    Serial(report),
    Serial(add_step),
]

EXPIRE = [
    Each(grain_count, save_pairs),
    Each(wall_count, save_wall),
    Serial(expire),
    Serial(adapt_base_skin),
    Each(grain_count, renew_skin),
    Serial(find_lifetime),
]


def step(method: str, threaded: bool = False) -> list[Stage]:
    """Return the stages of one step by a method; `threaded` where threads have strips of their own."""
    return [
        Serial(begin),
        If(starting, [Serial(begin_step), Each(grain_count, free_velocity)]),
        While(
            unsolved,
            [
                If(unlisted, NEW_LIST),
                If(unordered, sweeping_order(threaded)),
                Serial(see_whether_listed),
                If(
                    attempting,
                    [
                        *WARM_START,
                        *METHODS[method],
                        Each(grain_count, verify),
                        Serial(judge),
                        If(accepted, FINISH),
                        If(unlisted, EXPIRE),
                    ],
                ),
            ],
        ),
    ]
