"""When the contact iteration stops, and whether the step is taken: decided on the device.

Accelerated sweeps stop only after a look at all contacts: restart.py and working_set.py have the last word.
"""

import warp as wp

from . import law
from .access import at, first_of, normal_of, put
from .record import (
    BEYOND_WALL,
    EXPIRED,
    HALTED,
    NOT_CONVERGED,
    SLOW,
    SOLVED,
    UNPROVED,
    Scene,
    is_accelerated,
    pair_count,
)
from .types import Floats
from .verlet import check_all, outcome_of_check, reserve

f64 = wp.float64
CHECK_EVERY = wp.constant(10)  # iterations between two checks of the residual
NEARLY = wp.constant(f64(2.0))  # times the tolerance: a zeta from which the residual is worth a check
FOR_HISTORY = wp.constant(2)  # what `Control.measuring` is where nothing follows from the residual


@wp.func
def is_power_of_two(number: int) -> bool:
    """Whether it is 1, 2, 4, 8, ..."""
    return number & (number - 1) == 0


@wp.func
def gathered(partial: Floats) -> f64:
    """The largest part of any thread; all are cleared."""
    largest = f64(0.0)
    for k in range(partial.shape[0]):
        largest = wp.max(largest, at(partial, k))
        put(partial, k, f64(0.0))
    return largest


@wp.func
def begin(s: Scene):
    """Begin a step, or go on with one that waited for the host."""
    s.control.unsolved = 1
    s.control.accepted = 0
    s.control.starting = 1 - wp.max(s.control.unlisted, s.control.corrected)
    if s.control.starting != 0:
        s.control.declined = 0
    if s.control.unlisted == 0:
        s.control.resuming = s.control.declined


@wp.func
def see_whether_listed(s: Scene):
    """Solve the step if there is a list to do so with; it is in order now.

    An attempt whose list expired goes on unless a contact that it did not have may have acted.
    """
    is_new = s.control.unordered != 0
    s.control.unordered = 0
    s.control.attempting = 1 - s.control.unlisted
    s.control.fresh = 1 - s.control.corrected
    if is_new and s.control.resuming != 0:
        s.control.recoloring = s.by_color
        if s.verlet.flags.missed != 0:
            s.control.resuming = 0
            s.step.redos = s.step.redos + 1


@wp.func
def begin_iterating(s: Scene):
    """Iterate if the list is likely to hold for the velocities before the first iteration.

    An accelerated attempt that was at its end is measured again, with the list that it has now.
    """
    check_all(s, reserve(s))
    if s.control.resuming == 0:
        s.step.iterations = 0
        s.control.unfinished = 1
        s.control.looking = 1
        s.control.measuring = 0
        s.control.rebuilding = 0
        s.control.sampling = 0
        s.control.rejected = 0
    elif is_accelerated(s) and s.control.unfinished == 0:
        s.control.unfinished = 1
        s.control.looking = 1
        s.control.measuring = 1
    s.control.iterating = s.control.unfinished if outcome_of_check(s) == SOLVED else 0


@wp.func
def is_going_on(s: Scene, zeta: f64) -> bool:
    """Whether iterations are left to do after one with this zeta [m/s]."""
    going_on = s.step.iterations < s.stopping.max_iterations and s.control.halted == 0
    if s.stopping.on_residual == 0 and s.control.rejected == 0:
        going_on = going_on and zeta > s.stopping.tolerance
    return going_on


@wp.func
def decide_to_stop(s: Scene, zeta: f64):
    """Stop after the first iteration with zeta <= tolerance, or at max_iterations; or ask for the residual.

    Where a contact may be missing it pauses for another list, but not at once, so that it shows how far
    all grains must reach. The residual is measured after the last iteration in any case.
    """
    iterations = s.step.iterations + 1
    s.step.iterations = iterations
    going_on = is_going_on(s, zeta)
    checking = False
    if s.stopping.on_residual != 0 and s.control.rejected == 0:
        sparse = iterations == 1 or iterations % CHECK_EVERY == 0
        checking = sparse and zeta <= NEARLY * s.stopping.tolerance
    recording = iterations <= s.history.zeta.shape[0]
    if recording:
        put(s.history.zeta, iterations - 1, zeta)
    s.step.zeta = zeta
    pausing = s.verlet.flags.list_expired != 0 and is_power_of_two(iterations)
    s.control.unfinished = 1 if going_on else 0
    s.control.iterating = 1 if going_on and not pausing else 0
    s.control.measuring = 1 if checking or not going_on else FOR_HISTORY if recording else 0
    s.control.rebuilding = 1 if checking else 0


@wp.func
def stop_on_residual(s: Scene):
    """Stop on residual <= tolerance, unless it is measured for the history alone."""
    residual = gathered(s.partial.residual)
    s.step.residual = residual
    if s.step.iterations <= s.history.residual.shape[0]:
        put(s.history.residual, s.step.iterations - 1, residual)
    if (
        s.stopping.on_residual != 0
        and s.control.measuring != FOR_HISTORY
        and residual <= s.stopping.tolerance
    ):
        s.control.iterating = 0
        s.control.unfinished = 0


@wp.func
def grain_beyond_wall(s: Scene) -> int:
    """Return the first grain that moves along a round wall by more than its circle is wide, or -1."""
    found = int(-1)
    for w in range(s.contacts.count.walls):
        c = pair_count(s) + w
        i = first_of(s.contacts.contact, c)
        along = law.speed_along(at(s.grains.next_velocity, i), normal_of(s.contacts.contact, c))
        if wp.abs(along) > at(s.contacts.limits, w)[1] and (found < 0 or i < found):
            found = i
    return found


@wp.func
def judge(s: Scene):
    """Take the step, try again with a new list, or give it up."""
    check_all(s, s.tuning.rounding)
    converged = s.step.zeta <= s.stopping.tolerance and s.control.rejected == 0
    if s.stopping.on_residual != 0:
        converged = s.step.residual <= s.stopping.tolerance
    outcome = outcome_of_check(s)
    if outcome == SOLVED and not converged:
        if s.control.declined == 0 and s.stopping.patience > 0:
            outcome = SLOW
        elif s.stopping.raise_on_unconverged != 0:
            outcome = NOT_CONVERGED
    if outcome == SOLVED and converged and s.walls.annulus.round != 0:
        s.verlet.flags.bad_grain = grain_beyond_wall(s)
        if s.verlet.flags.bad_grain >= 0:
            outcome = BEYOND_WALL
    if s.control.halted != 0 and not converged:
        outcome = HALTED
    s.step.converged = 1 if converged else 0
    s.step.outcome = outcome
    if outcome == SOLVED and not converged:
        s.to_search = s.to_search - s.step.iterations
        if s.to_search <= 0:
            s.step.outcome = UNPROVED  # it is taken, and worth a search for a proof that none solves it
    s.control.corrected = 0
    s.control.accepted = 1 if outcome == SOLVED else 0
    s.control.unlisted = 1 if outcome == EXPIRED else 0
    s.control.unsolved = s.control.unlisted
