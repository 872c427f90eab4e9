"""Candidate contacts: every pair i < j within reach (watch.py), in lexicographic order, and the walls.

Grains are sorted into the cells of a grid that is wrapped around (cell (cx, cy) shares its bucket with
(cx + width, cy)), so that it needs no bounds. Of two grains the one of larger extent finds
the pair, so that few large grains among many small ones cost no more than the cells that they cover.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from . import law
from .data import FRAME_REACH, HORIZON, MEAN_VELOCITY, WALLS, Contacts, Grains, Wall, Watch
from .features import functions
from .stage import kernels_of
from .variant import Variant

f64 = wp.float64
TOO_WIDE = wp.constant(
    f64(1.0 + 1.0e-12)
)  # bounds are a hair too wide, so that rounding leaves no contact out


@wp.struct
class Grid:
    """Grains by cell: those of bucket b are cell_grain[cell_start[b]:cell_start[b + 1]]."""

    size: f64  # of a cell [m]
    width: wp.int32  # buckets a side, a power of two
    cell_start: wp.array(dtype=wp.int32)
    cell_cursor: wp.array(dtype=wp.int32)
    cell_grain: wp.array(dtype=wp.int32)
    extent: wp.array(
        dtype=f64
    )  # of every grain: its part of the distance at which pairs are within reach [m]


@wp.struct
class Rows:
    """Candidate pairs by first grain: those of i are (i, neighbor[k]), start[i] <= k < start[i + 1]."""

    start: wp.array(dtype=wp.int32)
    cursor: wp.array(dtype=wp.int32)
    neighbor: wp.array(dtype=wp.int32)
    found: wp.array(dtype=wp.vec2i)  # pairs as they were found; those beyond its end are only counted
    total: wp.array(dtype=wp.int32)


@wp.func
def cell_of(x: f64, size: f64) -> int:
    """The cell of a coordinate. Far out, cells grow coarse instead of overflowing."""
    return int(wp.clamp(wp.floor(x / size), f64(-1.0e9), f64(1.0e9)))


@wp.func
def bucket_of(cx: int, cy: int, width: int) -> int:
    """The bucket of a cell in the wrapped grid."""
    return (cx & (width - 1)) + width * (cy & (width - 1))


@cache
def stages(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the stages for one kind of scene."""
    radius_of = functions(variant).radius_of

    @wp.func
    def find_extent(i: int, grains: Grains, watch: Watch, grid: Grid):
        """The part of a distance that is grain i's where pairs are within reach."""
        w = watch.built_velocity[i] - watch.frame[MEAN_VELOCITY]
        grid.extent[i] = radius_of(grains, i) + watch.reach[i] + watch.scalar[HORIZON] * wp.length(w)

    @wp.func
    def count_cells(i: int, grains: Grains, watch: Watch, grid: Grid):
        """The extent of every grain, and how many grains every bucket holds, in cell_cursor."""
        find_extent(i, grains, watch, grid)
        x = grains.position[i]
        wp.atomic_add(
            grid.cell_cursor, bucket_of(cell_of(x[0], grid.size), cell_of(x[1], grid.size), grid.width), 1
        )

    @wp.func
    def fill_cells(i: int, grains: Grains, grid: Grid):
        """Put every grain in its bucket; cell_cursor counts down to zero."""
        x = grains.position[i]
        b = bucket_of(cell_of(x[0], grid.size), cell_of(x[1], grid.size), grid.width)
        place = wp.atomic_sub(grid.cell_cursor, b, 1) - 1
        grid.cell_grain[grid.cell_start[b] + place] = i

    @wp.func
    def is_within_reach(grains: Grains, watch: Watch, grid: Grid, a: int, b: int) -> bool:
        """The criterion of watch.py, and before it that of the extents, which is quicker and wider."""
        distance = wp.length(grains.position[b] - grains.position[a])
        if distance > (grid.extent[a] + grid.extent[b]) * TOO_WIDE:
            return False
        w = watch.built_velocity[b] - watch.built_velocity[a]
        reach = watch.reach[a] + watch.reach[b] + watch.scalar[HORIZON] * wp.length(w)
        return distance <= (radius_of(grains, a) + radius_of(grains, b) + reach) * TOO_WIDE

    @wp.func
    def try_pair(grains: Grains, watch: Watch, grid: Grid, rows: Rows, a: int, b: int):
        """Take a pair within reach, if a is the one to find it: the larger, or, of equals, the first.

        It is counted in the row of its first grain, and written down if there is room.
        """
        extent_a = grid.extent[a]
        extent_b = grid.extent[b]
        if extent_b > extent_a or (extent_b == extent_a and b <= a):
            return
        if is_within_reach(grains, watch, grid, a, b):
            wp.atomic_add(rows.cursor, wp.min(a, b), 1)
            place = wp.atomic_add(rows.total, 0, 1)
            if place < rows.found.shape[0]:
                rows.found[place] = wp.vec2i(wp.min(a, b), wp.max(a, b))

    @wp.func
    def try_all(grains: Grains, watch: Watch, grid: Grid, rows: Rows):
        """Look at all pairs of a few grains, and put them in their rows as far as there is room."""
        n = grains.position.shape[0]
        for i in range(n):
            find_extent(i, grains, watch, grid)
        total = int(0)
        for i in range(n):
            rows.start[i] = total
            for j in range(i + 1, n):
                if is_within_reach(grains, watch, grid, i, j):
                    if total < rows.neighbor.shape[0]:
                        rows.neighbor[total] = j
                    total = total + 1
        rows.start[n] = total
        rows.total[0] = total

    @wp.func
    def find_pairs(a: int, grains: Grains, watch: Watch, grid: Grid, rows: Rows):
        """Find a grain's pairs in the cells around it, or among all grains where that is less to look at."""
        x = grains.position[a]
        radius = f64(2.0) * grid.extent[a] * TOO_WIDE
        first_x, last_x = cell_of(x[0] - radius, grid.size), cell_of(x[0] + radius, grid.size)
        first_y, last_y = cell_of(x[1] - radius, grid.size), cell_of(x[1] + radius, grid.size)
        if last_x - first_x >= grid.width or last_y - first_y >= grid.width:
            for b in range(grains.position.shape[0]):
                try_pair(grains, watch, grid, rows, a, b)
        else:
            for cy in range(first_y, last_y + 1):
                for cx in range(first_x, last_x + 1):
                    bucket = bucket_of(cx, cy, grid.width)
                    for k in range(grid.cell_start[bucket], grid.cell_start[bucket + 1]):
                        try_pair(grains, watch, grid, rows, a, grid.cell_grain[k])

    @wp.func
    def fill_rows(k: int, rows: Rows):
        """Put every pair in its row; rows.cursor counts down to zero."""
        if k < rows.total[0]:
            pair = rows.found[k]
            place = wp.atomic_sub(rows.cursor, pair[0], 1) - 1
            rows.neighbor[rows.start[pair[0]] + place] = pair[1]

    @wp.func
    def sort_rows(i: int, rows: Rows):
        """Sort every row (shell sort: rows are short, but a large grain may touch thousands)."""
        first = rows.start[i]
        count = rows.start[i + 1] - first
        step = int(1)
        while 3 * step + 1 < count:
            step = 3 * step + 1
        while step > 0:
            for k in range(first + step, first + count):
                j = rows.neighbor[k]
                hole = int(k)
                while hole - step >= first and rows.neighbor[hole - step] > j:
                    rows.neighbor[hole] = rows.neighbor[hole - step]
                    hole = hole - step
                rows.neighbor[hole] = j
            step = step // 3

    @wp.func
    def save_walls(c: int, contacts: Contacts, wall_dv: wp.array(dtype=f64)):
        """Wall corrections at the start of the step, by grain (zero elsewhere)."""
        if c < contacts.count[WALLS]:
            wall_dv[contacts.walls[c].i] = contacts.wall_dv_start[c]

    @wp.func
    def reaches_wall(
        grains: Grains, watch: Watch, i: int, radius_in: f64, radius_out: f64, wall_dv: wp.array(dtype=f64)
    ) -> bool:
        """Whether grain i may meet a wall, or is held by one."""
        distance = wp.length(grains.position[i])
        path = watch.scalar[HORIZON] * wp.length(watch.built_velocity[i])
        reach = (watch.reach[i] + watch.scalar[FRAME_REACH] + path) * TOO_WIDE
        near = law.outer_gap(distance, radius_of(grains, i), radius_out) <= reach
        if wp.static(variant.inner_wall):
            near = near or law.inner_gap(distance, radius_of(grains, i), radius_in) <= reach
        return near or wall_dv[i] != f64(0.0)

    @wp.func
    def find_walls(
        i: int,
        grains: Grains,
        contacts: Contacts,
        watch: Watch,
        radius_in: f64,
        radius_out: f64,
        wall_dv: wp.array(dtype=f64),
    ):
        """The grains that may reach a wall, with the corrections that they carry."""
        if reaches_wall(grains, watch, i, radius_in, radius_out, wall_dv):
            c = wp.atomic_add(contacts.count, WALLS, 1)
            wall = Wall()
            wall.i = i
            wall.dv = wall_dv[i]
            contacts.walls[c] = wall
            contacts.wall_dv_start[c] = wall_dv[i]

    return SimpleNamespace(
        count_cells=count_cells,
        fill_cells=fill_cells,
        find_pairs=find_pairs,
        fill_rows=fill_rows,
        sort_rows=sort_rows,
        try_all=try_all,
        save_walls=save_walls,
        find_walls=find_walls,
    )


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Kernels of the stages that are launched."""
    own = stages(variant)
    return kernels_of(
        variant.module,
        own.count_cells,
        own.fill_cells,
        own.find_pairs,
        own.fill_rows,
        own.sort_rows,
        own.save_walls,
        own.find_walls,
    )
