"""Contacts by index (pairs, then contacts with walls), and chunks of contacts over which sums are taken.

Contacts are divided into blocks [m CHUNK, (m + 1) CHUNK). A chunk is the intersection of a block and a set:
chunk q of set k is in block m = q - k. Each set adds 1, because a block in which a set ends has two chunks.
Sums are taken over each chunk, and then over the chunks in order, so that they are the same for any number of
threads. The contacts of one grain with walls are never divided between two threads or chunks.
"""

import warp as wp

from . import law
from .access import at, bodies_of, contact_at, put
from .record import Scene, grain_count, has_friction, has_weights, is_driven, pair_count
from .team.threads import Team, thread_range
from .types import Contact, Contacts, Floats, Vectors
from .walls.driven import change_speed

f64 = wp.float64
CHUNK = wp.constant(128)
EQUAL_RIMS = wp.constant(wp.vec3d(1.0 / 3.0, 1.0, 1.0))  # `rim_weights` of a pair if all masses are equal


@wp.func
def contact_count(s: Scene) -> int:
    """Return the number of listed contacts."""
    return s.contacts.count.pairs + s.contacts.count.walls


@wp.func
def set_count(s: Scene) -> int:
    """Return the number of sets: the sets of pairs, plus one for all contacts with walls."""
    return s.contacts.count.sets + 1


@wp.func
def is_wall_set(s: Scene, k: int) -> bool:
    """Return whether set k contains the contacts with walls."""
    return k == s.contacts.count.sets


@wp.func
def next_grain(s: Scene, c: int) -> int:
    """Return c if it is the index of a pair; at walls, the first index >= c at which another grain begins.

    A range that begins there does not divide the contacts of one grain with walls. If no grain begins there,
    this is the number of contacts.
    """
    k = int(c)
    while k > pair_count(s) and k < contact_count(s):
        if contact_at(s.contacts.contact, k).i != contact_at(s.contacts.contact, k - 1).i:
            break
        k += 1
    return k


@wp.func
def range_of_set(team: Team, s: Scene, k: int, begin: int, end: int):
    """Return (begin, end) of this thread's part of a range [begin, end) of contacts or chunks of set k.

    If a force drives a wall, the first thread has the whole range of the contacts with walls.
    """
    first, last = thread_range(team, begin, end)
    if is_driven(s) and is_wall_set(s, k):
        first = wp.where(team.rank == 0, begin, end)
        last = end
    return first, last


@wp.func
def contacts_of(team: Team, s: Scene, k: int):
    """Return (first contact, end) of the contacts in set k that this thread processes."""
    first, last = range_of_set(team, s, k, at(s.contacts.set_start, k), at(s.contacts.set_start, k + 1))
    if is_wall_set(s, k):
        first, last = next_grain(s, first), next_grain(s, last)
    return first, last


@wp.func
def chunks_in(count: int) -> int:
    """Return the number of blocks of CHUNK elements that hold `count` elements."""
    return (count + CHUNK - 1) // CHUNK


@wp.func
def chunk_count(s: Scene) -> int:
    """Return the number of chunks of all contacts, including empty chunks where a set ends with a block."""
    return chunks_in(contact_count(s)) + set_count(s)


@wp.func
def chunks_of_set(s: Scene, k: int):
    """Return the first chunk of set k, and the index after its last chunk."""
    return at(s.contacts.set_start, k) // CHUNK + k, chunks_in(at(s.contacts.set_start, k + 1)) + k


@wp.func
def contacts_of_chunk(s: Scene, k: int, chunk: int):
    """Return (first contact, end) of a chunk of set k.

    `chunk` is its number among the chunks of all sets. A chunk is the part of a set in one block of `CHUNK`
    contacts.
    """
    begin = wp.max(at(s.contacts.set_start, k), (chunk - k) * CHUNK)
    end = wp.min(at(s.contacts.set_start, k + 1), (chunk - k + 1) * CHUNK)
    if is_wall_set(s, k):
        begin, end = next_grain(s, begin), next_grain(s, end)
    return begin, end


@wp.func
def limits_at(limits: Vectors, w: int) -> wp.vec2d:
    """Return (gap / dt of the other side, A / dt of eq. 18) of the w-th contact with a wall [m/s].

    Both are inf if the array is empty, because no wall of the scene has such a limit.
    """
    if limits.shape[0] > 0:
        return at(limits, w)
    return wp.vec2d(f64(wp.inf), f64(wp.inf))


@wp.func
def gap_rates_now(contacts: Contacts, c: int, v: wp.vec2d):
    """Return gap / dt [m/s] of contact c with a wall: on the side of the normal, and on the other side.

    At a round wall, the first depends on the velocity v of the grain (eq. 18). The second is inf at a wall
    with one side.
    """
    contact, limits = contact_at(contacts.contact, c), limits_at(contacts.limits, c - contacts.count.pairs)
    return law.round_gap_rate(contact.gap_rate, law.speed_along(v, contact.n), limits[1]), limits[0]


@wp.func
def surface_of(s: Scene, c: int) -> wp.vec2d:
    """Return (coefficient of friction, speed along the tangent [m/s]) of the wall of contact c (eq. 23)."""
    _, j = bodies_of(contact_at(s.contacts.contact, c))
    surface = at(s.walls.surface, j - grain_count(s))
    if s.contacts.wall_speed.shape[0] > 0:
        return wp.vec2d(surface[0], at(s.contacts.wall_speed, c - pair_count(s)))
    return surface


@wp.func
def apply(s: Scene, velocity: Vectors, rim: Floats, contact: Contact, c: int, dv: f64, dvt: f64):
    """Add the corrections dv, dvt [m/s] of contact c to `velocity` and `rim` of its bodies (eqs. 7, 22, 28).

    `velocity` and `rim` are changed in place; `contact` is contact c. dv and dvt are arguments, because
    reading them from the arrays to which `warm_start` has just written them takes 10 % of a short step.
    """
    i, j = bodies_of(contact)
    at_wall = c >= pair_count(s)
    impulse = dv * contact.n
    if has_friction(s):
        impulse = impulse + dvt * law.tangent(contact.n)
        rims = rim_weights(s, c, at_wall)
        put(rim, i, at(rim, i) - dvt * rims[1])
        if not at_wall:
            put(rim, j, at(rim, j) - dvt * rims[2])
    if at_wall:
        put(velocity, i, at(velocity, i) - impulse)
        if is_driven(s):
            change_speed(s, velocity, i, j, contact.n, dv, dvt)
        return
    weight = wp.vec2d(f64(0.5), f64(0.5))
    if has_weights(s):
        weight = at(s.contacts.weights, c)
    put(velocity, i, at(velocity, i) - impulse * weight[0])
    put(velocity, j, at(velocity, j) + impulse * weight[1])


@wp.func
def value_at(numbers: Floats, c: int) -> f64:
    """Return numbers[c], or 0 if the array is empty because the scene does not need it."""
    if numbers.shape[0] > 0:
        return at(numbers, c)
    return f64(0.0)


@wp.func
def rim_weights(s: Scene, c: int, at_wall: bool) -> wp.vec3d:
    """Return (1 / K_t, share_i k_i, share_j k_j) of contact c (eq. 22); the third is 0 at a wall.

    The last two are the changes of the rim speeds by a tangential correction of 1 m/s.
    """
    if has_weights(s):
        return at(s.contacts.rim_weights, c)
    if at_wall:
        return wp.vec3d(EQUAL_RIMS[0], f64(2.0), f64(0.0))
    return EQUAL_RIMS
