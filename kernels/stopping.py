"""Decisions of a step: which phase comes next, when the sweeps stop, and whether the step is taken.

First come the rules, which read numbers and change nothing, then the stages that choose the phase by them.
Sweeps and scans end in other files, by `end_iteration` and `stop_or_sweep`; the phases of a new
list follow each other in neighbors.py and contact_list.py. Accelerated sweeps stop only on the residual, or
after a scan of all contacts: zeta is of the working set, and says nothing of the others.
"""

from enum import IntEnum

import warp as wp

from . import law
from .access import at, first_of, gap_rate_of, normal_of, put, second_of
from .contacts import limits_at
from .driven import closing_speed
from .record import (
    BEYOND_WALL,
    CANCELLED,
    EXPIRED,
    NOT_CONVERGED,
    SLOW,
    SOLVED,
    Phase,
    Scene,
    grain_count,
    has_friction,
    is_accelerated,
    is_driven,
    pair_count,
)
from .threads import reduce_max
from .verlet import check_all, outcome_of_check, reserve

f64 = wp.float64
CHECK_EVERY = wp.constant(10)  # iterations between two checks of the residual
NEARLY = wp.constant(f64(2.0))  # times the tolerance: a zeta from which the residual is worth a check
RECOMPUTE_EVERY = wp.constant(100)  # accelerated iterations between two times that velocities are recomputed
HALF_WAY = wp.constant(
    50
)  # iteration after which the trend of the residual begins, half-way to a recomputation
FRICTION_FROM = wp.constant(300)  # sweeps with friction before the host is asked, whose path is then short
SCAN_EVERY = wp.constant(10)  # accelerated sweeps between two scans, and
FIRST_SCANS = wp.constant(8)  # sweeps within which powers of two are followed by one


class StopOn(IntEnum):
    """The quantity that the tolerance bounds, by the names of `warpgrains.scene.fields.STOPS`."""

    ZETA = 0
    RESIDUAL = 1


@wp.func
def is_power_of_two(number: int) -> bool:
    """Return whether a number is 1, 2, 4, 8, ..."""
    return number & (number - 1) == 0


@wp.func
def has_iterations_left(s: Scene) -> bool:
    """Return whether max_iterations allows another iteration, and nobody has cancelled the step."""
    return s.step.iterations < s.stopping.max_iterations and s.control.cancelled == 0


@wp.func
def stops_on_zeta(s: Scene) -> bool:
    """Return whether the tolerance is on zeta, which every sweep finds, or on what is measured at times."""
    return s.stopping.on == StopOn.ZETA


@wp.func
def meets_tolerance(s: Scene) -> bool:
    """Return whether the last residual, or zeta of a sweep over all contacts, meets the tolerance."""
    if stops_on_zeta(s):
        return s.step.zeta <= s.stopping.tolerance and s.control.rejected == 0
    return s.step.residual <= s.stopping.tolerance


@wp.func
def is_last_iteration(s: Scene) -> bool:
    """Return whether the sweeps end here; a residual decides that later, where it is measured."""
    return not has_iterations_left(s) or (stops_on_zeta(s) and meets_tolerance(s))


@wp.func
def is_measured(s: Scene) -> bool:
    """Return whether the residual of the last iteration has been measured, with the list before."""
    return s.step.measured == s.step.iterations


@wp.func
def is_check_due(s: Scene) -> bool:
    """Return whether the residual may meet the tolerance: now and then, and when zeta is near it."""
    iterations = s.step.iterations
    if stops_on_zeta(s) or s.control.rejected != 0 or is_measured(s):
        return False
    sparse = iterations == 1 or iterations % CHECK_EVERY == 0
    return sparse and s.step.zeta <= NEARLY * s.stopping.tolerance


@wp.func
def is_recomputing_due(s: Scene) -> bool:
    """Return whether accelerated sweeps continue from the velocities with which the residual is measured."""
    if not is_accelerated(s) or is_measured(s):
        return False
    now_and_then = s.control.rejected == 0 and s.step.iterations % RECOMPUTE_EVERY == 0
    return now_and_then or is_check_due(s)


@wp.func
def is_half_way(s: Scene) -> bool:
    """Return whether the trend of the residual begins, by which a step is handed to the host."""
    return s.step.patience > 0 and s.step.iterations == HALF_WAY


@wp.func
def is_trend_due(s: Scene) -> bool:
    """Return whether the decay of the residual is checked: half-way to the first recomputation, and at each.

    A residual that is measured for the history alone decides nothing.
    """
    if s.step.patience <= 0 or s.control.phase == Phase.RECORD:
        return False
    return is_half_way(s) or s.step.iterations % RECOMPUTE_EVERY == 0


@wp.func
def is_measurement_due(s: Scene) -> bool:
    """Return whether the residual is measured: always after the last iteration, also with another list."""
    half_way = is_half_way(s) and not is_measured(s)
    return s.control.may_stop != 0 or half_way or is_check_due(s)


@wp.func
def is_record_due(s: Scene) -> bool:
    """Return whether the history still needs the residual of the last iteration."""
    return not is_measured(s) and s.step.iterations <= s.history.zeta.shape[0]


@wp.func
def is_scan_due(iterations: int) -> bool:
    """Return whether all contacts are scanned after this many sweeps: impacts spread fast at first."""
    early = iterations <= FIRST_SCANS and is_power_of_two(iterations)
    return early or iterations % SCAN_EVERY == 0


@wp.func
def is_pause_due(s: Scene) -> bool:
    """Return whether to pause for another list: not at once, so that grains show how far they must reach."""
    return s.verlet.flags.list_expired != 0 and is_power_of_two(s.step.iterations)


@wp.func
def is_too_slow(s: Scene) -> bool:
    """Extrapolate the decay of the residual; return whether the sweeps left cost more than the host.

    The decay counts as that of RECOMPUTE_EVERY sweeps at most. It is that of more where the residual was not
    measured in between, because a sweep was rejected; then the host is asked later.
    """
    if s.step.iterations <= HALF_WAY or (has_friction(s) and s.step.iterations < FRICTION_FROM):
        return False
    fallen = wp.log(s.step.trend_residual / s.step.residual)
    left = wp.log(s.step.residual / s.stopping.tolerance)
    sweeps = wp.min(s.step.iterations - HALF_WAY, RECOMPUTE_EVERY)
    return left * f64(sweeps) > fallen * f64(s.step.patience)


@wp.func
def phase_of_next_sweep(s: Scene) -> int:
    """Return SWEEP, unless the sweeps stop or pause for another list."""
    if s.control.may_stop != 0 or (is_pause_due(s) and not is_accelerated(s)):
        return Phase.VERIFY
    return Phase.SWEEP


@wp.func
def measurement_or(s: Scene, following: int) -> int:
    """Return the phase that measures the residual, for sweeps, stop or history, if due; else another."""
    if is_recomputing_due(s):
        return Phase.RECOMPUTE
    if is_measurement_due(s):
        return Phase.MEASURE
    if is_record_due(s):
        return Phase.RECORD
    return following


@wp.func
def phase_after_sweep(s: Scene) -> int:
    """Return what follows on an iteration that is counted."""
    due = is_recomputing_due(s) or is_measurement_due(s) or is_scan_due(s.step.iterations)
    if is_accelerated(s) and due:
        return Phase.CHECK_LIST
    return measurement_or(s, phase_of_next_sweep(s))


@wp.func
def stop_or_sweep(s: Scene):
    """Stop after the last sweep; a scan has found what zeta is of all contacts."""
    s.control.may_stop = 1 if s.step.iterations > 0 and is_last_iteration(s) else 0
    s.control.phase = phase_of_next_sweep(s)


@wp.func
def end_iteration(s: Scene, zeta: f64):
    """Count an iteration of this zeta [m/s], which may be the last, and choose what follows."""
    iterations = s.step.iterations + 1
    s.step.iterations = iterations
    s.step.zeta = zeta
    if iterations <= s.history.zeta.shape[0]:
        put(s.history.zeta, iterations - 1, zeta)
    s.control.may_stop = 1 if is_last_iteration(s) else 0
    s.control.phase = phase_after_sweep(s)


@wp.func
def end_list_check(s: Scene):
    """Pause if the list does not hold: all contacts are scanned with the next one. Otherwise continue."""
    if s.verlet.flags.list_expired != 0:
        s.control.phase = Phase.VERIFY
    else:
        s.control.phase = measurement_or(s, Phase.SCAN)


@wp.func
def take_residual(s: Scene):
    """Take the residual that threads have measured as that of the last iteration."""
    s.step.residual = reduce_max(s.partial.residual)
    s.step.measured = s.step.iterations
    if s.step.iterations <= s.history.residual.shape[0]:
        put(s.history.residual, s.step.iterations - 1, s.step.residual)


@wp.func
def end_measurement(s: Scene):
    """Stop if the residual meets the tolerance or falls too slowly, unless it is for the history alone."""
    take_residual(s)
    decides = s.control.phase != Phase.RECORD
    stopping = decides and not stops_on_zeta(s) and meets_tolerance(s)
    if is_trend_due(s):
        stopping = stopping or is_too_slow(s)
        s.step.trend_residual = s.step.residual
    if stopping:
        s.control.may_stop = 1
        s.control.phase = Phase.VERIFY
    elif is_accelerated(s) and (decides or is_scan_due(s.step.iterations)):
        s.control.phase = Phase.SCAN
    else:
        s.control.phase = phase_of_next_sweep(s)


@wp.func
def end_correction(s: Scene):
    """Continue with sweeps unless the solution of the step by the host (CPU) meets the tolerance."""
    take_residual(s)
    s.step.trend_residual = s.step.residual
    s.control.rejected = 0
    s.control.may_stop = 1 if meets_tolerance(s) or not has_iterations_left(s) else 0
    s.control.phase = Phase.VERIFY if s.control.may_stop != 0 else Phase.CHECK_LIST


@wp.func
def begin(s: Scene):
    """Begin a step, or continue one that waited for the host.

    Sweeps resume where they were if the host has declined to solve the step.
    """
    if s.control.phase == Phase.FULL:
        s.control.phase = Phase.SEARCH
    elif s.control.phase == Phase.CORRECTED:
        s.control.resuming = 0
    elif s.control.phase == Phase.DECLINED:
        s.control.resuming = 1
    else:
        s.control.phase = Phase.BEGIN
        s.control.resuming = 0
        s.step.patience = s.stopping.patience
        s.step.rebuilds = 0
        s.step.restarts = 0
        s.step.factorizations = 0


@wp.func
def start_attempt(s: Scene):
    """Start an attempt to solve the step, with a list that is sorted now, unless the list does not fit."""
    s.control.unordered = 0
    if s.control.phase == Phase.BEGIN or s.control.phase == Phase.LISTED:
        s.control.phase = Phase.START
        s.verlet.flags.without_normal = 0


@wp.func
def begin_iterating(s: Scene):
    """Iterate if the list is likely to hold for the velocities before the first iteration.

    An accelerated attempt that may stop is measured again, with the list that it has now.
    """
    check_all(s, reserve(s))
    if s.control.resuming == 0:
        s.step.iterations = 0
        s.step.measured = 0
        s.control.may_stop = 0
        s.control.rejected = 0
    if outcome_of_check(s) != SOLVED:
        s.control.phase = Phase.VERIFY
    elif is_accelerated(s):
        s.control.phase = Phase.CHECK_LIST
    else:
        s.control.phase = phase_of_next_sweep(s)


@wp.func
def grain_beyond_wall(s: Scene) -> int:
    """Return the first grain that moves beyond a wall, or -1.

    It moves along a round wall by more than its circle is wide, or at all by more than its gap to a wall that
    has no normal where it is.
    """
    found, velocity, contact = int(-1), s.grains.next_velocity, s.contacts.contact
    for w in range(s.contacts.count.walls):
        c = pair_count(s) + w
        i, n = first_of(contact, c), normal_of(contact, c)
        v = at(velocity, i)
        path, most = wp.abs(law.speed_along(v, n)), limits_at(s.contacts.limits, w)[1]
        if wp.length_sq(n) == f64(0.0):
            path, most = wp.length(v), gap_rate_of(contact, c)
            if is_driven(s):
                path = path + closing_speed(s, velocity, i, second_of(contact, c), n)
        if path > most and (found < 0 or i < found):
            found = i
    return found


@wp.func
def is_circle_closed(s: Scene) -> bool:
    """Return whether a driven outer circle would become so small that the smallest grain does not fit."""
    outer = grain_count(s)
    radius = at(s.grains.position, outer)[0] + s.dt * at(s.grains.next_velocity, outer)[0]
    return not (radius >= s.tuning.smallest_radius)


@wp.func
def judge(s: Scene):
    """Accept the step, repeat it with a new list, or refuse it."""
    check_all(s, s.tuning.rounding)
    converged = meets_tolerance(s)
    outcome = outcome_of_check(s)
    if outcome == SOLVED and not converged:
        if s.step.patience != 0:
            outcome = SLOW
        elif s.stopping.raise_on_unconverged != 0:
            outcome = NOT_CONVERGED
    if outcome == SOLVED and (s.walls.annulus.round != 0 or s.verlet.flags.without_normal != 0):
        s.verlet.flags.bad_body = grain_beyond_wall(s)
        if s.verlet.flags.bad_body >= 0:
            outcome = BEYOND_WALL
    if outcome == SOLVED and is_driven(s) and is_circle_closed(s):
        s.verlet.flags.bad_body = grain_count(s)
        outcome = BEYOND_WALL
    if s.control.cancelled != 0 and not (converged and is_measured(s)):
        outcome = CANCELLED  # perhaps during a scan, with the residual of another iteration
    s.step.converged = 1 if converged else 0
    s.step.outcome = outcome
    if outcome == SOLVED:
        s.control.phase = Phase.ACCEPTED
    elif outcome == EXPIRED:
        s.control.phase = Phase.EXPIRE
    else:
        s.control.phase = Phase.ENDED
