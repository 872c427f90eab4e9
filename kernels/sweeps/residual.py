"""The natural residual: the error of a solution, with one definition for all methods and orders.

    eta = max over contacts of | max(0, dv_c + vn - gap/dt) - dv_c |    (MODEL.md, eq. 12).

The two sides of a wall count separately. Velocities are the free velocities plus all corrections, and at a
round wall the gap depends on them. No contact closes faster than gap/dt + eta. The velocities are the exact
solution of a step with slightly different data: gaps that differ by at most dt * eta, and free velocities
that differ by the corrections of contacts that should carry none, at most eta each.

If sweeps converge too slowly, the step waits as SLOW (attempt.py), and the host solves it
(warpgrains/solver/exact). Velocities are then recomputed from the host's corrections, and sweeps continue
until they meet the tolerance; mostly no sweep is needed. If the host finds no better corrections, the sweeps
resume. The way in which corrections were found does not matter: a contact that is not listed and that the
final velocities do not violate is satisfied without a correction (eq. 10). So the check of the list starts
again from the final velocities.
"""

from functools import cache

import warp as wp

from .. import law
from ..access import at, bodies_of, contact_at, larger, named, put
from ..contacts import apply, contact_count, contacts_of, gap_rates_now, rim_weights, surface_of, value_at
from ..record import Scene, has_rolling, is_driven, pair_count, rotates
from ..team.threads import Team, thread_range, update_max
from ..walls.driven import leader_of, levers, shares_of_wall
from .rolling import apply_rolling, rolling_residual

f64 = wp.float64


@wp.func
def begin_recomputing(s: Scene, i: int):
    """Set the recomputed velocity and rim speed of body i to the free ones."""
    put(s.grains.recomputed_velocity, i, at(s.grains.free_velocity, i))
    if rotates(s, i):
        put(s.grains.recomputed_rim, i, at(s.grains.free_rim, i))


@wp.func
def recompute(team: Team, s: Scene, k: int):
    """Add the corrections of the contacts of set k to the recomputed velocities and rim speeds."""
    velocity, rim = s.grains.recomputed_velocity, s.grains.recomputed_rim
    c, end = contacts_of(team, s, k)
    while c < end:
        contact = contact_at(s.contacts.contact, c)
        dv, dvt = at(s.contacts.dv.now, c), value_at(s.contacts.dvt.now, c)
        apply(s, velocity, rim, contact, c, dv, dvt)
        if has_rolling(s):
            apply_rolling(s, rim, contact, c, at(s.contacts.dvr.now, c))
        c += 1


@cache
def measuring(friction: bool, resists_rolling: bool) -> wp.Function:
    """Return the stage that finds the largest residual of the contacts of each thread [m/s].

    With friction, the residual of a contact is the largest of its normal, tangential and rolling parts
    (eqs. 25 and 38).
    """

    @wp.func
    def residual(s: Scene, c: int) -> f64:
        """Return the residual of a contact [m/s]."""
        contact, velocity = contact_at(s.contacts.contact, c), s.grains.recomputed_velocity
        i, j = bodies_of(contact)
        n, gap, v, dv = contact.n, f64(contact.gap_rate), at(velocity, i), at(s.contacts.dv.now, c)
        at_wall = c >= pair_count(s)
        change, compliance = f64(0.0), f64(1.0)
        along, tangential = f64(0.0), f64(0.0)  # of a driven wall: speed along the tangent, and g_t h_t
        if at_wall and is_driven(s):
            lever, speed = levers(s, j, n), at(velocity, leader_of(s, j))[0]
            share = shares_of_wall(s, i, j, lever)
            compliance = f64(1.0) + lever[0] * share[0]
            change = law.driven_change(wp.dot(v, n) - lever[0] * speed - gap, dv, compliance)
            along, tangential = lever[1] * speed, lever[1] * share[1]
        elif at_wall:
            gap, back = gap_rates_now(s.contacts, c, v)
            if wp.static(not friction):  # walls have one side where there is friction
                return law.wall_residual(wp.dot(v, n), dv, gap, back)
            change = law.normal_change(wp.dot(v, n), dv, gap)
        else:
            v = v - at(velocity, j)
            change = law.normal_change(wp.dot(v, n), dv, gap)
        worst = compliance * wp.abs(change)
        if wp.static(friction):
            rim, dvt = s.grains.recomputed_rim, at(s.contacts.dvt.now, c)
            vt, mu = f64(0.0), f64(s.friction)
            if at_wall:
                surface = surface_of(s, c)
                vt, mu = law.wall_slip(v, n, at(rim, i), surface[1] + along), surface[0]
            else:
                vt = law.pair_slip(v, n, at(rim, i), at(rim, j))
            rims = rim_weights(s, c, at_wall)
            inverse_kt = rims[0]
            if at_wall and is_driven(s):
                inverse_kt = law.inverse_kt(rims[1], tangential)
            worst = wp.max(worst, law.tangential_residual(vt, dvt, inverse_kt, mu * (dv + change)))
        if wp.static(resists_rolling):
            worst = wp.max(worst, rolling_residual(s, contact, c, dv + change))
        return worst

    @named(f"measure_residual{'_with_friction' * friction}{'_and_rolling' * resists_rolling}")
    def measure(team: Team, s: Scene):
        worst = f64(0.0)
        c, end = thread_range(team, 0, contact_count(s))
        while c < end:
            worst = larger(worst, residual(s, c))
            c += 1
        update_max(team, s.partial.residual, worst)

    return measure


@wp.func
def take_corrected_velocity(s: Scene, i: int):
    """If the host has found corrections, set velocity and rim speed of body i to the recomputed ones."""
    if s.control.resuming == 0:
        put(s.grains.next_velocity, i, at(s.grains.recomputed_velocity, i))
        if rotates(s, i):
            put(s.grains.next_rim, i, at(s.grains.recomputed_rim, i))
