"""The Verlet list's check: the proof that a pair or wall left out of the list would have done nothing.

When the list was built, grain i had about the reference velocity w_i. In a frame that moves with velocity u
beside the w_i, let s_i be its displacement since from its straight path, and p_i the largest |v_i - w_i - u|
that it has had at any moment of the contact iteration, its peak deviation. The list holds every pair with

    gap <= lifetime |w_i - w_j| + skin_i + skin_j

as the gaps were then. A pair acts only if (v_i - v_j) . n > gap / dt. So as long as

    s_i + dt p_i <= skin_i  for every grain i,    and    elapsed + dt <= lifetime,

an absent pair has gap >= dt (|w_i - w_j| + p_i + p_j) >= dt (v_i - v_j) . n at every moment and stays silent;
leaving it out gives the same bits (MODEL.md, eq. 11). The walls do not move with the frame: for them the path
of the frame itself is added.

p_i is seen after every correction that is large. The small ones of a sweep change no velocity by more than
max_row_sum times the largest of them, where max_row_sum is the largest sum of a grain's shares of its
contacts; these changes add up to `unmonitored_change`, with which all grains are sampled from time to time.

The accelerated method sweeps no contact that it has not selected; p_i is then seen when it selects, and when
the residual is measured (working_set.py).
"""

import warp as wp

from . import law
from .access import at, larger, put
from .record import EXPIRED, NOT_FINITE, SOLVED, Scene, grain_count
from .walls import is_near_wall

f64 = wp.float64


@wp.func
def deviation(s: Scene, velocity: wp.vec2d, i: int) -> wp.vec2d:
    """v_i - w_i - u [m/s]."""
    return velocity - at(s.verlet.reference_velocity, i) - s.verlet.numbers.frame_velocity


@wp.func
def displacement(s: Scene, position: wp.vec2d, i: int) -> f64:
    """s_i [m]."""
    verlet = s.verlet.numbers
    w = at(s.verlet.reference_velocity, i)
    straight = at(s.verlet.reference_position, i) + verlet.elapsed * w
    return wp.length(position - straight - verlet.frame_shift)


@wp.func
def is_finite(x: wp.vec2d) -> bool:
    """Whether its square is a number: infinity less infinity is none."""
    square = wp.length_sq(x)
    return square - square == f64(0.0)


@wp.func
def least_monitored(s: Scene) -> f64:
    """The change of a grain's velocity from which it is looked at [m/s]."""
    return s.tuning.monitor_threshold * s.verlet.numbers.base_skin


@wp.func
def least_monitored_correction(s: Scene) -> f64:
    """The correction from which both grains are looked at [m/s]."""
    return least_monitored(s) / s.verlet.numbers.max_row_sum


@wp.func
def keep_peak(s: Scene, i: int, velocity: wp.vec2d) -> f64:
    """Keep the peak deviation of grain i, which has this velocity now. Returns its square."""
    peak = larger(at(s.verlet.peak_deviation, i), wp.length_sq(deviation(s, velocity, i)))
    put(s.verlet.peak_deviation, i, peak)
    return peak


@wp.func
def monitor(s: Scene, i: int, velocity: wp.vec2d):
    """Keep the peak deviation of grain i, and see whether its skin allows it."""
    limit = at(s.verlet.peak_limit, i)
    if keep_peak(s, i, velocity) > limit * limit:
        s.verlet.flags.list_expired = 1


@wp.func
def peak_of(s: Scene, i: int) -> f64:
    """p_i [m/s], with what was not monitored since."""
    return wp.sqrt(at(s.verlet.peak_deviation, i)) + s.verlet.numbers.unmonitored_change


@wp.func
def stayed_silent(s: Scene, i: int, j: int) -> bool:
    """Return whether a contact cannot have acted in the iterations so far (eq. 11b), with u in the w_i."""
    x, radius, n = at(s.grains.position, i), at(s.grains.radius, i), grain_count(s)
    if j >= n:
        path = s.dt * (wp.length(at(s.verlet.reference_velocity, i)) + peak_of(s, i))
        return not is_near_wall(j - n, x, radius, s.walls, path + s.tuning.rounding)
    normal, distance = law.normal(x, at(s.grains.position, j))
    gap = law.pair_gap(distance, radius, at(s.grains.radius, j))
    vn = wp.dot(at(s.verlet.reference_velocity, i) - at(s.verlet.reference_velocity, j), normal)
    return gap - s.dt * (vn + peak_of(s, i) + peak_of(s, j)) >= s.tuning.rounding


@wp.func
def sample(s: Scene, i: int):
    """Take what grain i may have reached unmonitored, on the way to its velocity, into its peak."""
    v = at(s.grains.next_velocity, i)
    peak = wp.length(deviation(s, v, i)) + s.verlet.numbers.sampled_change
    put(s.verlet.peak_deviation, i, larger(at(s.verlet.peak_deviation, i), peak * peak))


@wp.func
def clear_check(s: Scene):
    """Forget what was seen."""
    s.verlet.numbers.unmonitored_change = f64(0.0)
    s.verlet.flags.list_expired = 0
    s.verlet.flags.bad_grain = -1


@wp.func
def find_frame(s: Scene):
    """u, the mean of v_i - w_i: what all grains do together, such as falling, displaces nobody.

    In an attempt that goes on with a new list, the w_i have it in them already.
    """
    n = grain_count(s)
    u = wp.vec2d(f64(0.0), f64(0.0))
    if s.control.resuming == 0:
        i = int(0)
        while i < n:
            w = at(s.verlet.reference_velocity, i)
            u = u + (at(s.grains.next_velocity, i) - w) / f64(n)
            i += 1
    s.verlet.numbers.frame_velocity = u


@wp.func
def check_skin(s: Scene, i: int, least: f64, foreseen: f64):
    """See whether a skin suffices with `least` [m] to spare, for so many times the last step's deviation."""
    x = at(s.grains.position, i)
    peak = wp.max(peak_of(s, i), foreseen * at(s.verlet.recent_deviation, i))
    used = displacement(s, x, i) + s.dt * peak
    if not is_finite(x + s.dt * at(s.grains.next_velocity, i)):
        s.verlet.flags.bad_grain = 0
    elif not (used + least <= at(s.verlet.skin, i)):
        s.verlet.flags.list_expired = 1


@wp.func
def reserve(s: Scene) -> f64:
    """What is to be left of a skin before the iteration [m]."""
    return s.tuning.rounding + s.tuning.reserve * s.verlet.numbers.base_skin


@wp.func
def begin_peak(s: Scene, i: int):
    """The peak deviation before the first iteration, or the next one, and what the skin still allows."""
    peak = wp.length_sq(deviation(s, at(s.grains.next_velocity, i), i))
    if s.control.resuming != 0:
        peak = wp.max(peak, at(s.verlet.peak_deviation, i))
    put(s.verlet.peak_deviation, i, peak)
    path = displacement(s, at(s.grains.position, i), i)
    allowed = (at(s.verlet.skin, i) - path) / s.dt
    put(s.verlet.peak_limit, i, wp.max(f64(0.0), allowed))


@wp.func
def begin_check(s: Scene, i: int):
    """The peak deviation before the first iteration, and whether the skin will do."""
    begin_peak(s, i)
    check_skin(s, i, reserve(s), wp.where(s.control.resuming != 0, f64(0.0), f64(1.0)))


@wp.func
def verify(s: Scene, i: int):
    """After the iteration: whether the list has held."""
    check_skin(s, i, s.tuning.rounding, f64(0.0))


@wp.func
def check_all(s: Scene, least: f64):
    """See whether the frame's skin suffices and the list has not outlived its time; name a bad grain."""
    numbers = s.verlet.numbers
    path = wp.length(numbers.frame_shift) + s.dt * wp.length(numbers.frame_velocity)
    if not (path + least <= numbers.frame_skin):
        s.verlet.flags.list_expired = 1
    if not (numbers.elapsed + f64(0.5) * s.dt <= numbers.lifetime):  # a whole number of steps, rounded
        s.verlet.flags.list_expired = 1
    if s.verlet.flags.bad_grain >= 0:
        for i in range(grain_count(s)):
            if not is_finite(at(s.grains.position, i) + s.dt * at(s.grains.next_velocity, i)):
                s.verlet.flags.bad_grain = i


@wp.func
def outcome_of_check(s: Scene) -> int:
    """SOLVED where no contact was missing and every number is finite."""
    if s.verlet.flags.bad_grain >= 0:
        return NOT_FINITE
    if s.verlet.flags.list_expired != 0:
        return EXPIRED
    return SOLVED


@wp.func
def add_unmonitored(s: Scene):
    """Add the most by which a sweep may have changed a velocity that it has not monitored."""
    numbers = s.verlet.numbers
    most = least_monitored(s)
    change = numbers.unmonitored_change + wp.min(numbers.max_row_sum * s.step.zeta, most)
    s.verlet.numbers.unmonitored_change = change


@wp.func
def is_sampling_due(s: Scene) -> bool:
    """Return whether the changes that were not monitored have added up to one that is."""
    return s.verlet.numbers.unmonitored_change > least_monitored(s)


@wp.func
def begin_sampling(s: Scene):
    """Sum up anew; the sum so far is for `sample`."""
    s.verlet.numbers.sampled_change = s.verlet.numbers.unmonitored_change
    s.verlet.numbers.unmonitored_change = f64(0.0)


@wp.func
def remember(s: Scene, i: int):
    """Keep what the step needed, for the skins of the next list."""
    put(s.verlet.recent_deviation, i, peak_of(s, i))


@wp.func
def shift_frame(s: Scene):
    """The frame moves with the grains."""
    numbers = s.verlet.numbers
    s.verlet.numbers.frame_shift = numbers.frame_shift + s.dt * numbers.frame_velocity
    s.verlet.numbers.elapsed = numbers.elapsed + s.dt
