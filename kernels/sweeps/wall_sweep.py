"""The sweep over contacts with walls: corrections in place (MODEL.md, eqs. 8, 13, 18, 23, 29 and 37).

One loop serves all methods, by the static flags of pair_sweep.py and by `driven`: a force drives a wall.
"""

import warp as wp

from .. import law
from ..access import at, bodies_of, contact_at, larger, put
from ..contacts import limits_at, rim_weights, surface_of
from ..record import Scene, pair_count
from ..search.verlet import least_monitored_correction, monitor
from ..types import ContactsByRef, CorrectionByRef
from ..walls.driven import leader_of, levers, shares_of_wall
from .momentum import ENOUGH, mass_in_phi, relaxation_factor
from .rolling import rolling_at_wall

f64 = wp.float64


def sweeping_walls(driven: bool, friction: bool, resists_rolling: bool, ahead: bool) -> wp.Function:
    """Return the function `(scene, contacts, begin, end)` that corrects contacts with walls.

    It returns (largest change of a correction [m/s], both sums of momentum.py). A plain sweep ignores the
    sums. `driven`: a force drives a wall. `ahead`: the sweep is accelerated.
    """

    @wp.func
    def bounded(
        correction: CorrectionByRef, c: int, beta: f64, v: f64, inverse_k: f64, bound: f64
    ) -> wp.vec3d:
        """Correct dv_t or dv_r of contact c by inverse_k v, clamped so that it is at most `bound` in size.

        Returns (change, its terms of both sums of momentum.py).
        """
        x = at(correction.now, c)
        y, size, slope = x, f64(0.0), f64(0.0)
        if wp.static(ahead):
            y = x + beta * (x - at(correction.last, c))
            put(correction.last, c, x)
        change = law.tangential_change(inverse_k * v, y, bound)
        put(correction.now, c, y + change)
        if wp.static(ahead):
            wide = change / inverse_k
            size = wide * change
            slope = wide * (y + change - x)
        return wp.vec3d(change, size, slope)

    @wp.func(inline=not driven)
    def sweep_walls(s: Scene, contacts: ContactsByRef, begin: int, end: int) -> wp.vec3d:
        velocity = s.grains.next_velocity  # assigned one by one: a tuple is read again for every contact
        rim = s.grains.next_rim
        walls = contacts.contact
        dvs = contacts.dv.now
        all_limits = contacts.limits
        beta, omega = s.momentum.beta, f64(1.0)
        if wp.static(ahead and not friction):
            omega = relaxation_factor(s)
        large, first_wall = least_monitored_correction(s), pair_count(s)
        total = wp.vec3d()
        c = int(begin)
        while c < end:
            contact = contact_at(walls, c)
            i, j = bodies_of(contact)
            n, gap_rate = contact.n, f64(contact.gap_rate)
            v, x, listed = at(velocity, i), at(dvs, c), c
            y = x
            if wp.static(ahead):
                y = x + beta * (x - at(contacts.dv.last, c))
                put(contacts.dv.last, c, x)
                listed = at(s.working.index, c)
            limits, compliance = limits_at(all_limits, c - first_wall), f64(1.0)
            if wp.static(driven):
                leader, lever = leader_of(s, j), levers(s, j, n)
                share, speed = shares_of_wall(s, i, j, lever), at(velocity, leader)[0]
                compliance = f64(1.0) + lever[0] * share[0]
                excess = wp.dot(v, n) - lever[0] * speed - gap_rate
                dv = law.driven_change(omega * excess, y, compliance)
                speed = speed + dv * share[0]
            else:
                gap_rate = law.round_gap_rate(gap_rate, law.speed_along(v, n), limits[1])
                vn = wp.dot(v, n)
                dv = law.projection(omega * vn, y, omega * gap_rate, omega * limits[0]) - y
                excess = vn - gap_rate
            new, wide_dv, push = y + dv, compliance * dv, dv * n
            change, cost, slope = wp.abs(wide_dv), f64(0.0), wide_dv * (new - x)
            put(dvs, c, new)
            if wp.static(friction):
                surface, rims = surface_of(s, listed), rim_weights(s, listed, True)
                along, inverse_kt = surface[1], rims[0]
                if wp.static(driven):
                    along = surface[1] + lever[1] * speed
                    inverse_kt = law.inverse_kt(rims[1], lever[1] * share[1])
                u, bound = at(rim, i), surface[0] * new
                vt = law.wall_slip(v, n, u, along)
                slipped = bounded(contacts.dvt, c, beta, vt, inverse_kt, bound)
                dvt = slipped[0]
                push = push + dvt * law.tangent(n)
                put(rim, i, u - dvt * rims[1])
                if wp.static(driven):
                    change = larger(change, (f64(1.0) + lever[1] * share[1]) * wp.abs(dvt))
                    speed = speed + dvt * share[1]
                else:
                    change = larger(change, wp.abs(dvt))
                cost = wide_dv * dv + slipped[1]
                slope = slope + slipped[2]
                if wp.static(resists_rolling):
                    rolls = rolling_at_wall(s, j)
                    vr, bound = law.wall_roll(at(rim, i), at(s.grains.radius, i), rolls[1]), rolls[0] * new
                    rolled = bounded(contacts.dvr, c, beta, vr, f64(1.0) / rims[1], bound)
                    put(rim, i, at(rim, i) - rolled[0] * rims[1])
                    change = larger(change, wp.abs(rolled[0]))
                    cost = cost + rolled[1]
                    slope = slope + rolled[2]
            elif wp.static(ahead):
                cost = rise_of_phi(x, y, dv, excess, gap_rate, limits[0], compliance)
            put(velocity, i, v - push)
            if wp.static(driven):
                put(velocity, leader, wp.vec2d(speed, f64(0.0)))
            zeta = larger(total[0], change)
            if wp.static(ahead):
                mass = mass_in_phi(s, i)
                total = wp.vec3d(zeta, total[1] + mass * cost, total[2] - mass * slope)
            else:
                total[0] = zeta
                if change > large:
                    monitor(s, i, at(velocity, i))
                if wp.static(driven):  # its changes add up: the wall has more contacts than a grain
                    monitor(s, leader, at(velocity, leader))
            c += 1
        return total

    return sweep_walls


@wp.func
def rise_of_phi(x: f64, y: f64, dv: f64, excess: f64, gap_rate: f64, back_rate: f64, compliance: f64) -> f64:
    """Return the term of a contact in the test of eq. 14, per unit mass [m2/s2].

    A term < 0 counts in favor of the sweep. Momentum takes the correction from x to y, and the visit takes it
    from y to y + dv. The term is the change of phi by momentum minus `ENOUGH` times the decrease by the
    visit.
    """
    cost_y = law.wall_cost(y, gap_rate, back_rate)
    linear = law.wall_cost(y + dv, gap_rate, back_rate) - cost_y
    gain = dv * (excess + gap_rate - f64(0.5) * compliance * dv) - linear
    return cost_y - law.wall_cost(x, gap_rate, back_rate) - ENOUGH * gain
