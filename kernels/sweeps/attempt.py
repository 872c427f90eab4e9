"""Stages that begin an attempt to solve a step, and that decide whether the step is accepted."""

import warp as wp

from .. import law
from ..access import at, bodies_of, contact_at
from ..contacts import limits_at
from ..record import (
    HostRequest,
    Outcome,
    Phase,
    Scene,
    grain_count,
    is_accelerated,
    is_cancelled,
    is_driven,
    pair_count,
)
from ..search.verlet import check_all, is_list_valid, spare_skin
from ..walls.driven import closing_speed
from ..walls.walls import is_periodic, wall_velocity, way
from .stopping import is_measured, meets_tolerance

f64 = wp.float64


@wp.func
def begin(s: Scene):
    """Begin a step, unless it continues after it has waited for the host."""
    if s.control.phase == Phase.ENDED:
        s.control.phase = Phase.START
        s.control.resuming = 0
        s.step.host_request = HostRequest.EARLY if s.stopping.patience > 0 else HostRequest.NEVER
        s.step.rebuilds = 0
        s.step.restarts = 0
        s.step.factorizations = 0


@wp.func
def start(s: Scene):
    """Mark the list as sorted. If an attempt to solve the step starts, also reset `without_normal`.

    This flag says that a grain is where the normal of a wall is undefined.
    """
    s.control.unordered = 0
    if s.control.phase == Phase.START:
        s.verlet.without_normal = 0


@wp.func
def begin_iterating(s: Scene):
    """Choose the phase: iterate if the list is likely to be valid for the velocities before the iteration.

    Otherwise, verify the list without iterating. `may_stop` is kept if sweeps resume: then the residual is
    measured again, with the new list.
    """
    check_all(s, spare_skin(s))
    if s.control.resuming == 0:
        s.step.iterations = 0
        s.step.measured = 0
        s.control.may_stop = 0
        s.control.rejected = 0
    if is_list_valid(s):
        s.control.phase = Phase.SCAN if is_accelerated(s) else Phase.SWEEP
    else:
        s.control.phase = Phase.VERIFY


@wp.func
def grain_beyond_wall(s: Scene) -> int:
    """Return the first grain that may move beyond a wall, or -1.

    That is a grain with |v along a round wall| > A / dt (eq. 18), or, where a wall has no normal, a grain
    that moves relative to the wall by more than the gap.
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
def meets_other_image(s: Scene, i: int, j: int, d: wp.vec2d, move: wp.vec2d) -> bool:
    """Return whether grain i meets an image of grain j other than the nearest one, during the step (eq. 36b).

    `d` is the vector from grain i to the nearest image [m]. In the step, grain i moves by `move` [m] relative
    to grain j.
    """
    period, reach = s.walls.period, at(s.grains.radius, i) + at(s.grains.radius, j)
    k = int(0)
    while k < 9:
        image = d + wp.vec2d(f64(k % 3 - 1) * period[0], f64(k // 3 - 1) * period[1])
        if wp.length_sq(image - d) > f64(0.0):
            share = wp.clamp(wp.dot(image, move) / wp.length_sq(move), f64(0.0), f64(1.0))
            if wp.length(image - share * move) < reach:
                return True
        k += 1
    return False


@wp.func
def grain_at_other_image(s: Scene) -> int:
    """Return the first grain that meets a later grain at an image other than the nearest one, or -1.

    Such images are out of reach unless dt times the range of velocities exceeds half a period minus 2 radii.
    """
    velocity, largest = s.grains.next_velocity, f64(0.0)
    low, high = at(velocity, 0), at(velocity, 0)
    for i in range(grain_count(s)):
        low, high = wp.min(low, at(velocity, i)), wp.max(high, at(velocity, i))
        largest = wp.max(largest, at(s.grains.radius, i))
    path, period = s.dt * (high - low), s.walls.period
    free = f64(0.5) * period - wp.vec2d(f64(2.0) * largest, f64(2.0) * largest)
    across_x = period[0] > f64(0.0) and path[0] > free[0]
    across_y = period[1] > f64(0.0) and path[1] > free[1]
    if not (across_x or across_y):
        return -1
    for i in range(grain_count(s)):
        for j in range(i + 1, grain_count(s)):
            d = way(at(s.grains.position, i), at(s.grains.position, j), s.walls)
            if meets_other_image(s, i, j, d, s.dt * (at(velocity, i) - at(velocity, j))):
                return i
    return -1


@wp.func
def body_too_far(s: Scene) -> int:
    """Return a grain that moves beyond a wall or meets two images of another grain, or -1.

    It is the body of the outer circle if no grain fits into this circle after the step.
    """
    found = int(-1)
    if s.walls.annulus.round != 0 or s.verlet.without_normal != 0:
        found = grain_beyond_wall(s)
    if found < 0 and is_periodic(s.walls):
        found = grain_at_other_image(s)
    if found < 0 and is_driven(s):
        outer = grain_count(s)
        radius = at(s.grains.position, outer)[0] + s.dt * at(s.grains.next_velocity, outer)[0]
        if not (radius >= s.tuning.smallest_radius):
            found = outer
    return found


@wp.func
def judge(s: Scene):
    """End the step with its outcome, ask the host to solve it, or repeat it with a new list."""
    check_all(s, s.tuning.rounding)
    converged = meets_tolerance(s)
    phase, outcome = int(Phase.ENDED), int(Outcome.SOLVED)
    if is_cancelled(s) and not (converged and is_measured(s)):
        outcome = int(Outcome.STOPPED)  # the residual may be that of an earlier iteration, as during a scan
    elif s.verlet.bad_body >= 0:
        outcome = int(Outcome.NOT_FINITE)
    elif s.verlet.list_expired != 0:
        phase = int(Phase.SEARCH)
    elif not converged and s.step.host_request != HostRequest.NEVER:
        phase, outcome = int(Phase.SLOW), int(Outcome.WAITING)
    elif not converged and s.stopping.raise_on_unconverged != 0:
        outcome = int(Outcome.NOT_CONVERGED)
    else:
        s.verlet.bad_body = body_too_far(s)
        if s.verlet.bad_body >= 0:
            outcome = int(Outcome.TOO_FAR)
    s.step.converged = 1 if converged else 0
    s.step.outcome = outcome
    s.control.phase = phase
