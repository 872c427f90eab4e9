"""The Verlet list's check: the proof that a pair or wall left out of the list would have done nothing.

When the list was built, grain i had about the reference velocity v0_i. In a frame that moves with velocity
v_f in addition to the v0_i, let s_i be its displacement since from its straight path, and p_i its peak
deviation, the largest |v_i - v0_i - v_f| that it has had in the contact iteration. The list holds every pair
with

    gap <= lifetime |v0_i - v0_j| + skin_i + skin_j

as the gaps were then. A pair acts only if (v_i - v_j) . n > gap / dt. So as long as

    s_i + dt p_i <= skin_i  for every grain i,    and    elapsed + dt <= lifetime,

an absent pair has gap >= dt (|v0_i - v0_j| + p_i + p_j) >= dt (v_i - v_j) . n at all times and stays silent;
leaving it out gives the same bits (MODEL.md, eq. 11). The walls do not move with the frame: for them the path
of the frame itself is added. A wall that a force drives (driven.py) has a v0, a displacement, a peak and a
skin like a grain, and there is no frame: v_f = 0.

p_i is updated after every correction that is large. The small ones of a sweep change no velocity by more than
max_row_sum times the largest of them, where max_row_sum is the largest sum of a grain's shares of its
contacts; these changes add up to `unmonitored_change`, with which all grains are sampled from time to time.

The accelerated method sweeps no contact that it has not selected; p_i is then updated at every scan, where it
selects (working_set.py).
"""

import warp as wp

from ..access import at, larger, put
from ..record import Scene, body_count, grain_count, is_driven

f64 = wp.float64
IN_MEAN = wp.constant(1024)  # largest number of grains in the mean for v_f
MOST_RADII = wp.constant(f64(1e12))  # longest path in a step, in radii; walls/annulus.py bounds the domain so
ROUNDED = wp.constant(f64(1.0 + 1e-13))  # factor above the rounding of `elapsed`, a sum of at most 64 steps


@wp.func
def deviation(s: Scene, velocity: wp.vec2d, i: int) -> wp.vec2d:
    """Return v_i - v0_i - v_f, the deviation of a velocity v_i [m/s] from the reference motion of grain i."""
    return velocity - at(s.verlet.reference_velocity, i) - s.verlet.frame_velocity


@wp.func
def displacement(s: Scene, position: wp.vec2d, i: int) -> f64:
    """Return s_i, the distance [m] of a position from where v0_i and the frame have taken body i (eq. 11)."""
    w = at(s.verlet.reference_velocity, i)
    straight = at(s.verlet.reference_position, i) + s.verlet.elapsed * w
    return wp.length(position - straight - s.verlet.frame_shift)


@wp.func
def is_finite(x: wp.vec2d) -> bool:
    """Return whether |x|^2 is finite. If not, the difference of |x|^2 and itself is NaN."""
    square = wp.length_sq(x)
    return square - square == f64(0.0)


@wp.func
def least_monitored(s: Scene) -> f64:
    """Return the change of a velocity [m/s] above which the grain is monitored (`monitor`)."""
    return s.tuning.monitor_threshold * s.verlet.base_skin


@wp.func
def least_monitored_correction(s: Scene) -> f64:
    """Return the change of a correction [m/s] above which both its grains are monitored (`monitor`)."""
    return least_monitored(s) / s.verlet.max_row_sum


@wp.func
def keep_peak(s: Scene, i: int, velocity: wp.vec2d) -> f64:
    """Raise p_i to the deviation |velocity - v0_i - v_f| if that is larger (eq. 11); return p_i^2 [m2/s2]."""
    peak = larger(at(s.verlet.peak_square, i), wp.length_sq(deviation(s, velocity, i)))
    put(s.verlet.peak_square, i, peak)
    return peak


@wp.func
def monitor(s: Scene, i: int, velocity: wp.vec2d):
    """Raise p_i to the deviation of this velocity of grain i [m/s]; above its limit, the list expires."""
    limit = at(s.verlet.peak_limit, i)
    if keep_peak(s, i, velocity) > limit * limit:
        s.verlet.list_expired = 1


@wp.func
def peak_of(s: Scene, i: int) -> f64:
    """Return the peak deviation p_i of body i plus the bound on unmonitored changes [m/s]."""
    return wp.sqrt(at(s.verlet.peak_square, i)) + s.verlet.unmonitored_change


@wp.func
def sample(s: Scene, i: int):
    """Raise p_i to the present deviation of body i plus the bound on changes that were not monitored."""
    v = at(s.grains.next_velocity, i)
    peak = wp.length(deviation(s, v, i)) + s.verlet.unmonitored_change
    put(s.verlet.peak_square, i, larger(at(s.verlet.peak_square, i), peak * peak))


@wp.func
def clear_check(s: Scene):
    """Begin a check of the list: it has not expired, no body is bad, and no change is unmonitored yet."""
    s.verlet.unmonitored_change = f64(0.0)
    s.verlet.list_expired = 0
    s.verlet.bad_body = -1


@wp.func
def find_frame(s: Scene):
    """Find v_f, the velocity of the frame: the mean of v_i - v0_i. The v0_i are velocities at the search.

    A motion common to all grains, such as a fall, changes no gap. The proof holds for any v_f, so the mean
    over at most IN_MEAN grains suffices. v_f = 0 if an attempt resumes with a new list, because the v0_i then
    include it, or if a force drives a wall (driven.py).
    """
    n = grain_count(s)
    u = wp.vec2d(f64(0.0), f64(0.0))
    if s.control.resuming == 0 and not is_driven(s):
        stride = 1 + (n - 1) // IN_MEAN
        count = 1 + (n - 1) // stride
        i = int(0)
        while i < n:
            w = at(s.verlet.reference_velocity, i)
            u = u + (at(s.grains.next_velocity, i) - w) / f64(count)
            i += stride
    s.verlet.frame_velocity = u


@wp.func
def is_resolved(s: Scene, i: int) -> bool:
    """Return whether the position of body i after the step is finite, and its path within MOST_RADII."""
    way = s.dt * at(s.grains.next_velocity, i)
    most = MOST_RADII * s.tuning.smallest_radius
    return is_finite(at(s.grains.position, i) + way) and wp.length_sq(way) <= most * most


@wp.func
def check_skin(s: Scene, i: int, least: f64, foreseen: f64):
    """Let the list expire unless s_i + dt p_i + least <= skin_i [m].

    p_i is taken as at least `foreseen` times the p_i of the last step. If the body's motion is not resolved
    (`is_resolved`), write the body to `bad_body` instead.
    """
    x = at(s.grains.position, i)
    peak = wp.max(peak_of(s, i), foreseen * at(s.verlet.recent_deviation, i))
    used = displacement(s, x, i) + s.dt * peak
    if not is_resolved(s, i):
        s.verlet.bad_body = i  # of any thread; check_all replaces it by the last such body
    elif not (used + least <= at(s.verlet.skin, i)):
        s.verlet.list_expired = 1


@wp.func
def spare_skin(s: Scene) -> f64:
    """Return the length [m] of a skin that must be unused before the iteration.

    With less, the skin would likely not suffice for the step, and a new list is built at once.
    """
    return s.tuning.rounding + s.tuning.reserve * s.verlet.base_skin


@wp.func
def begin_peak(s: Scene, i: int):
    """Set the peak deviation p_i to the present one of body i, or keep a larger p_i if sweeps resume.

    Also write the largest p_i that the skin allows to `peak_limit`. Above it, the list expires.
    """
    peak = wp.length_sq(deviation(s, at(s.grains.next_velocity, i), i))
    if s.control.resuming != 0:
        peak = wp.max(peak, at(s.verlet.peak_square, i))
    put(s.verlet.peak_square, i, peak)
    path = displacement(s, at(s.grains.position, i), i)
    allowed = (at(s.verlet.skin, i) - path) / s.dt
    put(s.verlet.peak_limit, i, wp.max(f64(0.0), allowed))


@wp.func
def begin_check(s: Scene, i: int):
    """Start the peak deviation of body i, and check that its skin is likely to suffice for the step."""
    begin_peak(s, i)
    check_skin(s, i, spare_skin(s), wp.where(s.control.resuming != 0, f64(0.0), f64(1.0)))


@wp.func
def monitor_start(s: Scene, i: int):
    """Update p_i for the velocity of body i at the end of the last step, on which bounces depend (eq. 35)."""
    monitor(s, i, at(s.grains.velocity, i))


@wp.func
def verify(s: Scene, i: int):
    """Let the list expire if body i has not stayed within its skin during the iteration (eq. 11)."""
    check_skin(s, i, s.tuning.rounding, f64(0.0))


@wp.func
def check_all(s: Scene, least: f64):
    """Let the list expire if its lifetime ends or less than `least` [m] of the frame's skin is left.

    If a body is bad, write the last bad one to `bad_body`, so that it does not depend on threads.
    """
    path = wp.length(s.verlet.frame_shift) + s.dt * wp.length(s.verlet.frame_velocity)
    if not (path + least <= s.verlet.frame_skin):
        s.verlet.list_expired = 1
    if not (s.verlet.elapsed + s.dt <= ROUNDED * s.verlet.lifetime):
        s.verlet.list_expired = 1
    if s.verlet.bad_body >= 0:
        for i in range(body_count(s)):
            if not is_resolved(s, i):
                s.verlet.bad_body = i


@wp.func
def is_list_valid(s: Scene) -> bool:
    """Return whether the check has found no bad body (`is_resolved`), and no contact can be missing."""
    return s.verlet.bad_body < 0 and s.verlet.list_expired == 0


@wp.func
def add_unmonitored(s: Scene):
    """Add to `unmonitored_change` a bound on velocity changes by the last sweep that were not monitored."""
    change = wp.min(s.verlet.max_row_sum * s.step.zeta, least_monitored(s))
    s.verlet.unmonitored_change = s.verlet.unmonitored_change + change


@wp.func
def is_sampling_due(s: Scene) -> bool:
    """Return whether `unmonitored_change` is so large that all bodies must be sampled (`sample`)."""
    return s.verlet.unmonitored_change > least_monitored(s)


@wp.func
def end_sampling(s: Scene):
    """Reset the sum of unmonitored changes."""
    s.verlet.unmonitored_change = f64(0.0)


@wp.func
def remember(s: Scene, i: int):
    """Save the peak deviation p_i of the step, from which the skin of body i in the next list is chosen."""
    put(s.verlet.recent_deviation, i, peak_of(s, i))


@wp.func
def shift_frame(s: Scene):
    """Move the frame by v_f dt, and add dt to the age of the list."""
    s.verlet.frame_shift = s.verlet.frame_shift + s.dt * s.verlet.frame_velocity
    s.verlet.elapsed = s.verlet.elapsed + s.dt
