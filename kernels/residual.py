"""The error of a solve, defined once and the same for every method and order: the natural residual.

    eta = max over contacts of | max(0, dv_c + vn - gap/dt) - dv_c |    (MODEL.md, eq. 12),

both walls apart, for the velocities that the corrections make of the free ones, and the gaps that a round
wall leaves to these. No contact closes faster than gap/dt + eta. The velocities are the exact solution of a
step whose gaps are changed by at most dt * eta, and whose free velocities by what letting go contacts still
carry, at most eta each.
"""

import warp as wp

from . import law
from .access import at, first_of, gap_rate_of, larger, named, normal_of, put, vn_of
from .contacts import apply, contact_count, contacts_of, gap_rates_now, is_wall_set
from .driven import missing_correction, push_wall
from .record import Scene, is_driven, pair_count
from .threads import Team, thread_range, update_max

f64 = wp.float64


@wp.func
def begin_rebuild(s: Scene, i: int):
    """Begin with the free velocity of a body."""
    put(s.grains.rebuilt_velocity, i, at(s.grains.free_velocity, i))


@wp.func
def rebuild(team: Team, s: Scene, k: int):
    """Apply the corrections of the contacts of a set."""
    c, end = contacts_of(team, s, k)
    at_wall = is_wall_set(s, k)
    contacts = s.contacts
    velocity = s.grains.rebuilt_velocity
    while c < end:
        apply(contacts, velocity, c, at(contacts.dv, c) * normal_of(contacts.contact, c), at_wall)
        if at_wall and is_driven(s):
            push_wall(s, velocity, c, at(contacts.dv, c))
        c += 1


@wp.func
def residual_of(s: Scene, c: int) -> f64:
    """Return the residual of a contact [m/s]."""
    velocity, contact, dv = s.grains.rebuilt_velocity, s.contacts.contact, at(s.contacts.dv, c)
    if c >= pair_count(s):
        if is_driven(s):
            change, compliance = missing_correction(s, velocity, c)
            return compliance * wp.abs(change)
        v = at(velocity, first_of(contact, c))
        gap, back = gap_rates_now(s.contacts, c, v)
        return law.wall_residual(wp.dot(v, normal_of(contact, c)), dv, gap, back)
    return law.natural_residual(vn_of(velocity, contact, c), dv, gap_rate_of(contact, c))


def keeping_worst(name: str, residual: wp.Function) -> wp.Function:
    """Return the stage that finds the largest residual of a thread's share of the contacts."""

    @named(name)
    def keep_worst(team: Team, s: Scene):
        worst = f64(0.0)
        c, end = thread_range(team, 0, contact_count(s))
        while c < end:
            worst = larger(worst, residual(s, c))
            c += 1
        update_max(team, s.partial.residual, worst)

    return keep_worst


measure_residual = keeping_worst("measure_residual", residual_of)
