"""One step: a list of stages that reads as the algorithm (MODEL.md, "One step").

A step waits for the host in two cases: the list exceeds its capacity (LIST_FULL), or sweeps converge too
slowly or reach their limit, and the host solves the step (SLOW). Conditions read the phase of the step
(`Phase`, record.py).

If the list expires during accelerated sweeps, these resume with another list (`Control.resuming`) and keep
velocities, corrections and momentum. Plain sweeps may have missed a contact: they start again from the free
velocities, with wider skins (contact_list.expire, skins.renew_skin).

A scene without a list begins like a scene whose list has expired. All skins are negative then: the first
attempt does not iterate (attempt.begin_iterating), and asks for a list (attempt.judge).
"""

from functools import cache

import warp as wp

from . import integrate, statistics
from .access import named
from .contacts import chunk_count, contact_count
from .record import Kind, Outcome, Phase, Scene, body_count, grain_count
from .search import cells, coloring, contact_list, neighbors, skins, verlet
from .sweeps import attempt, momentum, residual, stopping, sweep, warm_start, working_set
from .team.stages import Each, If, Serial, Sets, Shared, Stage, While, fuse


def in_phase(*phases: Phase) -> wp.Function:
    """Return the Warp function `(scene)` that returns whether the step is in one of these phases."""
    bits = sum(1 << phase for phase in phases)

    @named("_or_".join(phase.name.lower() for phase in phases))
    def holds(s: Scene) -> bool:
        return (wp.static(bits) >> s.control.phase) & 1 != 0

    return holds


unsolved = in_phase(*set(Phase) - {Phase.ENDED, Phase.LIST_FULL, Phase.SLOW})
searching = in_phase(Phase.SEARCH)
starting = in_phase(Phase.START)
answered = in_phase(Phase.ANSWERED)
attempting = in_phase(Phase.START, Phase.ANSWERED)
scanning = in_phase(Phase.SCAN)
sweeping = in_phase(Phase.SWEEP)


@wp.func
def solved(s: Scene) -> bool:
    """Return whether the step is accepted."""
    return s.control.phase == Phase.ENDED and s.step.outcome == Outcome.SOLVED


@wp.func
def unordered(s: Scene) -> bool:
    """Return whether the list has still to be sorted into the order of the sweep."""
    return s.control.unordered != 0


@wp.func
def fresh(s: Scene) -> bool:
    """Return whether sweeps start from the free velocities; otherwise they resume with another list."""
    return s.control.resuming == 0


@wp.func
def rejected(s: Scene) -> bool:
    """Return whether the last sweep has been rejected and must be rolled back."""
    return s.control.rejected != 0


SEARCH = [
    Each(cells.bucket_count, cells.clear_cell),
    Each(grain_count, cells.count_in_cell, atomic=True),
    Serial(cells.end_cells),
    Each(grain_count, cells.fill_cell, atomic=True),
    Shared(neighbors.find_contacts),
    Serial(neighbors.check_capacity),
    If(
        unordered,
        [
            Serial(contact_list.fill_rows),
            Each(grain_count, contact_list.match_rows),
        ],
    ),
]

ORDER = [
    Serial(coloring.choose_sets),
    Serial(coloring.order_contacts),
    Each(grain_count, contact_list.transfer_warm_start),
    Serial(contact_list.find_row_sums),
]
"""Sort the list and its corrections into the order of the sweep."""

MONITOR_START = [Each(body_count, verlet.monitor_start)]
"""Include the velocities before the step in the peak deviations, because bouncing contacts depend on them."""


def start(kind: Kind) -> list[Stage]:
    """Return the stages that compute normals and gaps, apply the corrections kept, and check the list.

    If sweeps resume, the corrections are part of the velocities already.
    """
    return [
        If(fresh, [Each(body_count, warm_start.begin_velocity)]),
        Sets(warm_start.starting(kind)),
        Serial(verlet.clear_check),
        Serial(verlet.find_frame),
        Each(body_count, verlet.begin_check),
        *(MONITOR_START if kind.has_restitution else []),
        Serial(attempt.begin_iterating),
    ]


def recompute(kind: Kind) -> list[Stage]:
    """Return the stages that recompute the velocities from the corrections, and measure the residual."""
    return [
        Each(body_count, residual.begin_recomputing),
        Sets(residual.recompute),
        Shared(residual.measuring(kind.has_friction, kind.has_rolling)),
    ]


def plain_sweeps(kind: Kind) -> list[Stage]:
    """Return the stages that sweep all contacts until zeta or the residual meets the tolerance."""
    return [
        While(
            sweeping,
            [
                Sets(sweep.sweeping(kind.has_friction, kind.has_rolling, ahead=False)),
                Serial(sweep.end_sweep),
                If(verlet.is_sampling_due, [Each(body_count, verlet.sample), Serial(verlet.end_sampling)]),
                If(stopping.is_residual_needed, [*recompute(kind), Serial(stopping.end_measurement)]),
            ],
        ),
    ]


def sweep_ahead(kind: Kind) -> list[Stage]:
    """Return the stages of an accelerated sweep: extrapolate, sweep the working set, perhaps roll back."""
    roll_back = [Each(chunk_count, momentum.roll_back), Each(body_count, momentum.roll_back_velocity)]
    return [
        Shared(momentum.extrapolate_with_friction if kind.has_friction else momentum.extrapolate),
        Sets(sweep.sweeping(kind.has_friction, kind.has_rolling, ahead=True)),
        Serial(sweep.end_sweep),
        *([] if kind.has_friction else [If(rejected, roll_back)]),
    ]


def accelerated_sweeps(kind: Kind) -> list[Stage]:
    """Return the stages that sweep the working set with momentum, and scan all contacts between two bouts."""
    scatter = Each(chunk_count, working_set.scatter)
    check_list = [scatter, Each(body_count, working_set.check_peak), Serial(stopping.end_list_check)]
    measure = [
        *recompute(kind),
        If(stopping.is_measurement_due, [Each(body_count, momentum.take_recomputed_velocity)]),
        Serial(stopping.end_measurement),
    ]
    scan = [Sets(working_set.select_set), Serial(working_set.end_scan)]
    record = [scatter, *recompute(kind), Serial(stopping.take_residual)]
    bout = [*sweep_ahead(kind), If(stopping.is_recorded_during_bout, record)]
    return [
        Each(chunk_count, working_set.empty),
        If(fresh, [Shared(momentum.begin_momentum)]),
        While(
            scanning,
            [
                *check_list,
                If(scanning, [If(stopping.is_residual_needed, measure), If(scanning, scan)]),
                While(sweeping, bout),
            ],
        ),
    ]


def exact(kind: Kind) -> list[Stage]:
    """Return the stages that measure the host's corrections, if any, and then sweep as accelerated."""
    answer = [
        *recompute(kind),
        Each(body_count, residual.take_corrected_velocity),
        Serial(verlet.clear_check),
        Each(body_count, verlet.begin_peak),
        *(MONITOR_START if kind.has_restitution else []),
        Serial(stopping.end_correction),
    ]
    return [If(answered, answer), *accelerated_sweeps(kind)]


METHODS = {"gauss-seidel": plain_sweeps, "accelerated": accelerated_sweeps, "exact": exact}

SAVE = [Each(grain_count, contact_list.save_row), Each(contact_list.listed_count, contact_list.save_contact)]
"""Stages that save the list and the corrections of its contacts, for the start of the next list."""


def finish(kind: Kind) -> list[Stage]:
    """Return the stages that move the grains and report the step."""
    return [
        Each(body_count, integrate.move),
        Each(contact_count, warm_start.keep),
        Serial(integrate.end_step),
        Each(body_count, verlet.remember),
        Serial(verlet.shift_frame),
        Shared(statistics.overlaps),
        Serial(statistics.report),
    ]


def expire(has_restitution: bool) -> list[Stage]:
    """Return the stages that save the list, and choose the skins and lifetime of the next list."""
    return [
        *SAVE,
        Serial(contact_list.expire),
        Serial(skins.adapt_base_skin),
        Each(body_count, skins.renew_skin),
        *([Each(body_count, skins.widen_for_start)] if has_restitution else []),
        Serial(skins.renew_numbers),
    ]


def step(kind: Kind) -> list[Stage]:
    """Return the stages of one step of a scene of this kind."""
    return [
        Serial(attempt.begin),
        If(starting, [Serial(integrate.begin_step), Each(body_count, integrate.free_velocity)]),
        While(
            unsolved,
            [
                While(searching, SEARCH),
                If(unordered, ORDER),
                Serial(attempt.start),
                If(
                    attempting,
                    [
                        If(starting, start(kind)),
                        *METHODS[kind.method](kind),
                        Each(body_count, verlet.verify),
                        Serial(attempt.judge),
                        If(solved, finish(kind)),
                        If(searching, expire(kind.has_restitution)),
                    ],
                ),
            ],
        ),
    ]


@cache
def fused_step(kind: Kind) -> wp.Function:
    """Return the function `(team, scene)` that takes one step of a scene of this kind."""
    return fuse(step(kind))
