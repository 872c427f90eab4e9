"""Random sequential addition: discs are placed at random, one after the other, without overlap.

Discs are sorted by size, the largest first, and divided into levels. The radii of a level differ by less than
a factor of two. Each level has a grid, whose cells are at least as wide as the largest disc of the level. So
a disc is checked against nine cells of its level and of every level of larger discs. In periodic directions,
the first cells are neighbors of the last cells.
"""

import warp as wp

from ..walls.contact import worst_overlap
from ..walls.walls import Walls, way

f64 = wp.float64
NOBODY = wp.constant(-1)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Bounds:
    """Bounds on the coordinates of discs, in addition to the walls [m]; infinite in periodic directions."""

    low: wp.vec2d
    high: wp.vec2d


@wp.struct
class DiscsRecord:
    """Discs in the order in which they are placed, and linked lists of the discs in each cell."""

    radius: wp.array(dtype=f64)  # [m]
    level: wp.array(dtype=wp.int32)
    position: wp.array(dtype=wp.vec2d)  # of the discs placed so far [m]
    follower: wp.array(dtype=wp.int32)  # by disc: the disc placed before in the same cell, or NOBODY
    newest: wp.array(dtype=wp.int32)  # by cell: the disc placed last, or NOBODY
    cell: wp.array(dtype=wp.vec2d)  # by level: width and height of the cells [m]
    width: wp.array(dtype=wp.vec2i)  # by level: number of columns and rows
    first: wp.array(dtype=wp.int32)  # by level: index of the first cell
    corner: wp.vec2d  # lower left corner of the grids [m]
    walls: Walls
    bounds: Bounds
    places: wp.array(dtype=wp.vec2d)  # positions to try [m]
    placed: wp.int32  # number of discs placed so far
    tries: wp.int32  # number of positions tried for the next disc


Discs = wp.ref[DiscsRecord]


@wp.func
def cell_of(x: wp.vec2d, discs: Discs, level: int) -> wp.vec2i:
    """Return (column, row) of the cell of a level that contains point x, or of the nearest cell."""
    cell, most = discs.cell[level], discs.width[level] - wp.vec2i(1, 1)
    column, row = int((x[0] - discs.corner[0]) / cell[0]), int((x[1] - discs.corner[1]) / cell[1])
    return wp.vec2i(wp.clamp(column, 0, most[0]), wp.clamp(row, 0, most[1]))


@wp.func
def beside(place: int, step: int, width: int, period: f64) -> int:
    """Return the index place + step of a column or row, or NOBODY if it is outside [0, width).

    If the period is > 0, the first index follows the last one instead.
    """
    other = place + step
    if period > f64(0.0):
        return (other + width) % width
    return wp.where(other >= 0 and other < width, other, NOBODY)


@wp.func
def is_clear_of_cell(x: wp.vec2d, radius: f64, discs: Discs, cell: int) -> bool:
    """Return whether a disc of this radius at x overlaps no disc of a cell."""
    clear = bool(True)
    j = discs.newest[cell]
    while clear and j != NOBODY:
        d = way(x, discs.position[j], discs.walls)
        reach = radius + discs.radius[j]
        clear = d[0] * d[0] + d[1] * d[1] >= reach * reach
        j = discs.follower[j]
    return clear


@wp.func
def is_clear(x: wp.vec2d, radius: f64, discs: Discs, level: int) -> bool:
    """Return whether a disc of this radius at x overlaps no disc of a level.

    The cell that contains x is checked first.
    """
    width, own, first, period = (
        discs.width[level],
        cell_of(x, discs, level),
        discs.first[level],
        discs.walls.period,
    )
    clear = is_clear_of_cell(x, radius, discs, first + own[0] * width[1] + own[1])
    for c in range(-1, 2):
        column = beside(own[0], c, width[0], period[0])
        for r in range(-1, 2):
            row = beside(own[1], r, width[1], period[1])
            if clear and column != NOBODY and row != NOBODY:
                clear = is_clear_of_cell(x, radius, discs, first + column * width[1] + row)
    return clear


@wp.func
def fits(x: wp.vec2d, discs: Discs, i: int) -> bool:
    """Return whether disc i at x is within walls and bounds, and overlaps no earlier disc."""
    r, bounds = discs.radius[i], discs.bounds
    if wp.min(x - bounds.low) < r or wp.min(bounds.high - x) < r:
        return False
    if worst_overlap(x, discs.radius[i], discs.walls) > f64(0.0):
        return False
    clear = bool(True)
    for level in range(discs.level[i] + 1):
        clear = clear and is_clear(x, discs.radius[i], discs, level)
    return clear


@wp.func
def try_places(discs: Discs):
    """Try the positions `places` in order, each for the first disc not yet placed, until all are placed."""
    for k in range(discs.places.shape[0]):
        i, x = discs.placed, discs.places[k]
        if i == discs.radius.shape[0]:
            return
        discs.tries = discs.tries + 1
        if fits(x, discs, i):
            level = discs.level[i]
            own = cell_of(x, discs, level)
            cell = discs.first[level] + own[0] * discs.width[level][1] + own[1]
            discs.position[i] = x
            discs.follower[i] = discs.newest[cell]
            discs.newest[cell] = i
            discs.placed = i + 1
            discs.tries = 0


@wp.kernel
def place(records: wp.array(dtype=DiscsRecord)):
    """Place the discs of each record by `try_places`, one record per thread."""
    try_places(records[wp.tid()])
