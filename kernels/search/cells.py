"""Grains sorted by the cells of a grid, with copies, in this order, of what the search reads of each grain.

Cells (cx, cy), (cx + width, cy) and (cx, cy + width) share a bucket, so that the grid has no bounds.
"""

import warp as wp

from ..access import add, at, put
from ..record import Scene
from ..types import Ints

f64 = wp.float64
AT_ONCE = wp.constant(8)  # indices tested together; a search may read 8 indices beyond the last grain


@wp.func
def cell_of(x: f64, inverse_size: f64) -> int:
    """Return the cell index of a coordinate [m], clamped to +-1e9 so that no index overflows."""
    return int(wp.clamp(wp.floor(x * inverse_size), f64(-1.0e9), f64(1.0e9)))


@wp.func
def bucket_of(cx: int, cy: int, width: int) -> int:
    """Return the index of the bucket of cell (cx, cy), with `width` buckets along a side, a power of two."""
    return (cx & (width - 1)) + width * (cy & (width - 1))


@wp.func
def prefix_sum(count: Ints, end: Ints):
    """Write the inclusive prefix sum: end[k] = count[0] + ... + count[k]."""
    total = int(0)
    k = int(0)
    while k < count.shape[0]:
        total += at(count, k)
        put(end, k, total)
        k += 1


@wp.func
def wrapped(s: Scene, x: wp.vec2d) -> wp.vec2d:
    """Return the periodic image of x whose coordinates are between 0 and the period [m]."""
    period, place = s.walls.period, x
    if period == wp.vec2d():
        return x
    for k in range(2):
        if period[k] > f64(0.0):
            place[k] = x[k] - period[k] * wp.floor(x[k] / period[k])
    return place


@wp.func
def bucket_count(s: Scene) -> int:
    """Return the length of `cell_start`: the number of buckets plus 1."""
    return s.grid.cell_start.shape[0]


@wp.func
def clear_cell(s: Scene, b: int):
    """Set the count of grains in bucket b, cell_start[b], to 0."""
    put(s.grid.cell_start, b, 0)


@wp.func
def count_in_cell(s: Scene, i: int):
    """Write the bucket of grain i to `bucket`, and add 1 to the count of this bucket in `cell_start`."""
    x, inverse_size = wrapped(s, at(s.grains.position, i)), s.grid.inverse_size
    bucket = bucket_of(cell_of(x[0], inverse_size), cell_of(x[1], inverse_size), s.grid.width)
    put(s.grid.bucket, i, bucket)
    add(s.grid.cell_start, bucket, 1)


@wp.func
def end_cells(s: Scene):
    """Replace the counts in `cell_start` by the ends of the buckets; reset the number of contact slots."""
    prefix_sum(s.grid.cell_start, s.grid.cell_start)
    put(s.neighbors.slots, 0, 0)


@wp.func
def fill_cell(s: Scene, i: int):
    """Copy grain i to the next free index of its bucket.

    A bucket is filled from its end: its `cell_start` counts down from the end to the start.
    """
    k = add(s.grid.cell_start, at(s.grid.bucket, i), -1) - 1
    x = wrapped(s, at(s.grains.position, i))
    w = at(s.verlet.reference_velocity, i) - s.verlet.mean_velocity
    skin = at(s.grains.radius, i) + at(s.verlet.skin, i)
    put(s.grid.grain, k, i)
    put(s.grid.x, k, x[0])
    put(s.grid.y, k, x[1])
    put(s.grid.velocity, k, w)
    put(s.grid.skin, k, skin)
    put(s.grid.extent, k, skin + s.verlet.lifetime * wp.length(w))
