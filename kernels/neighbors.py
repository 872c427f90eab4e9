"""Candidate contacts: every pair i < j within reach (verlet.py), in lexicographic order, and the walls.

Grains are sorted into the cells of a grid that is wrapped around (cell (cx, cy) shares its bucket with
(cx + width, cy)), so that it needs no bounds. Of two grains the one of larger extent finds
the pair, so that few large grains among many small ones cost no more than the cells that they cover.
"""

import warp as wp

from .access import integer_at, number_at, set_integer, vector_at
from .record import Scene, amid_sweeps, grain_count, is_accelerated
from .types import Ints, NeighborList
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
def starts(count: Ints, start: Ints):
    """Where each part starts, of parts of so many entries."""
    total = int(0)
    for k in range(count.shape[0]):
        start[k] = total
        total = total + count[k]


@wp.func
def bucket_count(s: Scene) -> int:
    """How many buckets there are, and one."""
    return s.grid.cell_cursor.shape[0]


@wp.func
def clear_cell(s: Scene, b: int):
    """Empty a bucket."""
    s.grid.cell_cursor[b] = 0


@wp.func
def count_in_cell(s: Scene, i: int):
    """How many grains every bucket holds, in cell_cursor."""
    wp.atomic_add(s.grid.cell_cursor, bucket_at(s, s.grains.position[i]), 1)
    s.neighbors.cursor[i] = 0


@wp.func
def start_cells(s: Scene):
    """Where every bucket starts; no pair is found yet."""
    starts(s.grid.cell_cursor, s.grid.cell_start)
    s.neighbors.total[0] = 0


@wp.func
def fill_cell(s: Scene, i: int):
    """Put a grain in its bucket, with its extent; cell_cursor counts down to zero."""
    x = s.grains.position[i]
    b = bucket_at(s, x)
    k = s.grid.cell_start[b] + wp.atomic_sub(s.grid.cell_cursor, b, 1) - 1
    w = s.verlet.reference_velocity[i] - s.verlet.numbers.mean_velocity
    path = s.verlet.numbers.lifetime * wp.length(w)
    s.grid.grain[k] = i
    s.grid.position[k] = x
    s.grid.velocity[k] = w
    s.grid.skin[k] = s.grains.radius[i] + s.verlet.skin[i]
    s.grid.extent[k] = s.grid.skin[k] + path


@wp.func
def note_pair(s: Scene, a: int, b: int):
    """Count a pair in the row of its first grain, and write it down if there is room."""
    wp.atomic_add(s.neighbors.cursor, wp.min(a, b), 1)
    place = wp.atomic_add(s.neighbors.total, 0, 1)
    if place < s.neighbors.found.shape[0]:
        s.neighbors.found[place] = wp.vec2i(wp.min(a, b), wp.max(a, b))


@wp.func
def find_pairs_among(s: Scene, k: int, begin: int, end: int):
    """Find the pairs of the grain at place k with those at begin <= other < end.

    Of two grains the one of larger extent finds the pair, or, of equals, the one that comes first.
    """
    position, extent = s.grid.position, s.grid.extent
    velocity, skin, grain = s.grid.velocity, s.grid.skin, s.grid.grain
    lifetime = s.verlet.numbers.lifetime
    x = vector_at(position, k)
    own = number_at(extent, k)
    other = begin
    while other < end:
        d = vector_at(position, other) - x
        its = number_at(extent, other)
        reach = (own + its) * TOO_WIDE
        if wp.dot(d, d) <= reach * reach and (its < own or (its == own and other > k)):
            w = vector_at(velocity, other) - vector_at(velocity, k)
            path = lifetime * wp.length(w)
            reach = (number_at(skin, k) + number_at(skin, other) + path) * TOO_WIDE
            if wp.dot(d, d) <= reach * reach:
                note_pair(s, grain[k], grain[other])
        other += 1


@wp.func
def find_pairs(s: Scene, k: int):
    """Find the pairs of the grain at place k in the cells around it, or among all where that is less."""
    x = s.grid.position[k]
    radius = f64(2.0) * s.grid.extent[k] * TOO_WIDE
    width = s.grid.width
    first_x, last_x = cell_of(x[0] - radius, s.grid.size), cell_of(x[0] + radius, s.grid.size)
    first_y, last_y = cell_of(x[1] - radius, s.grid.size), cell_of(x[1] + radius, s.grid.size)
    if last_x - first_x >= width or last_y - first_y >= width:
        find_pairs_among(s, k, 0, grain_count(s))
        return
    for cy in range(first_y, last_y + 1):
        first = bucket_of(first_x, cy, width)
        last = bucket_of(last_x, cy, width)
        if first <= last:
            find_pairs_among(s, k, s.grid.cell_start[first], s.grid.cell_start[last + 1])
        else:  # the row of cells is wrapped around
            row = bucket_of(0, cy, width)
            find_pairs_among(s, k, s.grid.cell_start[row], s.grid.cell_start[last + 1])
            find_pairs_among(s, k, s.grid.cell_start[first], s.grid.cell_start[row + width])


@wp.func
def see_whether_roomy(s: Scene):
    """Whether the pairs found have room; where they start, if they do."""
    s.control.searching = 0
    s.control.roomy = 1 if s.neighbors.total[0] <= s.neighbors.found.shape[0] else 0
    if s.control.roomy != 0:
        starts(s.neighbors.cursor, s.neighbors.start)


@wp.func
def found_count(s: Scene) -> int:
    """How many pairs were found."""
    return s.neighbors.total[0]


@wp.func
def fill_row(s: Scene, k: int):
    """Put a pair in its row; the cursors count down to zero."""
    pair = s.neighbors.found[k]
    place = wp.atomic_sub(s.neighbors.cursor, pair[0], 1) - 1
    s.neighbors.neighbor[s.neighbors.start[pair[0]] + place] = pair[1]


@wp.func
def sort_row(s: Scene, i: int):
    """Sort a row (shell sort: rows are short, but a large grain may touch thousands)."""
    row = s.neighbors.neighbor
    first = integer_at(s.neighbors.start, i)
    count = integer_at(s.neighbors.start, i + 1) - first
    step = int(1)
    while 3 * step + 1 < count:
        step = 3 * step + 1
    while step > 0:
        for k in range(first + step, first + count):
            j = integer_at(row, k)
            hole = int(k)
            while hole - step >= first and integer_at(row, hole - step) > j:
                set_integer(row, hole, integer_at(row, hole - step))
                hole = hole - step
            set_integer(row, hole, j)
        step = step // 3


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


@wp.func
def place_in_row(neighbors: NeighborList, i: int, j: int, k: int) -> int:
    """The first place at or after k in the row of i that is not before j: rows are ascending."""
    place = int(k)
    end = integer_at(neighbors.start, i + 1)
    while place < end and integer_at(neighbors.neighbor, place) < j:
        place = place + 1
    return place


@wp.func
def is_at(neighbors: NeighborList, i: int, j: int, k: int) -> bool:
    """Whether place k holds pair (i, j)."""
    if k < integer_at(neighbors.start, i + 1):
        return integer_at(neighbors.neighbor, k) == j
    return False
