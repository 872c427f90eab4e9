"""The accelerated method: over-relaxed sweeps with momentum, and rules that reject sweeps or stop momentum.

A sweep is coordinate descent on the dual objective of the step (MODEL.md, eq. 14),

    phi = 1/2 sum_i M_i |v_i|^2 + sum_c mu_c dv_c gap_c / dt,    mu_c = M_i M_j / (M_i + M_j), M_i at a wall.

Between two sweeps, corrections x and velocities are extrapolated from those before the last sweep,
y = x + beta (x - last), with beta = (t - 1) / t', t' = (1 + sqrt(1 + 4 t^2)) / 2 (Nesterov 1983; eq. 13).
The over-relaxation of the sweep grows with beta (Young 1954). A sweep from y sums the change of phi, and the
slope of phi along the momentum, by chunks of the working set (working_set.py).

The extrapolation to y may raise phi. If the sweep does not lower phi by more, it is rejected, and momentum
stops; so phi falls from sweep to sweep. Momentum also stops when it points up the gradient (O'Donoghue and
Candes 2015). A stop only halves t, so that momentum is soon as large as before (Liang, Luo and Schoenlieb
2022). t is limited near the end, because momentum would keep the waves of impacts alive for long.

With friction, a step is not the minimization of an objective. So no sweep is rejected. Without this
safeguard, momentum with beta near 1 diverges, and over-relaxation diverges at any beta. So there is no
over-relaxation with friction, beta is capped, and momentum stops if the change by a sweep, squared and summed
in the mass metric, has grown. Some steps converge by plain sweeps only, so the cap falls after 500 sweeps.

Velocities that are corrected in place accumulate rounding errors, which momentum amplifies. At intervals,
they are recomputed from the corrections, and the velocities before the last sweep are shifted by the same
amount.
"""

import warp as wp

from ..access import at, named, put
from ..contacts import CHUNK, chunk_count, chunks_in, contact_count
from ..record import Scene, body_count, grain_count, has_weights, rotates
from ..team.threads import Team, thread_range
from ..types import Floats

f64 = wp.float64
RELAXATION = wp.constant(f64(0.25))  # initial over-relaxation omega - 1 at beta = 1
ENOUGH = wp.constant(f64(0.99))  # part of the decrease of phi by a sweep that may balance the rise before it
ROUNDING = wp.constant(f64(2.0e-15))
RELAXATION_BACKOFF = wp.constant(f64(0.8))  # factor of the over-relaxation after a rejected sweep
MOMENTUM_BACKOFF = wp.constant(f64(0.5))  # factor of t after a stop
NEAR_END = wp.constant(f64(6.0))  # if zeta < NEAR_END * tolerance, t is at most the largest of:
T_ANYWAY = wp.constant(f64(24.0))
T_PER_FALL = wp.constant(f64(1.5))  # times sqrt(zeta of the first sweep / tolerance)
T_PER_SWEEP = wp.constant(f64(0.2))  # times the number of sweeps so far
# With friction:
GROWTH = wp.constant(f64(1.2))  # ratio of the changes of two sweeps above which momentum stops
CAP = wp.constant(f64(0.85))  # of beta
FADE = wp.constant(f64(500.0))  # number of sweeps after which the cap falls, as FADE / number of sweeps


@wp.func
def relaxation_factor(s: Scene) -> f64:
    """Return omega, the factor by which a sweep multiplies vn - gap / dt of a contact (eq. 13)."""
    return f64(1.0) + s.momentum.relaxation * s.momentum.beta


@wp.func
def mass_in_phi(s: Scene, i: int) -> f64:
    """Return the mass of body i in the objective phi: its contact mass [kg], or 1 if all masses are equal."""
    if has_weights(s):
        return at(s.grains.contact_mass, i)
    return f64(1.0)


@wp.func
def take_t_on(s: Scene, zeta: f64):
    """Set t and beta of the next sweep by eq. 13, after a sweep with this zeta [m/s].

    If zeta is near the tolerance, t is limited.
    """
    sweeps = s.step.iterations + 1
    tolerance = s.stopping.tolerance
    if sweeps == 1:
        s.momentum.first_zeta = zeta
    t = s.momentum.t
    following = f64(0.5) * (f64(1.0) + wp.sqrt(f64(1.0) + f64(4.0) * t * t))
    s.momentum.beta = (t - f64(1.0)) / following
    if zeta < NEAR_END * tolerance:
        fall = T_PER_FALL * wp.sqrt(s.momentum.first_zeta / tolerance)
        following = wp.min(following, wp.max(T_ANYWAY, wp.max(fall, T_PER_SWEEP * f64(sweeps))))
    s.momentum.t = following


@wp.func
def back_off(s: Scene):
    """Set beta = 0, which stops momentum for one sweep, and halve t."""
    s.momentum.t = wp.max(f64(1.0), MOMENTUM_BACKOFF * s.momentum.t)
    s.momentum.beta = f64(0.0)


@wp.func
def sum_of_chunks(s: Scene) -> wp.vec2d:
    """Return (terms of contacts in the test of eq. 14, slope of phi along the momentum) of a sweep.

    They are the `contact_sums`, added over all chunks. With friction, the first is `Momentum.change` instead.
    """
    total = wp.vec2d()
    for k in range(chunk_count(s)):
        total = total + at(s.momentum.contact_sums, k)
    return total


@wp.func
def accept_or_reject(s: Scene, zeta: f64):
    """Reject the sweep, which has this zeta [m/s], if the objective phi has risen (eq. 14).

    Then, or if the slope of phi along the momentum is > 0, back off. Otherwise choose t and beta of the next
    sweep.
    """
    total = sum_of_chunks(s)
    energy = f64(0.0)
    size = f64(0.0)
    for k in range(chunks_in(body_count(s))):
        moving = at(s.momentum.body_sums, k)
        energy = energy + moving[0]
        size = size + moving[1]
    beta = s.momentum.beta
    rejected = beta > f64(0.0) and total[0] + beta * (f64(0.5) * energy - ROUNDING * size) > f64(0.0)
    if rejected:
        s.momentum.relaxation = RELAXATION_BACKOFF * s.momentum.relaxation
    if rejected or total[1] > f64(0.0):
        back_off(s)
    else:
        take_t_on(s, zeta)
    s.control.rejected = 1 if rejected else 0


@wp.func
def limit_momentum(s: Scene, zeta: f64):
    """Choose t and beta of the next sweep with friction, after a sweep with this zeta [m/s].

    Back off if the changes by sweeps grow, or if the slope along the momentum is > 0.
    """
    total = sum_of_chunks(s)
    grown = s.momentum.beta > f64(0.0) and total[0] > GROWTH * s.momentum.change
    s.momentum.change = total[0]
    if total[1] > f64(0.0) or grown:
        back_off(s)
    else:
        take_t_on(s, zeta)
        cap = CAP * wp.min(f64(1.0), FADE / f64(s.step.iterations + 1))
        s.momentum.beta = wp.min(cap, s.momentum.beta)


@wp.func
def roll_back(s: Scene, chunk: int):
    """Restore the corrections of a chunk of the working set from before the rejected sweep."""
    bounds = at(s.working.range, chunk)
    c = int(bounds[0])
    while c < bounds[1]:
        put(s.working.contacts.dv.now, c, at(s.working.contacts.dv.last, c))
        c += 1


@wp.func
def roll_back_velocity(s: Scene, i: int):
    """Restore the velocity of body i from before the rejected sweep."""
    put(s.grains.next_velocity, i, at(s.momentum.last_velocity, i))


@wp.func
def take_recomputed_velocity(s: Scene, i: int):
    """Replace velocity and rim speed of body i by the recomputed ones.

    Velocity and rim speed before the last sweep are shifted by the same amount.
    """
    recomputed = at(s.grains.recomputed_velocity, i)
    last = at(s.momentum.last_velocity, i)
    put(s.momentum.last_velocity, i, last + (recomputed - at(s.grains.next_velocity, i)))
    put(s.grains.next_velocity, i, recomputed)
    if rotates(s, i):
        recomputed_rim, last_rim = at(s.grains.recomputed_rim, i), at(s.momentum.last_rim, i)
        put(s.momentum.last_rim, i, last_rim + (recomputed_rim - at(s.grains.next_rim, i)))
        put(s.grains.next_rim, i, recomputed_rim)


@wp.func
def copy_numbers(team: Team, target: Floats, source: Floats, count: int):
    """Copy the first `count` numbers of `source` to `target`, divided among the threads.

    Both arrays may be empty; then nothing is copied.
    """
    k, last = thread_range(team, 0, wp.min(count, target.shape[0]))
    while k < last:
        put(target, k, at(source, k))
        k += 1


@wp.func
def begin_momentum(team: Team, s: Scene):
    """Set t = 1 and beta = 0, and save velocities and corrections as those before the last sweep."""
    i, last = thread_range(team, 0, body_count(s))
    while i < last:
        put(s.momentum.last_velocity, i, at(s.grains.next_velocity, i))
        i += 1
    copy_numbers(team, s.contacts.dv.last, s.contacts.dv.now, contact_count(s))
    copy_numbers(team, s.momentum.last_rim, s.grains.next_rim, grain_count(s))
    copy_numbers(team, s.contacts.dvt.last, s.contacts.dvt.now, contact_count(s))
    copy_numbers(team, s.contacts.dvr.last, s.contacts.dvr.now, contact_count(s))
    if team.rank == 0:
        s.momentum.t = f64(1.0)
        s.momentum.beta = f64(0.0)
        s.momentum.relaxation = RELAXATION


def extrapolating(friction: bool) -> wp.Function:
    """Return the stage that extrapolates velocities to y (eq. 13); without friction, it sums terms of phi."""

    @named(f"extrapolate{'_with_friction' * friction}")
    def extrapolate(team: Team, s: Scene):
        n = body_count(s)
        grains = s.grains
        last_velocity = s.momentum.last_velocity
        last_rim = s.momentum.last_rim
        beta = s.momentum.beta
        begin, end = thread_range(team, 0, chunks_in(n))
        for k in range(begin, end):
            energy = f64(0.0)
            size = f64(0.0)
            i = k * CHUNK
            stop = wp.min(n, (k + 1) * CHUNK)
            while i < stop:
                v = at(grains.next_velocity, i)
                change = v - at(last_velocity, i)
                y = v + beta * change
                put(last_velocity, i, v)
                put(grains.next_velocity, i, y)
                if wp.static(friction):
                    if rotates(s, i):
                        u = at(grains.next_rim, i)
                        put(grains.next_rim, i, u + beta * (u - at(last_rim, i)))
                        put(last_rim, i, u)
                else:
                    m = mass_in_phi(s, i)
                    energy = energy + m * wp.dot(change, v + y)
                    size = size + m * wp.dot(v, v)
                i += 1
            if wp.static(not friction):
                put(s.momentum.body_sums, k, wp.vec2d(energy, size))

    return extrapolate


extrapolate, extrapolate_with_friction = extrapolating(False), extrapolating(True)
