"""Contacts by index: pairs, then contacts with walls; the parts over which sums are taken; one contact's law.

Chunks have a fixed length, and sums are taken over each and then in order: they are the same for any number
of threads. A chunk of pairs, or of contacts with walls, that lies in several sets is one part in each.
"""

import warp as wp

from . import law
from .access import at, first_of, gap_rate_of, normal_of, put, second_of
from .driven import change_speed
from .record import Scene, grain_count, has_friction, has_weights, is_driven, pair_count
from .threads import Team, thread_range
from .types import Contacts, Floats, Vectors

f64 = wp.float64
CHUNK = wp.constant(128)
THIRD = wp.constant(f64(1.0 / 3.0))


@wp.func
def contact_count(s: Scene) -> int:
    """Return the number of listed contacts."""
    return s.contacts.count.pairs + s.contacts.count.walls


@wp.func
def set_count(s: Scene) -> int:
    """Return the number of sets, those of contacts with walls included."""
    return s.contacts.count.sets + s.contacts.count.wall_sets


@wp.func
def is_wall_set(s: Scene, k: int) -> bool:
    """Return whether a set is of contacts with walls."""
    return k >= s.contacts.count.sets


@wp.func
def range_of_set(team: Team, s: Scene, k: int, begin: int, end: int):
    """Return this thread's range of [begin, end) of set k: all or nothing if its contacts share a wall."""
    first, last = thread_range(team, begin, end)
    if is_driven(s) and is_wall_set(s, k):
        first = wp.where(team.rank == 0, begin, end)
        last = end
    return first, last


@wp.func
def contacts_of(team: Team, s: Scene, k: int):
    """Return first contact and end of this thread's part of a set."""
    begin, end = range_of_set(team, s, k, at(s.contacts.set_start, k), at(s.contacts.set_start, k + 1))
    return begin, end


@wp.func
def chunks_in(count: int) -> int:
    """Return the number of chunks that hold `count` elements."""
    return (count + CHUNK - 1) // CHUNK


@wp.func
def part_count(s: Scene) -> int:
    """Return the number of parts of the contacts."""
    return chunks_in(pair_count(s)) + chunks_in(s.contacts.count.walls) + set_count(s)


@wp.func
def chunks_of_set(s: Scene, k: int):
    """Return first chunk and end of a set, the contact that chunk 0 begins with, and the part of chunk 0."""
    origin, part = int(0), int(k)
    if is_wall_set(s, k):
        origin = pair_count(s)
        part = chunks_in(origin) + k
    first = (at(s.contacts.set_start, k) - origin) // CHUNK
    return first, chunks_in(at(s.contacts.set_start, k + 1) - origin), origin, part


@wp.func
def limits_at(limits: Vectors, w: int) -> wp.vec2d:
    """Return the limits of contact w with a wall [m/s] (types.Contacts); inf where no wall has any."""
    if limits.shape[0] > 0:
        return at(limits, w)
    return wp.vec2d(f64(wp.inf), f64(wp.inf))


@wp.func
def gap_rates_now(contacts: Contacts, c: int, v: wp.vec2d):
    """Return gap / dt on both sides of a wall, for a grain of velocity v [m/s] (eq. 18)."""
    limits = limits_at(contacts.limits, c - contacts.count.pairs)
    along = law.speed_along(v, normal_of(contacts.contact, c))
    return law.round_gap_rate(gap_rate_of(contacts.contact, c), along, limits[1]), limits[0]


@wp.func
def surface_of(s: Scene, c: int) -> wp.vec2d:
    """Return the friction of the wall of a contact, and its speed along the tangent [m/s] (eq. 23)."""
    surface = at(s.walls.surface, second_of(s.contacts.contact, c) - grain_count(s))
    if s.contacts.wall_speed.shape[0] > 0:
        return wp.vec2d(surface[0], at(s.contacts.wall_speed, c - pair_count(s)))
    return surface


@wp.func
def apply(s: Scene, velocity: Vectors, rim: Floats, c: int, n: wp.vec2d, dv: f64, dvt: f64):
    """Share the corrections [m/s] of a contact of normal n out to its bodies (eqs. 7, 22 and 28).

    They are given, because reading again what START has just written takes a tenth of a step of one sweep.
    """
    contacts = s.contacts
    i = first_of(contacts.contact, c)
    at_wall = c >= pair_count(s)
    impulse = dv * n
    if has_friction(s):
        impulse = impulse + dvt * law.tangent(n)
        part = rim_weights(s, c, at_wall)
        put(rim, i, at(rim, i) - dvt * part[1])
        if not at_wall:
            j = second_of(contacts.contact, c)
            put(rim, j, at(rim, j) - dvt * part[2])
    if at_wall:
        put(velocity, i, at(velocity, i) - impulse)
        if is_driven(s):
            change_speed(s, velocity, i, second_of(contacts.contact, c), n, dv)
        return
    j, weight = second_of(contacts.contact, c), wp.vec2d(f64(0.5), f64(0.5))
    if has_weights(s):
        weight = at(contacts.weights, c)
    put(velocity, i, at(velocity, i) - impulse * weight[0])
    put(velocity, j, at(velocity, j) + impulse * weight[1])


@wp.func
def tangential_at(dvts: Floats, c: int) -> f64:
    """Return a tangential correction [m/s]; 0 without friction, where the array is empty."""
    if dvts.shape[0] > 0:
        return at(dvts, c)
    return f64(0.0)


@wp.func
def rim_weights(s: Scene, c: int, at_wall: bool) -> wp.vec3d:
    """Return 1 / K_t of a contact, and the parts of a tangential correction that its rims take (eq. 22)."""
    if has_weights(s):
        return at(s.contacts.rim_weights, c)
    if at_wall:
        return wp.vec3d(THIRD, f64(2.0), f64(0.0))
    return wp.vec3d(THIRD, f64(1.0), f64(1.0))


@wp.func
def find_rim_weights(s: Scene, i: int, j: int) -> wp.vec3d:
    """Compute the rim weights of a contact from the masses of grain i, and of grain or wall j."""
    k_i = f64(2.0) * at(s.grains.contact_mass, i) / at(s.grains.rim_mass, i)
    if j >= grain_count(s):
        return wp.vec3d(f64(1.0) / (f64(1.0) + k_i), k_i, f64(0.0))
    mass_i, mass_j = at(s.grains.contact_mass, i), at(s.grains.contact_mass, j)
    k_j = f64(2.0) * mass_j / at(s.grains.rim_mass, j)
    part_i = law.mass_share(mass_i, mass_j) * k_i
    part_j = law.mass_share(mass_j, mass_i) * k_j
    return wp.vec3d(f64(1.0) / (f64(1.0) + part_i + part_j), part_i, part_j)
