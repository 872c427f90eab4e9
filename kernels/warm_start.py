"""Iteration 0: normals and gaps are frozen, and the corrections kept from the previous step applied."""

import warp as wp

from . import law
from .access import at, first_of, put, second_of, set_frame
from .contacts import apply
from .record import Scene, grain_count, pair_count
from .segments import contacts_of
from .threads import Team
from .walls import wall_frame


@wp.func
def begin_attempt(s: Scene, i: int):
    """The velocities to correct are the free ones."""
    if s.control.resuming == 0:
        put(s.grains.next_velocity, i, at(s.grains.free_velocity, i))


@wp.func
def freeze(s: Scene, c: int) -> wp.vec2d:
    """Write normal and gap of a contact (eq. 4) as grains are placed now. Returns the normal."""
    i, j, n = first_of(s.contacts.contact, c), second_of(s.contacts.contact, c), grain_count(s)
    x, radius = at(s.grains.position, i), at(s.grains.radius, i)
    if j >= n:
        normal, gap, back, reach = wall_frame(j - n, x, radius, s.walls)
        put(s.contacts.limits, c - pair_count(s), wp.vec2d(back / s.dt, reach / s.dt))
        set_frame(s.contacts.contact, c, normal, gap / s.dt)
        return normal
    normal, distance = law.normal(x, at(s.grains.position, j))
    gap = law.pair_gap(distance, radius, at(s.grains.radius, j))
    set_frame(s.contacts.contact, c, normal, gap / s.dt)
    return normal


@wp.func
def start(team: Team, s: Scene, k: int):
    """Freeze the contacts of a set, and apply their corrections."""
    c, end = contacts_of(team, s, k)
    while c < end:
        n = freeze(s, c)
        if s.control.resuming == 0:
            dv = at(s.contacts.dv_start, c)
            put(s.contacts.dv, c, dv)
            apply(s, s.grains.next_velocity, c, dv * n)
        c += 1
