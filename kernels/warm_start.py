"""Iteration 0: normals and gaps are frozen, and the corrections kept from the previous step applied."""

import warp as wp

from . import law
from .access import at, bodies_of, contact_at, put
from .contacts import apply, contacts_of, is_wall_set, value_at
from .record import Scene, grain_count, has_friction, pair_count, rotates
from .threads import Team
from .types import Contact
from .walls import surface_speed, wall_contact, way

f64 = wp.float64


@wp.func
def begin_velocity(s: Scene, i: int):
    """Begin with the free velocity of a body, and the free speed of its rim."""
    put(s.grains.next_velocity, i, at(s.grains.free_velocity, i))
    if rotates(s, i):
        put(s.grains.next_rim, i, at(s.grains.free_rim, i))


@wp.func
def frozen(s: Scene, c: int, at_wall: bool) -> Contact:
    """Return a contact with the normal and gap (eq. 4) that it has as grains are placed now."""
    contact = contact_at(s.contacts.contact, c)
    i, j = bodies_of(contact)
    x, radius = at(s.grains.position, i), at(s.grains.radius, i)
    if at_wall:
        b = j - grain_count(s)
        normal, gap, back, circle = wall_contact(b, x, radius, s.walls)
        if wp.isnan(normal[0]) and wp.min(gap, back) > f64(0.0):
            normal = wp.vec2d()  # no force: `grain_beyond_wall` checks that none is due
            s.verlet.flags.without_normal = 1
        if s.contacts.wall_speed.shape[0] > 0:
            point = x + (radius + gap) * normal
            put(s.contacts.wall_speed, c - pair_count(s), surface_speed(b, point, normal, s.walls))
        if s.contacts.limits.shape[0] > 0:
            put(s.contacts.limits, c - pair_count(s), wp.vec2d(back / s.dt, circle / s.dt))
        contact.n = normal
        contact.gap_rate = gap / s.dt
    else:
        normal, distance = law.normal(wp.vec2d(), way(x, at(s.grains.position, j), s.walls))
        contact.n = normal
        contact.gap_rate = law.pair_gap(distance, radius, at(s.grains.radius, j)) / s.dt
    return contact


@wp.func
def start(team: Team, s: Scene, k: int):
    """Freeze the contacts of a set, and apply their corrections unless sweeps resume.

    Other threads may read the grain of a contact meanwhile (`next_grain`), which is written as it is.
    """
    c, end = contacts_of(team, s, k)
    at_wall = is_wall_set(s, k)
    while c < end:
        contact = frozen(s, c, at_wall)
        put(s.contacts.contact, c, contact)
        if s.control.resuming == 0:
            dv, dvt = at(s.contacts.dv_start, c), value_at(s.contacts.dvt_start, c)
            put(s.contacts.dv, c, dv)
            if has_friction(s):
                put(s.contacts.dvt, c, dvt)
            apply(s, s.grains.next_velocity, s.grains.next_rim, contact, c, dv, dvt)
        c += 1


@wp.func
def keep_correction(s: Scene, c: int):
    """Let the next step start with the corrections of a contact."""
    put(s.contacts.dv_start, c, at(s.contacts.dv, c))
    if has_friction(s):
        put(s.contacts.dvt_start, c, at(s.contacts.dvt, c))
