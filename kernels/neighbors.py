"""Candidate contacts: every pair i < j within reach (verlet.py), in lexicographic order, and the walls.

Grains are sorted into the cells of a grid that is wrapped around (cell (cx, cy) shares its bucket with
(cx + width, cy)), so that it needs no bounds. Of two grains the one of larger extent finds
the pair, so that few large grains among many small ones cost no more than the cells that they cover.
"""

import warp as wp

from .access import (
    couple_at,
    integer_at,
    number_at,
    set_couple,
    set_integer,
    set_number,
    set_vector,
    vector_at,
)
from .record import Scene, amid_sweeps, grain_count, is_accelerated
from .types import Floats, Ints
from .verlet import stayed_off_walls
from .walls import WallContact, is_near_wall

f64 = wp.float64
TOO_WIDE = wp.constant(f64(1.0 + 1.0e-12))  # so that rounding leaves no contact out


@wp.func
def cell_of(x: f64, size: f64) -> int:
    """The cell of a coordinate. Far out, cells grow coarse instead of overflowing."""
    return int(wp.clamp(wp.floor(x / size), f64(-1.0e9), f64(1.0e9)))


@wp.func
def bucket_of(cx: int, cy: int, width: int) -> int:
    """The bucket of a cell in the wrapped grid."""
    return (cx & (width - 1)) + width * (cy & (width - 1))


@wp.func
def bucket_at(s: Scene, x: wp.vec2d) -> int:
    """The bucket of a place."""
    return bucket_of(cell_of(x[0], s.grid.size), cell_of(x[1], s.grid.size), s.grid.width)


@wp.func
def ends(count: Ints, end: Ints):
    """Where each part ends, of parts of so many entries."""
    total = int(0)
    for k in range(count.shape[0]):
        total = total + integer_at(count, k)
        set_integer(end, k, total)


@wp.func
def bucket_count(s: Scene) -> int:
    """How many buckets there are, and one."""
    return s.grid.cell_start.shape[0]


@wp.func
def clear_cell(s: Scene, b: int):
    """Empty a bucket."""
    set_integer(s.grid.cell_start, b, 0)


@wp.func
def count_in_cell(s: Scene, i: int):
    """How many grains every bucket holds, in cell_start; no pair is found yet."""
    bucket = bucket_at(s, vector_at(s.grains.position, i))
    set_integer(s.grid.bucket, i, bucket)
    wp.atomic_add(s.grid.cell_start, bucket, 1)
    set_integer(s.neighbors.firsts, i, 0)
    set_integer(s.neighbors.seconds, i, 0)


@wp.func
def end_cells(s: Scene):
    """Where every bucket ends."""
    ends(s.grid.cell_start, s.grid.cell_start)
    s.neighbors.total[0] = 0


@wp.func
def fill_cell(s: Scene, i: int):
    """Put a grain in its bucket, with its extent; cell_start counts down to where the bucket starts."""
    k = wp.atomic_sub(s.grid.cell_start, integer_at(s.grid.bucket, i), 1) - 1
    x = vector_at(s.grains.position, i)
    w = vector_at(s.verlet.reference_velocity, i) - s.verlet.numbers.mean_velocity
    skin = number_at(s.grains.radius, i) + number_at(s.verlet.skin, i)
    set_integer(s.grid.grain, k, i)
    set_number(s.grid.x, k, x[0])
    set_number(s.grid.y, k, x[1])
    set_vector(s.grid.velocity, k, w)
    set_number(s.grid.skin, k, skin)
    set_number(s.grid.extent, k, skin + s.verlet.numbers.lifetime * wp.length(w))


@wp.func
def note_pair(s: Scene, a: int, b: int):
    """Count a pair with its first grain, and with its second, and write it down if there is room."""
    i, j = wp.min(a, b), wp.max(a, b)
    wp.atomic_add(s.neighbors.firsts, i, 1)
    wp.atomic_add(s.neighbors.seconds, j, 1)
    place = wp.atomic_add(s.neighbors.total, 0, 1)
    if place < s.neighbors.found.shape[0]:
        set_couple(s.neighbors.found, place, wp.vec2i(i, j))


NEAR = """
    const double own = extent.data[k], x0 = x.data[k], y0 = y.data[k];
    unsigned near = 0;
#if defined(__CUDA_ARCH__)
    for (int lane = 0; lane < 8; lane++) {
        const int other = begin + lane;
        const double its = extent.data[other], dx = x.data[other] - x0, dy = y.data[other] - y0;
        const double reach = (own + its) * wide;
        near |= (dx * dx + dy * dy <= reach * reach && (its < own || (its == own && other > k))) << lane;
    }
#else
    typedef double Eight __attribute__((ext_vector_type(8), aligned(8)));
    typedef bool Bits __attribute__((ext_vector_type(8)));
    const Eight its = *(const Eight*)(extent.data + begin);
    const Eight dx = *(const Eight*)(x.data + begin) - x0, dy = *(const Eight*)(y.data + begin) - y0;
    const Eight reach = (own + its) * wide;
    const auto within = (dx * dx + dy * dy <= reach * reach) & (its <= own);
    near = __builtin_bit_cast(unsigned char, __builtin_convertvector(within, Bits));
#endif
    return end - begin < 8 ? near & ((1u << (end - begin)) - 1u) : near;
"""


@wp.func_native(NEAR)
def near_mask(x: Floats, y: Floats, extent: Floats, k: int, begin: int, end: int, wide: f64) -> wp.uint32:
    """Which of eight places from begin on are before end, and hold a grain that the one at k may find."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __ffs(bits) - 1;
#else
    return __builtin_ctz(bits);
#endif
""")
def lowest_bit(bits: wp.uint32) -> int:
    """The lowest bit that is set."""
    ...


@wp.func
def find_pairs_among(s: Scene, k: int, begin: int, end: int):
    """Find the pairs of the grain at place k with those at begin <= other < end.

    Of two grains the one of larger extent finds the pair, or, of equals, the one that comes first.
    """
    x, y, extent, velocity, skin = s.grid.x, s.grid.y, s.grid.extent, s.grid.velocity, s.grid.skin
    first = begin
    while first < end:
        near = near_mask(x, y, extent, k, first, end, TOO_WIDE)
        while near != wp.uint32(0):
            other = first + lowest_bit(near)
            near = near & (near - wp.uint32(1))
            if number_at(extent, other) < number_at(extent, k) or other > k:
                w = vector_at(velocity, other) - vector_at(velocity, k)
                path = s.verlet.numbers.lifetime * wp.length(w)
                reach = (number_at(skin, k) + number_at(skin, other) + path) * TOO_WIDE
                d = wp.vec2d(number_at(x, other) - number_at(x, k), number_at(y, other) - number_at(y, k))
                if wp.dot(d, d) <= reach * reach:
                    note_pair(s, integer_at(s.grid.grain, k), integer_at(s.grid.grain, other))
        first += 8


@wp.func
def find_pairs(s: Scene, k: int):
    """Find the pairs of the grain at place k in the cells around it, or among all where that is less."""
    x, y = number_at(s.grid.x, k), number_at(s.grid.y, k)
    radius = f64(2.0) * number_at(s.grid.extent, k) * TOO_WIDE
    width = s.grid.width
    first_x, last_x = cell_of(x - radius, s.grid.size), cell_of(x + radius, s.grid.size)
    first_y, last_y = cell_of(y - radius, s.grid.size), cell_of(y + radius, s.grid.size)
    if last_x - first_x >= width or last_y - first_y >= width:
        find_pairs_among(s, k, 0, grain_count(s))
        return
    start = s.grid.cell_start
    for cy in range(first_y, last_y + 1):
        first = bucket_of(first_x, cy, width)
        last = bucket_of(last_x, cy, width)
        if first <= last:
            find_pairs_among(s, k, integer_at(start, first), integer_at(start, last + 1))
        else:  # the row of cells is wrapped around
            row = bucket_of(0, cy, width)
            find_pairs_among(s, k, integer_at(start, row), integer_at(start, last + 1))
            find_pairs_among(s, k, integer_at(start, first), integer_at(start, row + width))


@wp.func
def see_whether_roomy(s: Scene):
    """Whether the pairs found have room."""
    s.control.searching = 0
    s.control.roomy = 1 if s.neighbors.total[0] <= s.neighbors.found.shape[0] else 0


@wp.func
def fill_rows(s: Scene):
    """Put the pairs found in rows, ascending: sorted by second grain, and then by first.

    Where a part ends is counted down to where it starts.
    """
    found, by_second, start, second = (
        s.neighbors.found,
        s.neighbors.by_second,
        s.neighbors.start,
        s.neighbors.seconds,
    )
    ends(s.neighbors.firsts, start)
    ends(second, second)
    pairs = s.neighbors.total[0]
    for k in range(pairs):
        pair = couple_at(found, k)
        place = integer_at(second, pair[1]) - 1
        set_integer(second, pair[1], place)
        set_couple(by_second, place, pair)
    for k in range(pairs):
        pair = couple_at(by_second, pairs - 1 - k)
        place = integer_at(start, pair[0]) - 1
        set_integer(start, pair[0], place)
        set_integer(s.neighbors.neighbor, place, pair[1])


@wp.func
def is_active(dv: wp.vec3d) -> bool:
    """Whether a contact carries a correction, or did at the step's start or a sweep back."""
    return dv[0] != f64(0.0) or dv[1] != f64(0.0) or dv[2] != f64(0.0)


@wp.func
def list_walls(s: Scene):
    """List the grains that may reach a wall, or are held by one, with the corrections that they carry."""
    listed = int(0)
    for i in range(grain_count(s)):
        path = s.verlet.numbers.lifetime * wp.length(s.verlet.reference_velocity[i])
        reach = (s.verlet.skin[i] + s.verlet.numbers.frame_skin + path) * TOO_WIDE
        dv = s.workspace.old_wall_dv[i]
        if is_near_wall(s.grains.position[i], s.grains.radius[i], s.walls, reach) or is_active(dv):
            contact = WallContact()
            contact.i = i
            contact.dv = dv[0]
            s.contacts.walls[listed] = contact
            s.contacts.wall_dv_start[listed] = dv[1]
            if is_accelerated(s):
                s.momentum.wall_last[listed] = dv[2]
            listed = listed + 1
            if amid_sweeps(s) and s.workspace.was_at_wall[i] == 0 and not stayed_off_walls(s, i):
                s.verlet.flags.missed = 1
    s.contacts.count.walls = listed
