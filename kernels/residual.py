"""The error of a solve, defined once and the same for every method and order: the natural residual.

    eta = max over contacts of | max(0, dv_c + vn - gap/dt) - dv_c |    (MODEL.md, eq. 12),

both walls apart, for the velocities that the corrections make of the free ones, and the gaps that a round
wall leaves to these. No contact closes faster than gap/dt + eta. The velocities are the exact solution of a
step whose gaps are changed by at most dt * eta, and whose free velocities by what letting go contacts still
carry, at most eta each.
"""

import warp as wp

from . import law
from .access import at, first_of, gap_rate_of, larger, normal_of, put, read_wall, second_of, vn_of
from .record import Scene, pair_count, wall_count
from .segments import pairs_of
from .threads import Team, keep_largest, thread_range
from .types import Contacts, Vectors
from .walls import WallContact, has_inner, outer_gap_rate, wall_residual

f64 = wp.float64


@wp.func
def apply_pair(velocity: Vectors, contacts: Contacts, c: int, impulse: wp.vec2d):
    """Share a pair's dv n [m/s] out to its grains (eq. 7)."""
    i = first_of(contacts.pairs, c)
    j = second_of(contacts.pairs, c)
    weight = wp.vec2d(f64(0.5), f64(0.5))
    if contacts.weights.shape[0] > 0:
        weight = at(contacts.weights, c)
    put(velocity, i, at(velocity, i) - impulse * weight[0])
    put(velocity, j, at(velocity, j) + impulse * weight[1])


@wp.func
def begin_rebuild(s: Scene, i: int):
    """Begin with the free velocity."""
    put(s.grains.rebuilt_velocity, i, at(s.grains.free_velocity, i))


@wp.func
def rebuild_from_pairs(team: Team, s: Scene, k: int):
    """Apply the corrections of a set's pairs."""
    c, end = pairs_of(team, s, k)
    velocity, contacts = s.grains.rebuilt_velocity, s.contacts
    while c < end:
        impulse = at(contacts.pair_dv, c) * normal_of(contacts.pairs, c)
        apply_pair(velocity, contacts, c, impulse)
        c += 1


@wp.func
def rebuild_from_walls(team: Team, s: Scene):
    """Apply the corrections at the walls."""
    velocity = s.grains.rebuilt_velocity
    wall = WallContact()
    c, end = thread_range(team, 0, wall_count(s))
    while c < end:
        read_wall(s.contacts.walls, c, wall)
        put(velocity, wall.i, at(velocity, wall.i) - wall.dv * wall.n)
        c += 1


@wp.func
def measure_residual(team: Team, s: Scene):
    """The largest residual of this thread's share of the contacts."""
    worst = f64(0.0)
    v, contacts = s.grains.rebuilt_velocity, s.contacts
    wall = WallContact()
    c, end = thread_range(team, 0, wall_count(s))
    while c < end:
        read_wall(contacts.walls, c, wall)
        own = at(v, wall.i)
        wall.gap_rate_out = outer_gap_rate(wall, own, s.walls)
        worst = larger(worst, wall_residual(wp.dot(own, wall.n), wall, has_inner(s.walls)))
        c += 1
    c, last = thread_range(team, 0, pair_count(s))
    pairs = contacts.pairs
    while c < last:
        vn = vn_of(v, pairs, c)
        dv = at(contacts.pair_dv, c)
        worst = larger(worst, law.natural_residual(vn, dv, gap_rate_of(pairs, c)))
        c += 1
    keep_largest(team, s.partial.residual, worst)
