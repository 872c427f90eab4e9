"""How an attempt to solve a step begins, and whether the step is taken."""

import warp as wp

from . import law
from .access import at, bodies_of, contact_at
from .contacts import limits_at
from .driven import closing_speed
from .record import (
    BEYOND_WALL,
    CANCELLED,
    EXPIRED,
    NOT_CONVERGED,
    SLOW,
    SOLVED,
    Asking,
    Phase,
    Scene,
    grain_count,
    is_accelerated,
    is_cancelled,
    is_driven,
    pair_count,
)
from .stopping import is_measured, meets_tolerance, phase_of_next_sweep
from .verlet import check_all, outcome_of_check, reserve
from .walls import wall_velocity

f64 = wp.float64


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
        s.step.asking = Asking.EARLY if s.stopping.patience > 0 else Asking.NEVER
        s.step.rebuilds = 0
        s.step.restarts = 0
        s.step.factorizations = 0


@wp.func
def start(s: Scene):
    """Start an attempt to solve the step, with a list that is sorted now, unless the list does not fit."""
    s.control.unordered = 0
    if s.control.phase == Phase.BEGIN:
        s.control.phase = Phase.START
    if s.control.phase == Phase.START:
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
    found, velocity = int(-1), s.grains.next_velocity
    for w in range(s.contacts.count.walls):
        contact = contact_at(s.contacts.contact, pair_count(s) + w)
        i, j = bodies_of(contact)
        v, n = at(velocity, i), contact.n
        path, most = wp.abs(law.speed_along(v, n)), limits_at(s.contacts.limits, w)[1]
        if wp.length_sq(n) == f64(0.0):
            x, b = at(s.grains.position, i), j - grain_count(s)
            path, most = wp.length(v - wall_velocity(b, x, s.walls)), f64(contact.gap_rate)
            if is_driven(s):
                path = path + closing_speed(s, velocity, i, j, n)
        if path > most and found < 0:
            found = i
    return found


@wp.func
def judge(s: Scene):
    """Accept the step, repeat it with a new list, or refuse it."""
    check_all(s, s.tuning.rounding)
    converged = meets_tolerance(s)
    outcome = outcome_of_check(s)
    if outcome == SOLVED and not converged:
        if s.step.asking != Asking.NEVER:
            outcome = SLOW
        elif s.stopping.raise_on_unconverged != 0:
            outcome = NOT_CONVERGED
    if outcome == SOLVED and (s.walls.annulus.round != 0 or s.verlet.flags.without_normal != 0):
        s.verlet.flags.bad_body = grain_beyond_wall(s)
        if s.verlet.flags.bad_body >= 0:
            outcome = BEYOND_WALL
    if outcome == SOLVED and is_driven(s):
        outer = grain_count(s)
        radius = at(s.grains.position, outer)[0] + s.dt * at(s.grains.next_velocity, outer)[0]
        if not (radius >= s.tuning.smallest_radius):  # no grain fits into the outer circle
            s.verlet.flags.bad_body = outer
            outcome = BEYOND_WALL
    if is_cancelled(s) and not (converged and is_measured(s)):
        outcome = CANCELLED  # perhaps during a scan, with the residual of another iteration
    s.step.converged = 1 if converged else 0
    s.step.outcome = outcome
    if outcome == SOLVED:
        s.control.phase = Phase.ACCEPTED
    elif outcome == EXPIRED:
        s.control.phase = Phase.EXPIRE
    else:
        s.control.phase = Phase.ENDED
