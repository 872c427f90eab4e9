"""Iteration 0: stages that freeze normals and gaps, and apply the corrections of the previous step."""

from functools import cache

import warp as wp

from .. import law
from ..access import at, bodies_of, contact_at, put
from ..contacts import apply, contacts_of, is_wall_set
from ..record import Kind, Scene, grain_count, is_driven, pair_count, rotates
from ..team.threads import Team
from ..types import Contact, CorrectionByRef
from ..walls.contact import surface_velocity, wall_contact
from ..walls.driven import closing_speed
from ..walls.walls import are_mobile, way
from .rolling import apply_rolling

f64 = wp.float64


@wp.func
def begin_velocity(s: Scene, i: int):
    """Set velocity and rim speed of body i to the free ones."""
    put(s.grains.next_velocity, i, at(s.grains.free_velocity, i))
    if rotates(s, i):
        put(s.grains.next_rim, i, at(s.grains.free_rim, i))


@wp.func
def bouncing_speed(s: Scene) -> f64:
    """Return the closing speed [m/s] above which contacts bounce in this step; inf if none does (eq. 35a)."""
    return wp.where(s.steps < s.first_bounce, f64(wp.inf), s.restitution_speed)


@wp.func
def rebound_at_wall(s: Scene, i: int, j: int, n: wp.vec2d, surface: f64, rates: wp.vec3d) -> wp.vec3d:
    """Return (gap / dt, gap / dt at the inner circle, A / dt of eq. 18) [m/s] of grain i at wall j.

    Restitution has been applied to both gaps (eq. 35). `rates` holds the same three numbers without it; the
    last two are inf except at the annulus. `surface` is the speed of the wall along n [m/s].
    """
    v, b, least = at(s.grains.velocity, i), j - grain_count(s), bouncing_speed(s)
    vn, e = wp.dot(v, n), at(s.walls.restitution, b)
    if is_driven(s):
        vn = closing_speed(s, s.grains.velocity, i, j, n)
    rate = law.round_gap_rate(rates[0], law.speed_along(v, n), rates[2])
    front = law.rebound(rates[0], rate, vn, surface, e, least)
    return wp.vec3d(front, law.rebound(rates[1], rates[1], -vn, -surface, e, least), rates[2])


@wp.func
def from_start(correction: CorrectionByRef, c: int) -> f64:
    """Reset one kind of correction of contact c to that at the start of the step [m/s], and return it."""
    dv = at(correction.start, c)
    put(correction.now, c, dv)
    return dv


@cache
def starting(kind: Kind) -> wp.Function:
    """Return the stage that computes normals and gaps of the contacts of a set, and applies the corrections.

    If sweeps resume, it applies no corrections.
    """

    @wp.func
    def frozen(s: Scene, c: int, at_wall: bool) -> Contact:
        """Return contact c with normal and gap rate (eq. 4) for the present positions."""
        contact = contact_at(s.contacts.contact, c)
        i, j = bodies_of(contact)
        x, radius = at(s.grains.position, i), at(s.grains.radius, i)
        if at_wall:
            b = j - grain_count(s)
            normal, gap, back, circle = wall_contact(b, x, radius, s.walls)
            if wp.isnan(normal[0]) and wp.min(gap, back) > f64(0.0):
                normal = wp.vec2d()  # no force; `grain_beyond_wall` checks that the grain does not reach it
                s.verlet.without_normal = 1
            rates, surface = wp.vec3d(gap / s.dt, back / s.dt, circle / s.dt), wp.vec2d()
            if are_mobile(s.walls):
                surface = surface_velocity(b, x, radius + gap, normal, s.walls)
                rates[0] = rates[0] + surface[0]
            if wp.static(kind.has_restitution):
                rates = rebound_at_wall(s, i, j, normal, surface[0], rates)
            contact.n = normal
            contact.gap_rate = rates[0]
            if s.contacts.wall_speed.shape[0] > 0:
                put(s.contacts.wall_speed, c - pair_count(s), at(s.walls.surface, b)[1] + surface[1])
            if s.contacts.limits.shape[0] > 0:
                put(s.contacts.limits, c - pair_count(s), wp.vec2d(rates[1], rates[2]))
        else:
            normal, distance = law.normal(wp.vec2d(), way(x, at(s.grains.position, j), s.walls))
            rate = law.pair_gap(distance, radius, at(s.grains.radius, j)) / s.dt
            if wp.static(kind.has_restitution):
                vn = wp.dot(at(s.grains.velocity, i) - at(s.grains.velocity, j), normal)
                rate = law.rebound(rate, rate, vn, f64(0.0), s.restitution, bouncing_speed(s))
            contact.n = normal
            contact.gap_rate = rate
        return contact

    @wp.func
    def start(team: Team, s: Scene, k: int):
        # Other threads may read contact.i meanwhile (`next_grain`); its value does not change.
        c, end = contacts_of(team, s, k)
        at_wall = is_wall_set(s, k)
        while c < end:
            contact = frozen(s, c, at_wall)
            put(s.contacts.contact, c, contact)
            if s.control.resuming == 0:
                dv, dvt = from_start(s.contacts.dv, c), f64(0.0)
                if wp.static(kind.has_friction):
                    dvt = from_start(s.contacts.dvt, c)
                apply(s, s.grains.next_velocity, s.grains.next_rim, contact, c, dv, dvt)
                if wp.static(kind.has_rolling):
                    apply_rolling(s, s.grains.next_rim, contact, c, from_start(s.contacts.dvr, c))
            c += 1

    return start


@wp.func
def keep(s: Scene, c: int):
    """Save the corrections of contact c, with which the next step starts."""
    keep_start(s.contacts.dv, c)
    keep_start(s.contacts.dvt, c)
    keep_start(s.contacts.dvr, c)


@wp.func
def keep_start(correction: CorrectionByRef, c: int):
    """Save one kind of correction of contact c, with which the next step starts, if the scene has it."""
    if correction.start.shape[0] > 0:
        put(correction.start, c, at(correction.now, c))
