"""Rules that decide when the sweeps of a step stop, and when the residual is measured.

First come the rules, which change nothing, then the stages that choose the phase by these rules. Stages of
other files call `end_iteration` after a sweep and `stop_or_sweep` after a scan.

Plain sweeps follow one another until they stop. Accelerated sweeps are grouped in bouts. Between two bouts
the list is checked, the residual is measured if necessary, and all contacts are scanned for the working set.
Accelerated sweeps stop only between two bouts, because zeta covers the working set, but no other contacts. So
a residual that decides is measured only at the end of a bout.
"""

from enum import IntEnum

import warp as wp

from ..access import put
from ..record import HostRequest, Phase, Scene, has_friction, has_swept, is_accelerated, is_cancelled
from ..team.threads import take_max

f64 = wp.float64
CHECK_EVERY = wp.constant(10)  # iterations between two checks of the residual
NEARLY = wp.constant(f64(2.0))  # the residual is checked only if zeta <= NEARLY * tolerance
RECOMPUTE_EVERY = wp.constant(100)  # accelerated iterations between two recomputations of the velocities
HALF_WAY = wp.constant(50)  # iteration after which the trend of the residual begins
FRICTION_FROM = wp.constant(300)  # sweeps with friction before the host is asked: its path is short then
SCAN_EVERY = wp.constant(10)  # accelerated sweeps between two scans
FIRST_SCANS = wp.constant(8)  # up to this sweep, scans follow sweeps 1, 2, 4, 8 as well


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
    """Return whether max_iterations allows another iteration, and the step is not cancelled."""
    return s.step.iterations < s.stopping.max_iterations and not is_cancelled(s)


@wp.func
def stops_on_zeta(s: Scene) -> bool:
    """Return whether the tolerance bounds zeta, which each sweep yields, rather than the residual."""
    return s.stopping.on == StopOn.ZETA


@wp.func
def meets_tolerance(s: Scene) -> bool:
    """Return whether the tolerance is met, by the last residual or by zeta (`stops_on_zeta`).

    The zeta of a rejected sweep does not count.
    """
    if stops_on_zeta(s):
        return s.step.zeta <= s.stopping.tolerance and s.control.rejected == 0
    return s.step.residual <= s.stopping.tolerance


@wp.func
def is_last_iteration(s: Scene) -> bool:
    """Return whether the sweeps end now, because of zeta, max_iterations or cancellation."""
    return not has_iterations_left(s) or (stops_on_zeta(s) and meets_tolerance(s))


@wp.func
def is_measured(s: Scene) -> bool:
    """Return whether the residual after the last iteration is known; it may be that of an earlier list."""
    return s.step.measured == s.step.iterations


@wp.func
def is_measurement_due(s: Scene) -> bool:
    """Return whether to measure the residual after the present iteration, to decide on stopping.

    It is due where sweeps would end (`may_stop`), even if it is known for an earlier list. Otherwise it is
    due, unless known or the sweep was rejected, after iteration 1 and each `CHECK_EVERY`, if the tolerance
    bounds it and zeta is small. In accelerated sweeps it is also due each `RECOMPUTE_EVERY`, because
    measuring recomputes the velocities.
    """
    if s.control.may_stop != 0:
        return True
    if is_measured(s) or s.control.rejected != 0:
        return False
    k = s.step.iterations
    may_meet = not stops_on_zeta(s) and s.step.zeta <= NEARLY * s.stopping.tolerance
    checking = may_meet and (k == 1 or k % CHECK_EVERY == 0)
    return checking or (is_accelerated(s) and k % RECOMPUTE_EVERY == 0)


@wp.func
def is_scan_due(iterations: int) -> bool:
    """Return whether a scan of all contacts follows sweep number `iterations`; early scans are frequent."""
    early = iterations <= FIRST_SCANS and is_power_of_two(iterations)
    return early or iterations % SCAN_EVERY == 0


@wp.func
def is_too_slow(s: Scene) -> bool:
    """Extrapolate the decay of the residual; return whether more than `patience` sweeps would be needed.

    The decay from `trend_residual` is taken to be that of the last RECOMPUTE_EVERY sweeps. If it is that of
    more sweeps, because a rejected sweep was not measured, the host is asked later than it could be.
    """
    if has_friction(s) and s.step.iterations < FRICTION_FROM:
        return False
    fallen = wp.log(s.step.trend_residual / s.step.residual)
    left = wp.log(s.step.residual / s.stopping.tolerance)
    sweeps = wp.min(s.step.iterations - HALF_WAY, RECOMPUTE_EVERY)
    return left * f64(sweeps) > fallen * f64(s.stopping.patience)


@wp.func
def is_recorded(s: Scene) -> bool:
    """Return whether the history records zeta and residual of the last iteration."""
    return s.step.iterations <= s.zeta_history.shape[0]


@wp.func
def is_residual_needed(s: Scene) -> bool:
    """Return whether the residual is measured now.

    It is needed to decide whether to stop, for the history, or as the first value of the decay that
    `is_too_slow` extrapolates.
    """
    begins_trend = s.step.host_request == HostRequest.EARLY and s.step.iterations == HALF_WAY
    return is_measurement_due(s) or (not is_measured(s) and (is_recorded(s) or begins_trend))


@wp.func
def is_recorded_during_bout(s: Scene) -> bool:
    """Return whether the history records the residual of an iteration after which the bout continues."""
    return s.control.phase == Phase.SWEEP and is_recorded(s)


@wp.func
def stop_or_sweep(s: Scene):
    """Stop after the last sweep, or else sweep. The scan before has extended zeta to all contacts."""
    s.control.may_stop = 1 if has_swept(s) and is_last_iteration(s) else 0
    s.control.phase = Phase.VERIFY if s.control.may_stop != 0 else Phase.SWEEP


@wp.func
def end_iteration(s: Scene, zeta: f64):
    """Count an iteration with this zeta [m/s]; choose the phase that follows.

    If the list has expired, plain sweeps continue to the next of the iterations 1, 2, 4, 8, ... From the
    deviations of the grains until then, the skins of the next list are chosen.
    """
    iterations = s.step.iterations + 1
    s.step.iterations = iterations
    s.step.zeta = zeta
    if is_recorded(s):
        put(s.zeta_history, iterations - 1, zeta)
    stopping = is_last_iteration(s)
    s.control.may_stop = 1 if stopping else 0
    if is_accelerated(s):
        if stopping or is_scan_due(iterations):
            s.control.phase = Phase.SCAN
    elif stopping or (s.verlet.list_expired != 0 and is_power_of_two(iterations)):
        s.control.phase = Phase.VERIFY


@wp.func
def end_list_check(s: Scene):
    """Interrupt the sweeps if the list has expired; they resume with a scan of the next list."""
    if s.verlet.list_expired != 0:
        s.control.phase = Phase.VERIFY


@wp.func
def take_residual(s: Scene):
    """Reduce the residual over the threads, and store it as that of the last iteration."""
    s.step.residual = take_max(s.partial.residual)
    s.step.measured = s.step.iterations
    if is_recorded(s):
        put(s.residual_history, s.step.iterations - 1, s.step.residual)


@wp.func
def end_measurement(s: Scene):
    """Stop if a residual that decides (is_measurement_due) meets the tolerance or falls too slowly."""
    decides = is_measurement_due(s)
    take_residual(s)
    stopping = decides and not stops_on_zeta(s) and meets_tolerance(s)
    if decides and s.step.host_request == HostRequest.EARLY and s.step.iterations % RECOMPUTE_EVERY == 0:
        stopping = stopping or is_too_slow(s)
        s.step.trend_residual = s.step.residual
    elif s.step.iterations == HALF_WAY:
        s.step.trend_residual = s.step.residual
    if stopping:
        s.control.may_stop = 1
        s.control.phase = Phase.VERIFY


@wp.func
def end_correction(s: Scene):
    """Choose the phase after the host's solution has been measured.

    Sweeps continue unless the solution meets the tolerance or no iterations are left.
    """
    take_residual(s)
    s.step.trend_residual = s.step.residual
    s.control.rejected = 0
    s.control.may_stop = 1 if meets_tolerance(s) or not has_iterations_left(s) else 0
    s.control.phase = Phase.VERIFY if s.control.may_stop != 0 else Phase.SCAN
