"""Iteration 0: normals and gaps are frozen, and the corrections kept from the previous step applied."""

import warp as wp

from . import law
from .access import at, first_of, freeze_pair, put, read_wall, second_of, set_wall
from .record import Scene, wall_count
from .residual import apply_pair
from .segments import pairs_of
from .threads import Team, thread_range
from .walls import WallContact, frozen_wall


@wp.func
def begin_attempt(s: Scene, i: int):
    """The velocities to correct are the free ones."""
    if s.control.resuming == 0:
        put(s.grains.next_velocity, i, at(s.grains.free_velocity, i))


@wp.func
def start_pairs(team: Team, s: Scene, k: int):
    """Freeze the pairs of a set (eq. 4), and apply their corrections."""
    c, end = pairs_of(team, s, k)
    grains, contacts, dt = s.grains, s.contacts, s.dt
    starting = s.control.resuming == 0
    while c < end:
        i = first_of(contacts.pairs, c)
        j = second_of(contacts.pairs, c)
        n, distance = law.normal(at(grains.position, i), at(grains.position, j))
        gap = law.pair_gap(distance, at(grains.radius, i), at(grains.radius, j))
        freeze_pair(contacts.pairs, c, n, gap / dt)
        if starting:
            dv = at(contacts.pair_dv_start, c)
            put(contacts.pair_dv, c, dv)
            apply_pair(grains.next_velocity, contacts, c, dv * n)
        c += 1


@wp.func
def start_walls(team: Team, s: Scene):
    """Freeze the walls, and apply their corrections."""
    begin, end = thread_range(team, 0, wall_count(s))
    contact = WallContact()
    for c in range(begin, end):
        read_wall(s.contacts.walls, c, contact)
        i = contact.i
        x, radius = at(s.grains.position, i), at(s.grains.radius, i)
        contact = frozen_wall(contact, x, radius, s.walls, s.dt)
        if s.control.resuming == 0:
            contact.dv = at(s.contacts.wall_dv_start, c)
            put(s.grains.next_velocity, i, at(s.grains.next_velocity, i) - contact.dv * contact.n)
        set_wall(s.contacts.walls, c, contact)
