"""When the sweeps of a step stop, and when the residual is measured.

First come the rules, which read numbers and change nothing, then the stages that choose the phase by them.
Sweeps and scans end in other files, by `end_iteration` and `stop_or_sweep`.

Plain sweeps follow one another until they stop. Accelerated ones come in bouts, between which the list is
checked, the residual measured if that is due, and all contacts scanned for the working set. They stop only
between two bouts: zeta is of the working set, and says nothing of the other contacts. A measurement is only
due where a bout ends.
"""

from enum import IntEnum

import warp as wp

from ..access import put
from ..record import Asking, Phase, Scene, has_friction, has_swept, is_accelerated, is_cancelled
from ..team.threads import take_max

f64 = wp.float64
CHECK_EVERY = wp.constant(10)  # iterations between two checks of the residual
NEARLY = wp.constant(f64(2.0))  # times the tolerance: a zeta from which the residual is worth a check
RECOMPUTE_EVERY = wp.constant(100)  # accelerated iterations between two times that velocities are recomputed
HALF_WAY = wp.constant(50)  # iteration after which the trend of the residual begins
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
    return s.step.iterations < s.stopping.max_iterations and not is_cancelled(s)


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
def is_measurement_due(s: Scene) -> bool:
    """Return whether the residual is measured: always after the last iteration, also with another list.

    Otherwise it is where it may meet the tolerance, which zeta tells. Accelerated sweeps also need the
    velocities that are recomputed for it.
    """
    k = s.step.iterations
    if s.control.may_stop != 0 or is_measured(s):
        return s.control.may_stop != 0
    may_meet = not stops_on_zeta(s) and s.step.zeta <= NEARLY * s.stopping.tolerance
    checking = may_meet and (k == 1 or k % CHECK_EVERY == 0)
    return s.control.rejected == 0 and (checking or (is_accelerated(s) and k % RECOMPUTE_EVERY == 0))


@wp.func
def is_scan_due(iterations: int) -> bool:
    """Return whether all contacts are scanned after this many sweeps: impacts spread fast at first."""
    early = iterations <= FIRST_SCANS and is_power_of_two(iterations)
    return early or iterations % SCAN_EVERY == 0


@wp.func
def is_too_slow(s: Scene) -> bool:
    """Extrapolate the decay of the residual; return whether the sweeps left cost more than the host.

    The decay counts as that of RECOMPUTE_EVERY sweeps at most. It is that of more where the residual was not
    measured in between, because a sweep was rejected; then the host is asked later.
    """
    if has_friction(s) and s.step.iterations < FRICTION_FROM:
        return False
    fallen = wp.log(s.step.trend_residual / s.step.residual)
    left = wp.log(s.step.residual / s.stopping.tolerance)
    sweeps = wp.min(s.step.iterations - HALF_WAY, RECOMPUTE_EVERY)
    return left * f64(sweeps) > fallen * f64(s.stopping.patience)


@wp.func
def is_recorded(s: Scene) -> bool:
    """Return whether the history has a residual of the last iteration."""
    return s.step.iterations <= s.history.zeta.shape[0]


@wp.func
def is_residual_needed(s: Scene) -> bool:
    """Return whether the residual is measured now: where it is due, recorded, or begins the trend."""
    begins_trend = s.step.asking == Asking.EARLY and s.step.iterations == HALF_WAY
    return is_measurement_due(s) or (not is_measured(s) and (is_recorded(s) or begins_trend))


@wp.func
def is_recorded_during_bout(s: Scene) -> bool:
    """Return whether the history has a residual after which the bout goes on."""
    return s.control.phase == Phase.SWEEP and is_recorded(s)


@wp.func
def stop_or_sweep(s: Scene):
    """Stop after the last sweep; a scan has found what zeta is of all contacts."""
    s.control.may_stop = 1 if has_swept(s) and is_last_iteration(s) else 0
    s.control.phase = Phase.VERIFY if s.control.may_stop != 0 else Phase.SWEEP


@wp.func
def end_iteration(s: Scene, zeta: f64):
    """Count an iteration of this zeta [m/s], which may be the last or end a bout.

    Plain sweeps go on with a list that has expired to iteration 1, 2, 4, 8, ...: how far grains deviate until
    then tells how wide the skins of the next list must be.
    """
    iterations = s.step.iterations + 1
    s.step.iterations = iterations
    s.step.zeta = zeta
    if iterations <= s.history.zeta.shape[0]:
        put(s.history.zeta, iterations - 1, zeta)
    stopping = is_last_iteration(s)
    s.control.may_stop = 1 if stopping else 0
    if is_accelerated(s):
        if stopping or is_scan_due(iterations):
            s.control.phase = Phase.SCAN
    elif stopping or (s.verlet.flags.list_expired != 0 and is_power_of_two(iterations)):
        s.control.phase = Phase.VERIFY


@wp.func
def end_list_check(s: Scene):
    """Pause if the list does not hold: all contacts are scanned with the next one."""
    if s.verlet.flags.list_expired != 0:
        s.control.phase = Phase.VERIFY


@wp.func
def take_residual(s: Scene):
    """Take the residual that threads have measured as that of the last iteration."""
    s.step.residual = take_max(s.partial.residual)
    s.step.measured = s.step.iterations
    if s.step.iterations <= s.history.residual.shape[0]:
        put(s.history.residual, s.step.iterations - 1, s.step.residual)


@wp.func
def end_measurement(s: Scene):
    """Stop if the residual meets the tolerance or falls too slowly, unless it is for a record alone."""
    decides = is_measurement_due(s)
    take_residual(s)
    stopping = decides and not stops_on_zeta(s) and meets_tolerance(s)
    if decides and s.step.asking == Asking.EARLY and s.step.iterations % RECOMPUTE_EVERY == 0:
        stopping = stopping or is_too_slow(s)
        s.step.trend_residual = s.step.residual
    elif s.step.iterations == HALF_WAY:
        s.step.trend_residual = s.step.residual
    if stopping:
        s.control.may_stop = 1
        s.control.phase = Phase.VERIFY


@wp.func
def end_correction(s: Scene):
    """Continue with sweeps unless the solution of the step by the host (CPU) meets the tolerance."""
    take_residual(s)
    s.step.trend_residual = s.step.residual
    s.control.rejected = 0
    s.control.may_stop = 1 if meets_tolerance(s) or not has_iterations_left(s) else 0
    s.control.phase = Phase.VERIFY if s.control.may_stop != 0 else Phase.SCAN
