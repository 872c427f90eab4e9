"""Accelerated sweeps with friction: capped momentum around a sweep of normal and tangential corrections.

With friction a step is no minimization, so that no objective can judge a sweep (eq. 14), and none is
rejected. Without that safeguard, momentum with beta near 1 diverges, and over-relaxation does at any beta. So
sweeps do not go too far here, beta is capped, and momentum stops where the change of a sweep, squared and
summed in the mass metric, has grown: of 80 states of 300 and 1,000 grains with mu from 0.1 to 1, none was
left with more than 1.5 times the residual of 200 plain sweeps, and half with less than 1 / 2.3 of it. It
still stops where it points uphill, in the mass metric of both corrections.
"""

import warp as wp

from . import law
from .accelerated import mass_in_phi
from .access import at, larger, put, working_first_of, working_normal_of, working_second_of
from .contacts import chunks_of_set, is_wall_set, part_count, surface_of
from .friction import rim_weights
from .record import Scene, pair_count
from .restart import back_off, take_t_on
from .stopping import count_iteration, phase_after_sweep, reduce_max
from .threads import Team, thread_range, update_max

f64 = wp.float64
GROWTH = wp.constant(f64(1.2))  # of that change, above which momentum stops
CAP = wp.constant(f64(0.85))


@wp.func
def begin_last_rim(s: Scene, i: int):
    """Start rim speeds without momentum, unless sweeps are continued."""
    if s.control.resuming == 0:
        put(s.momentum.last_rim, i, at(s.grains.next_rim, i))


@wp.func
def begin_last_dvt(s: Scene, c: int):
    """Start tangential corrections without momentum, unless sweeps are continued."""
    if s.control.resuming == 0:
        put(s.momentum.last_dvt, c, at(s.contacts.dvt, c))


@wp.func
def select_tangential(s: Scene, part: int):
    """Copy the tangential corrections of the contacts of a part that are selected."""
    bounds = at(s.working.range, part)
    c = int(bounds[0])
    while c < bounds[1]:
        k = at(s.working.index, c)
        put(s.working.dvt, c, at(s.contacts.dvt, k))
        put(s.working.last_dvt, c, at(s.momentum.last_dvt, k))
        c += 1


@wp.func
def scatter_tangential(s: Scene, part: int):
    """Write the tangential corrections of a part of the working set where all contacts have theirs."""
    bounds = at(s.working.range, part)
    c = int(bounds[0])
    while c < bounds[1]:
        k = at(s.working.index, c)
        put(s.contacts.dvt, k, at(s.working.dvt, c))
        put(s.momentum.last_dvt, k, at(s.working.last_dvt, c))
        c += 1


@wp.func
def take_rebuilt_rim(s: Scene, i: int):
    """Give a grain the rim speed that its corrections make, and move the last one by as much."""
    rebuilt, last = at(s.grains.rebuilt_rim, i), at(s.momentum.last_rim, i)
    put(s.momentum.last_rim, i, last + (rebuilt - at(s.grains.next_rim, i)))
    put(s.grains.next_rim, i, rebuilt)


@wp.func
def extrapolate_rim(s: Scene, i: int):
    """Take the rim speed on to y."""
    u = at(s.grains.next_rim, i)
    put(s.grains.next_rim, i, u + s.momentum.state.beta * (u - at(s.momentum.last_rim, i)))
    put(s.momentum.last_rim, i, u)


def sweeping(at_wall: bool) -> wp.Function:
    """Return the function that corrects contacts of the working set from y, in place.

    It takes `(scene, begin, end)` and returns the largest change of a correction, and how steeply momentum
    points downhill.
    """

    @wp.func
    def sweep(s: Scene, begin: int, end: int) -> wp.vec3d:
        velocity = s.grains.next_velocity  # assigned one by one: a tuple is read again for every contact
        rim = s.grains.next_rim
        working = s.working
        grains = s.grains
        contacts = s.contacts
        between = f64(s.friction)
        beta, first_wall = f64(s.momentum.state.beta), pair_count(s)
        zeta, slope, size = f64(0.0), f64(0.0), f64(0.0)
        c = int(begin)
        while c < end:
            i, j = working_first_of(working.contact, c), working_second_of(working.contact, c)
            normal = working_normal_of(working.contact, c)
            t = law.tangent(normal)
            x, xt = at(working.dv, c), at(working.dvt, c)
            y = x + beta * (x - at(working.last_dv, c))
            yt = xt + beta * (xt - at(working.last_dvt, c))
            vi, ui, gap = at(velocity, i), at(rim, i), at(working.gap_rate, c)
            part = rim_weights(s, at(working.index, c), wp.static(at_wall))
            weight, friction = wp.vec2d(f64(1.0), f64(0.0)), between
            mu, approach, slip = mass_in_phi(grains, contacts, i), vi, ui
            if wp.static(at_wall):
                surface = surface_of(s, at(working.index, c))
                gap = law.round_gap_rate(
                    gap, law.speed_along(vi, normal), at(working.limits, c - first_wall)[1]
                )
                friction, slip = surface[0], ui - surface[1]
            else:
                weight = wp.vec2d(f64(0.5), f64(0.5))
                if working.weights.shape[0] > 0:
                    shares = at(working.weights, c)
                    weight = wp.vec2d(shares[0], shares[1])
                mu = mu * weight[0]
                approach, slip = vi - at(velocity, j), ui + at(rim, j)
            dv = law.pair_correction(wp.dot(approach, normal), y, gap)
            vt = wp.dot(approach, t) + slip
            dvt = law.friction_correction(part[0] * vt, yt, friction * (y + dv))
            push = dv * normal + dvt * t
            put(velocity, i, vi - push * weight[0])
            put(rim, i, ui - dvt * part[1])
            if wp.static(not at_wall):
                put(velocity, j, at(velocity, j) + push * weight[1])
                put(rim, j, at(rim, j) - dvt * part[2])
            put(working.last_dv, c, x)
            put(working.last_dvt, c, xt)
            put(working.dv, c, y + dv)
            put(working.dvt, c, yt + dvt)
            zeta = larger(zeta, larger(wp.abs(dv), wp.abs(dvt)))
            wide = f64(1.0) / part[0]
            slope = slope + mu * (dv * (y + dv - x) + wide * dvt * (yt + dvt - xt))
            size = size + mu * (dv * dv + wide * dvt * dvt)
            c += 1
        return wp.vec3d(zeta, size, slope)

    return sweep


sweep_pairs, sweep_walls = sweeping(False), sweeping(True)


@wp.func
def sweep_ahead_with_friction(team: Team, s: Scene, k: int):
    """Correct the contacts of a set that are in the working set."""
    zeta = f64(0.0)
    begin, end, _, part = chunks_of_set(s, k)
    first, last = thread_range(team, begin, end)
    for chunk in range(first, last):
        bounds = at(s.working.range, part + chunk)
        found = wp.vec3d()
        if is_wall_set(s, k):
            found = sweep_walls(s, bounds[0], bounds[1])
        else:
            found = sweep_pairs(s, bounds[0], bounds[1])
        put(s.momentum.contact_part, part + chunk, wp.vec2d(found[1], -found[2]))
        zeta = larger(zeta, found[0])
    update_max(team, s.partial.zeta, zeta)


@wp.func
def end_capped_sweep(s: Scene):
    """Count a sweep, choose the momentum of the next one, and what follows."""
    zeta = reduce_max(s.partial.zeta)
    total = wp.vec2d()
    for k in range(part_count(s)):
        total = total + at(s.momentum.contact_part, k)
    grown = s.momentum.state.beta > f64(0.0) and total[0] > GROWTH * s.momentum.state.change
    s.momentum.state.change = total[0]
    if total[1] > f64(0.0) or grown:
        back_off(s)
    else:
        take_t_on(s, zeta)
        s.momentum.state.beta = wp.min(CAP, s.momentum.state.beta)
    count_iteration(s, zeta)
    s.control.phase = phase_after_sweep(s)
