"""The search for candidate contacts: all pairs of grains, or of grain and wall, within reach (verlet.py).

The search scans the cells around each grain (cells.py). The grain with the larger extent finds a pair, so
that few large grains among many small ones cost no more than the cells that they cover. Grains are tested
eight at a time: with one at a time, a step of 1,000 flowing grains takes 10 % longer. Walls are only tested
if the circle around them is near: without this, a step with 20 to 100 segments takes 20 % longer.

The grains are divided among the threads of a team. Each thread takes slots in blocks for the contacts that
it finds, and one thread sorts all contacts (contact_list.py). So the list does not depend on the number of
threads.
"""

import warp as wp

from .. import law
from ..access import at, checked, lowest_bit, put
from ..record import Outcome, Phase, Scene, grain_count, is_driven, time_after
from ..team.threads import Team, is_on_gpu, thread_range
from ..types import CellGrid, Ints
from ..walls.contact import is_near_wall, next_near
from ..walls.driven import leader_of
from ..walls.joints import joint_reach
from ..walls.walls import are_mobile, is_periodic, wall_body_count, wall_path
from .cells import AT_ONCE, bucket_of, cell_of
from .contact_list import is_active, pair_end

f64 = wp.float64
Begins = wp.types.vector(length=8, dtype=wp.int32)  # a mask of 64 bits has the results of eight tests
MOST_CONTACTS = wp.constant(2**30)  # of a list, so that their count never exceeds 2^31
TAKEN = 64  # slots in a block that a CPU thread takes; with single slots, threads would wait for each other
NO_CONTACT = wp.constant(wp.vec2i(-1, -1))
TOO_WIDE = wp.constant(f64(1.0 + 1.0e-12))  # so that rounding leaves no contact out


@wp.func
def is_too_long(s: Scene) -> bool:
    """Return whether more contacts have been found than a list may have."""
    return at(s.neighbors.slots, 0) > MOST_CONTACTS


@wp.func_native(
    checked(f"""
#if defined(__CUDA_ARCH__)
    return atomicAdd(&slots.data[0], 1);
#else
    return free % {TAKEN} ? free : __atomic_fetch_add(&slots.data[0], {TAKEN}, __ATOMIC_RELAXED);
#endif
""")
)
def take_slot(slots: Ints, free: int) -> int:
    """Return the slot of `found` for this thread's next contact.

    A CPU thread takes blocks of TAKEN slots. Its next slot is `free`, or the first slot of a new block if
    `free` is a multiple of TAKEN. A GPU thread takes single slots.
    """
    ...


@wp.func
def note_contact(s: Scene, free: int, i: int, j: int) -> int:
    """Write contact (i, j) to this thread's next slot (`take_slot`), and return the slot after it.

    A contact beyond the capacity of `found` takes a slot, but is not written.
    """
    if is_too_long(s):
        return free
    slot = take_slot(s.neighbors.slots, free)
    if slot < s.neighbors.found.shape[0]:
        put(s.neighbors.found, slot, wp.vec2i(i, j))
    return slot + 1


NEAR = """
    const double own_x = center[0], own_y = center[1], own = grid.extent.data[k];
    const double *x = &grid.x.data[begin], *y = &grid.y.data[begin], *extent = &grid.extent.data[begin];
    unsigned near = 0;
#if defined(__CUDA_ARCH__)
    for (int lane = 0; lane < 8; lane++) {
        const double its = extent[lane], dx = x[lane] - own_x, dy = y[lane] - own_y;
        const double reach = (own + its) * wide;
        const bool after = its < own || (its == own && begin + lane > k);
        near |= (dx * dx + dy * dy <= reach * reach && after) << lane;
    }
#else
    typedef double Numbers __attribute__((ext_vector_type(8), aligned(8)));
    typedef decltype(Numbers() < Numbers()) Lanes;
    typedef bool Bits __attribute__((ext_vector_type(8)));
    const Numbers its = *(const Numbers*)extent;
    const Numbers dx = *(const Numbers*)x - own_x, dy = *(const Numbers*)y - own_y;
    const Numbers reach = (own + its) * wide;
    const Lanes after = Lanes{0, 1, 2, 3, 4, 5, 6, 7} > Lanes(k - begin);
    const Lanes found = (dx * dx + dy * dy <= reach * reach) & ((its < own) | ((its == own) & after));
    near = __builtin_bit_cast(unsigned char, __builtin_convertvector(found, Bits));
#endif
    return end - begin < 8 ? near & ((1u << (end - begin)) - 1u) : near;
"""


@wp.func_native(checked(NEAR))
def near_mask(grid: CellGrid, k: int, center: wp.vec2d, begin: int, end: int, wide: f64) -> wp.uint64:
    """Return a mask of the indices begin to begin + 7 that are below `end` and may form a pair with index k.

    Indices are those of grains in `CellGrid`. `center` is the position of the grain at k, or of an image of
    it [m]. A pair is possible if its distance is at most `wide` times the sum of both extents. The grain with
    the larger extent finds the pair, or the grain with the lower index if the extents are equal.
    """
    ...


@wp.func
def note_pairs(s: Scene, free: int, k: int, shift: wp.vec2d, near: wp.uint64, begins: Begins) -> int:
    """Write the pairs of the grain at index k, moved by `shift` [m], that are within reach.

    Bit 8 m + b of the mask `near` is set if the index begins[m] + b may form a pair with k. Returns the next
    free slot (`take_slot`); `free` is that before.
    """
    x, y, velocity, skin, grain = s.grid.x, s.grid.y, s.grid.velocity, s.grid.skin, s.grid.grain
    left, slot = near, int(free)
    while left != wp.uint64(0):
        bit = lowest_bit(left)
        left = left & (left - wp.uint64(1))
        other = begins[bit >> 3] + (bit & 7)
        w = at(velocity, other) - at(velocity, k)
        path = s.verlet.lifetime * wp.length(w)
        reach = (at(skin, k) + at(skin, other) + path) * TOO_WIDE
        apart = wp.vec2d(at(x, other) - at(x, k), at(y, other) - at(y, k))
        d = apart - shift
        if wp.dot(d, d) <= reach * reach and d == law.nearest_image(apart, s.walls.period):
            a, b = at(grain, k), at(grain, other)
            slot = note_contact(s, slot, wp.min(a, b), wp.max(a, b))
    return slot


@wp.func
def is_near_domain(x: wp.vec2d, radius: f64, period: wp.vec2d) -> bool:
    """Return whether x is at most `radius` [m] outside [0, period] in every periodic direction."""
    near = bool(True)
    for d in range(2):
        if period[d] > f64(0.0):
            near = near and x[d] > -radius and x[d] < period[d] + radius
    return near


@wp.func
def find_pairs(s: Scene, free: int, k: int) -> int:
    """Find the pairs of the grain at index k, around this grain and its images; return the next free slot.

    Each pair is found once, by the grain with the larger extent. `free` is the next free slot before
    (`take_slot`).
    """
    own, period = wp.vec2d(at(s.grid.x, k), at(s.grid.y, k)), s.walls.period
    radius, slot = f64(2.0) * at(s.grid.extent, k) * TOO_WIDE, int(free)
    for kx in range(wp.where(period[0] > f64(0.0), 3, 1)):
        for ky in range(wp.where(period[1] > f64(0.0), 3, 1)):
            shift = wp.vec2d(f64((kx + 1) % 3 - 1) * period[0], f64((ky + 1) % 3 - 1) * period[1])
            if is_near_domain(own + shift, radius, period) and not is_too_long(s):
                slot = find_pairs_around(s, slot, k, shift, radius)
    return slot


@wp.func
def find_pairs_around(s: Scene, free: int, k: int, shift: wp.vec2d, radius: f64) -> int:
    """Find the pairs of the grain at index k, moved by `shift` [m], in the cells within `radius` [m].

    Returns the next free slot. A row of cells is one range of indices, or two ranges where the grid repeats.
    Eight indices are tested together, and the hits of eight such tests are checked together.
    """
    own, slot = wp.vec2d(at(s.grid.x, k), at(s.grid.y, k)) + shift, int(free)
    x, y = own[0], own[1]
    width, start, inverse_size = s.grid.width, s.grid.cell_start, s.grid.inverse_size
    first_x, last_x = cell_of(x - radius, inverse_size), cell_of(x + radius, inverse_size)
    first_y, last_y = cell_of(y - radius, inverse_size), cell_of(y + radius, inverse_size)
    if last_x - first_x >= width:
        first_x, last_x = 0, width - 1
    last_y = wp.min(last_y, first_y + width - 1)
    first, end = first_x & (width - 1), (last_x & (width - 1)) + 1
    repeats = first >= end
    near = wp.uint64(0)
    begins = Begins()
    tests = int(0)
    for stretch in range(wp.where(repeats, 2, 1)):
        left = wp.where(stretch == 1, 0, first)
        right = wp.where(repeats and stretch == 0, width, end)
        cy = int(first_y)
        while cy <= last_y:
            row = bucket_of(0, cy, width)
            begin = at(start, row + left)
            stop = at(start, row + right)
            while begin < stop:
                found = near_mask(s.grid, k, own, begin, stop, TOO_WIDE)
                near = near | (found << wp.uint64(AT_ONCE * tests))
                begins[tests] = begin
                begin += AT_ONCE
                tests += 1
                if tests == 8:
                    slot = note_pairs(s, slot, k, shift, near, begins)
                    near = wp.uint64(0)
                    tests = 0
            cy += 1
    return note_pairs(s, slot, k, shift, near, begins)


@wp.func
def find_walls(s: Scene, free: int, i: int) -> int:
    """Find the walls within reach of grain i, and those whose old contact with i carries a correction.

    Returns the next free slot.
    """
    lifetime = s.verlet.lifetime
    path = lifetime * wp.length(at(s.verlet.reference_velocity, i))
    own = at(s.verlet.skin, i) + s.verlet.frame_skin + path
    x, radius = at(s.grains.position, i), at(s.grains.radius, i)
    now = time_after(s, s.steps)
    old_start, old = s.neighbors.old_start, s.neighbors.old_neighbor
    k_old, end_old = pair_end(old_start, old, i), at(old_start, i + 1)
    skipping = not (are_mobile(s.walls) or is_periodic(s.walls) or k_old < end_old)
    b, slot = int(0), int(free)
    while b < wall_body_count(s.walls):
        j = grain_count(s) + b
        its = wall_path(b, s.walls, now, now + lifetime)
        if is_driven(s):
            leader = leader_of(s, j)
            its_path = lifetime * wp.length(at(s.verlet.reference_velocity, leader))
            its = its + its_path + at(s.verlet.skin, leader)
        reach = (own + its) * TOO_WIDE
        listed = is_near_wall(b, x, radius, s.walls, reach)
        while k_old < end_old and at(old, k_old) < j:
            k_old += 1
        if k_old < end_old and at(old, k_old) == j and is_active(at(s.contacts.dv.saved, k_old)):
            listed = True
        if listed:
            slot = note_contact(s, slot, i, j)
        b += 1
        if skipping:
            b = 1 + next_near(s.walls.shape, b - 1, x, radius + joint_reach(s.walls, radius) + own * TOO_WIDE)
    return slot


@wp.func
def find_contacts(team: Team, s: Scene):
    """Find the contacts of this thread's grains; mark the free slots of its last block as empty."""
    begin, end = thread_range(team, 0, grain_count(s))
    k, slot = int(begin), int(0)
    while k < end:
        slot = find_pairs(s, slot, k)
        slot = find_walls(s, slot, k)
        k += 1
    if not is_on_gpu(team):
        free = int(slot)
        while slot % TAKEN != 0:
            if slot < s.neighbors.found.shape[0]:
                put(s.neighbors.found, slot, NO_CONTACT)
            slot += 1
        put(s.neighbors.empty, team.rank, slot - free)


@wp.func
def check_capacity(s: Scene):
    """Count the contacts found; choose the phase START, or LIST_FULL if the list has no capacity for them."""
    contacts = at(s.neighbors.slots, 0)
    for rank in range(s.neighbors.empty.shape[0]):
        contacts -= at(s.neighbors.empty, rank)
    contacts = wp.where(is_too_long(s), MOST_CONTACTS + 1, contacts)
    put(s.neighbors.total, 0, contacts)
    if contacts <= s.neighbors.neighbor.shape[0]:
        s.control.phase = Phase.START
        s.control.unordered = 1
    else:
        s.control.phase = Phase.LIST_FULL
        s.control.unordered = 0
        s.step.outcome = Outcome.WAITING
