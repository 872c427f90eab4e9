"""The reach of a new list: its skins and its lifetime (MODEL.md, eq. 11).

The base skin adapts to how long lists last. The skin of a grain is the base skin plus a multiple of dt p_i,
which the grain has needed so far.
"""

import warp as wp

from ..access import at, larger, put
from ..record import Scene, body_count, has_swept, is_accelerated
from .verlet import peak_of

f64 = wp.float64
FORESEEN, FOUND_OUT = wp.constant(f64(1.2)), wp.constant(f64(2.0))  # skin / need before, after a restart
NARROWEST, WIDEST = wp.constant(f64(0.02)), wp.constant(f64(0.2))  # bounds on the base skin, in radii
WIDEST_AFTER_MISS = wp.constant(f64(0.25))  # WIDEST after plain sweeps had to start again
WIDEST_UNSWEPT = wp.constant(f64(0.4))  # WIDEST for accelerated sweeps, which visit only the working set
STILL_TO_COME = wp.constant(f64(0.6))  # skin / need so far, if accelerated sweeps resume
LONGEST = wp.constant(f64(64.0))  # longest lifetime of a list, in steps


@wp.func
def adapt_base_skin(s: Scene):
    """Widen the base skin [m] if the list lasted less than 5 steps; narrow it after more than 20."""
    radius = s.tuning.smallest_radius
    skin = s.verlet.base_skin
    steps = s.verlet.elapsed / s.dt
    if steps < f64(4.5):
        widest = WIDEST
        if is_accelerated(s):
            widest = WIDEST_UNSWEPT
        elif has_swept(s):
            widest = WIDEST_AFTER_MISS
        skin = wp.max(skin, wp.min(f64(1.25) * skin, widest * radius))
    elif steps > f64(20.5):
        skin = wp.max(f64(0.7) * skin, NARROWEST * radius)
    s.verlet.base_skin = skin


@wp.func
def renew_skin(s: Scene, i: int):
    """Choose the reference velocity v0_i, and the skin of body i for a new list.

    The skin is the base skin plus a multiple of dt p_i, with the peak deviation p_i of this step or of the
    last one. v0_i is the velocity now; if plain sweeps start again, it becomes v0_i + v_f. If accelerated
    sweeps resume, the multiple is smaller, because the list must only last for the remaining sweeps.
    """
    w = at(s.grains.next_velocity, i)
    needed = at(s.verlet.recent_deviation, i)
    margin = FORESEEN
    if has_swept(s):
        seen = peak_of(s, i)
        needed = wp.max(needed, seen)
        if is_accelerated(s):
            margin = STILL_TO_COME
            put(s.verlet.peak_square, i, f64(0.0))
        else:
            margin = FOUND_OUT
            w = at(s.verlet.reference_velocity, i) + s.verlet.frame_velocity
            put(s.verlet.recent_deviation, i, needed)  # so that skins only grow as long as the step goes on
    put(s.verlet.skin, i, s.verlet.base_skin + margin * s.dt * needed)
    put(s.verlet.reference_position, i, at(s.grains.position, i))
    put(s.verlet.reference_velocity, i, w)


@wp.func
def widen_for_start(s: Scene, i: int):
    """Widen skin_i to cover also the velocity of body i before the step, on which bounces depend (eq. 35)."""
    away = wp.length(at(s.grains.velocity, i) - at(s.verlet.reference_velocity, i))
    put(s.verlet.skin, i, larger(at(s.verlet.skin, i), s.verlet.base_skin + FORESEEN * s.dt * away))


@wp.func
def renew_numbers(s: Scene):
    """Reset the age e of the list and the path x_f of the frame, and choose lifetime and frame skin (eq. 11).

    The lifetime T is 1 to 64 steps: the most in which no grain that moves at its v0_i departs by more than
    `Tuning.room` from the mean motion. The frame skin is the base skin plus about the path of a free fall
    during T.
    """
    n = body_count(s)
    mean = wp.vec2d(f64(0.0), f64(0.0))
    i = int(0)
    while i < n:
        mean = mean + at(s.verlet.reference_velocity, i) / f64(n)
        i += 1
    spread = f64(0.0)
    i = int(0)
    while i < n:
        spread = larger(spread, wp.length_sq(at(s.verlet.reference_velocity, i) - mean))
        i += 1
    steps = wp.clamp(wp.floor(s.tuning.room / (s.dt * wp.sqrt(spread))), f64(1.0), LONGEST)
    lifetime = steps * s.dt
    fall = f64(1.2) * s.tuning.acceleration * lifetime * (f64(0.5) * lifetime + s.dt)
    s.verlet.frame_shift = wp.vec2d(f64(0.0), f64(0.0))
    s.verlet.elapsed = f64(0.0)
    s.verlet.mean_velocity = mean
    s.verlet.lifetime = lifetime
    s.verlet.frame_skin = s.verlet.base_skin + fall
