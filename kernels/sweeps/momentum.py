"""The accelerated method: momentum around a sweep that goes a little too far, and what judges it.

A sweep is coordinate descent on the dual objective of the step (MODEL.md, eq. 14),

    phi = 1/2 sum_i M_i |v_i|^2 + sum_c mu_c dv_c gap_c / dt,    mu_c = M_i M_j / (M_i + M_j), M_i at a wall.

Between two sweeps, corrections x and velocities are extrapolated along the line from the last ones,
y = x + beta (x - last), with beta = (t - 1) / t', t' = (1 + sqrt(1 + 4 t^2)) / 2 (Nesterov 1983; eq. 13).
With beta grows the over-relaxation of the sweep (Young 1954). A sweep from y sums its cost in phi less its
gain, and the slope of phi along the momentum, by chunks of the working set (working_set.py).

A sweep that does not make good what going on to y has cost in phi is rejected, which stops momentum as well;
so phi falls from sweep to sweep. Momentum also stops when it points up the gradient (O'Donoghue and Candes
2015). t is only halved then, so that the next run is soon as fast (Liang, Luo and Schoenlieb 2022). Near the
end it is held back, because momentum would keep the waves of impacts alive for long.

With friction a step is no minimization, so that no objective can judge a sweep, and none is rejected.
Without that safeguard, momentum with beta near 1 diverges, and over-relaxation does at any beta. So sweeps
do not go too far here, beta is capped, and momentum stops where the change of a sweep, squared and summed
in the mass metric, has grown. Steps that momentum keeps from converging get on by plain sweeps, so that the
cap falls after 500 sweeps.

Velocities that are corrected in place gather rounding errors, and momentum carries these on. Now and then
they are recomputed from the corrections, and the last ones moved by as much.
"""

import warp as wp

from ..access import at, named, put
from ..contacts import CHUNK, chunk_count, chunks_in, contact_count
from ..record import Scene, body_count, grain_count, has_friction, has_rolling, has_weights, rotates
from ..team.threads import Team, thread_range
from ..types import Floats

f64 = wp.float64
RELAXATION = wp.constant(f64(0.25))  # by how much a sweep goes too far at beta = 1, at first
ENOUGH = wp.constant(f64(0.99))  # part of its own decrease of phi that a sweep must keep
ROUNDING = wp.constant(f64(2.0e-15))
RELAXATION_BACKOFF = wp.constant(f64(0.8))  # what a rejected sweep leaves of the over-relaxation
MOMENTUM_BACKOFF = wp.constant(f64(0.5))  # what a stop leaves of t
NEAR_END = wp.constant(f64(6.0))  # times the tolerance: below that zeta, t is held back to the largest of
T_ANYWAY = wp.constant(f64(24.0))
T_PER_FALL = wp.constant(f64(1.5))  # times sqrt(zeta of the first sweep / tolerance)
T_PER_SWEEP = wp.constant(f64(0.2))  # times the sweeps so far
# With friction:
GROWTH = wp.constant(f64(1.2))  # of the change of a sweep, above which momentum stops
CAP = wp.constant(f64(0.85))  # of beta
FADE = wp.constant(f64(500.0))  # sweeps after which the cap falls, as one over their number


@wp.func
def relaxation_factor(s: Scene) -> f64:
    """Return omega: the multiple of its own correction that a contact is given (eq. 13)."""
    return f64(1.0) + s.momentum.state.relaxation * s.momentum.state.beta


@wp.func
def mass_in_phi(s: Scene, i: int) -> f64:
    """Return the contact mass of a body; where all masses are equal, phi is by unit mass."""
    if has_weights(s):
        return at(s.grains.contact_mass, i)
    return f64(1.0)


@wp.func
def take_t_on(s: Scene, zeta: f64):
    """Choose t and beta of the next sweep (eq. 13), near the end with more damping."""
    sweeps = s.step.iterations + 1
    tolerance = s.stopping.tolerance
    if sweeps == 1:
        s.momentum.state.first_zeta = zeta
    t = s.momentum.state.t
    following = f64(0.5) * (f64(1.0) + wp.sqrt(f64(1.0) + f64(4.0) * t * t))
    s.momentum.state.beta = (t - f64(1.0)) / following
    if zeta < NEAR_END * tolerance:
        fall = T_PER_FALL * wp.sqrt(s.momentum.state.first_zeta / tolerance)
        following = wp.min(following, wp.max(T_ANYWAY, wp.max(fall, T_PER_SWEEP * f64(sweeps))))
    s.momentum.state.t = following


@wp.func
def back_off(s: Scene):
    """Stop momentum for one sweep, and halve t."""
    s.momentum.state.t = wp.max(f64(1.0), MOMENTUM_BACKOFF * s.momentum.state.t)
    s.momentum.state.beta = f64(0.0)


@wp.func
def sum_of_chunks(s: Scene) -> wp.vec2d:
    """Return the sums over all contacts that a sweep has taken by chunks."""
    total = wp.vec2d()
    for k in range(chunk_count(s)):
        total = total + at(s.momentum.contact_sums, k)
    return total


@wp.func
def accept_or_reject(s: Scene, zeta: f64):
    """Reject a sweep after which phi has risen; otherwise choose t and beta of the next one."""
    total = sum_of_chunks(s)
    energy = f64(0.0)
    size = f64(0.0)
    for k in range(chunks_in(body_count(s))):
        moving = at(s.momentum.body_sums, k)
        energy = energy + moving[0]
        size = size + moving[1]
    beta = s.momentum.state.beta
    rejected = beta > f64(0.0) and total[0] + beta * (f64(0.5) * energy - ROUNDING * size) > f64(0.0)
    if rejected:
        s.momentum.state.relaxation = RELAXATION_BACKOFF * s.momentum.state.relaxation
    if rejected or total[1] > f64(0.0):
        back_off(s)
    else:
        take_t_on(s, zeta)
    s.control.rejected = 1 if rejected else 0


@wp.func
def limit_momentum(s: Scene, zeta: f64):
    """Choose t and beta of the next sweep with friction, below the cap."""
    total = sum_of_chunks(s)
    grown = s.momentum.state.beta > f64(0.0) and total[0] > GROWTH * s.momentum.state.change
    s.momentum.state.change = total[0]
    if total[1] > f64(0.0) or grown:
        back_off(s)
    else:
        take_t_on(s, zeta)
        cap = CAP * wp.min(f64(1.0), FADE / f64(s.step.iterations + 1))
        s.momentum.state.beta = wp.min(cap, s.momentum.state.beta)


@wp.func
def roll_back(s: Scene, chunk: int):
    """Restore the corrections that a chunk of the working set had before a rejected sweep."""
    bounds = at(s.working.range, chunk)
    c = int(bounds[0])
    while c < bounds[1]:
        put(s.working.contacts.dv, c, at(s.working.contacts.last_dv, c))
        c += 1


@wp.func
def roll_back_velocity(s: Scene, i: int):
    """Restore the velocity that a body had before a rejected sweep."""
    put(s.grains.next_velocity, i, at(s.momentum.last_velocity, i))


@wp.func
def take_recomputed_velocity(s: Scene, i: int):
    """Set the velocity of a body, and its rim's, to the recomputed one, and shift the last one as much."""
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
    """Copy the first numbers of an array."""
    k, last = thread_range(team, 0, count)
    while k < last:
        put(target, k, at(source, k))
        k += 1


@wp.func
def begin_momentum(team: Team, s: Scene):
    """Start without momentum."""
    i, last = thread_range(team, 0, body_count(s))
    while i < last:
        put(s.momentum.last_velocity, i, at(s.grains.next_velocity, i))
        i += 1
    copy_numbers(team, s.contacts.last_dv, s.contacts.dv, contact_count(s))
    if has_friction(s):
        copy_numbers(team, s.momentum.last_rim, s.grains.next_rim, grain_count(s))
        copy_numbers(team, s.contacts.last_dvt, s.contacts.dvt, contact_count(s))
    if has_rolling(s):
        copy_numbers(team, s.contacts.last_dvr, s.contacts.dvr, contact_count(s))
    if team.rank == 0:
        s.momentum.state.t = f64(1.0)
        s.momentum.state.beta = f64(0.0)
        s.momentum.state.relaxation = RELAXATION


def extrapolating(friction: bool) -> wp.Function:
    """Return the stage that extrapolates to y and, without friction, sums the kinetic part of phi."""

    @named(f"extrapolate{'_with_friction' * friction}")
    def extrapolate(team: Team, s: Scene):
        n = body_count(s)
        grains = s.grains
        last_velocity = s.momentum.last_velocity
        last_rim = s.momentum.last_rim
        beta = s.momentum.state.beta
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
