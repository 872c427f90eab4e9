"""Random sequential addition: discs are placed at random, one after the other, without overlap.

Discs come in order of size, the largest first. Those of a level are less than a factor of two apart and share
a grid, whose cells are no narrower than the largest of them. So a disc is checked against nine cells of its
level and of every level before.
"""

import warp as wp

from .walls import Walls, worst_overlap

f64 = wp.float64
NOBODY = wp.constant(-1)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Box:
    """A box in which the discs are placed, in addition to the walls [m]."""

    low: wp.vec2d
    high: wp.vec2d


@wp.struct
class DiscsRecord:
    """Discs in the order in which they are placed, and the cells in which their centres are."""

    radius: wp.array(dtype=f64)  # [m]
    level: wp.array(dtype=wp.int32)
    position: wp.array(dtype=wp.vec2d)  # [m], of those that have a place
    follower: wp.array(dtype=wp.int32)  # the next disc in the same cell
    newest: wp.array(dtype=wp.int32)  # by cell
    cell: wp.array(dtype=f64)  # width of the cells of a level [m]
    width: wp.array(dtype=wp.int32)  # cells a side
    first: wp.array(dtype=wp.int32)  # cell of a level
    walls: Walls
    box: Box
    places: wp.array(dtype=wp.vec2d)  # that are to be tried [m]
    placed: wp.int32  # discs that have a place
    tries: wp.int32  # in a row, of the next one


Discs = wp.ref[DiscsRecord]


@wp.func
def cell_index(x: f64, discs: Discs, level: int) -> int:
    """Return the column, or row, of cells that a coordinate is in."""
    place = int((x + discs.walls.annulus.radius_out) / discs.cell[level])
    return wp.clamp(place, 0, discs.width[level] - 1)


@wp.func
def is_clear_of_cell(x: wp.vec2d, radius: f64, discs: Discs, cell: int) -> bool:
    """Return whether a disc at x overlaps no disc of a cell."""
    clear = bool(True)
    j = discs.newest[cell]
    while clear and j != NOBODY:
        d = discs.position[j] - x
        reach = radius + discs.radius[j]
        clear = d[0] * d[0] + d[1] * d[1] >= reach * reach
        j = discs.follower[j]
    return clear


@wp.func
def is_clear(x: wp.vec2d, radius: f64, discs: Discs, level: int) -> bool:
    """Return whether a disc at x overlaps no disc of a level of the grid; its own cell is checked first."""
    width = discs.width[level]
    column, row = cell_index(x[0], discs, level), cell_index(x[1], discs, level)
    own = discs.first[level] + column * width + row
    clear = is_clear_of_cell(x, radius, discs, own)
    for c in range(wp.max(-column, -1), wp.min(width - column, 2)):
        for r in range(wp.max(-row, -1), wp.min(width - row, 2)):
            if clear:
                clear = is_clear_of_cell(x, radius, discs, own + c * width + r)
    return clear


@wp.func
def fits(x: wp.vec2d, discs: Discs, i: int) -> bool:
    """Return whether disc i at x is within walls and box, and overlaps no earlier disc."""
    r, box = discs.radius[i], discs.box
    if wp.min(x - box.low) < r or wp.min(box.high - x) < r:
        return False
    if worst_overlap(x, discs.radius[i], discs.walls) > f64(0.0):
        return False
    clear = bool(True)
    for level in range(discs.level[i] + 1):
        clear = clear and is_clear(x, discs.radius[i], discs, level)
    return clear


@wp.func
def try_places(discs: Discs):
    """Try the places in order until all discs are placed."""
    for k in range(discs.places.shape[0]):
        i, x = discs.placed, discs.places[k]
        if i == discs.radius.shape[0]:
            return
        discs.tries = discs.tries + 1
        if fits(x, discs, i):
            level = discs.level[i]
            column, row = cell_index(x[0], discs, level), cell_index(x[1], discs, level)
            cell = discs.first[level] + column * discs.width[level] + row
            discs.position[i] = x
            discs.follower[i] = discs.newest[cell]
            discs.newest[cell] = i
            discs.placed = i + 1
            discs.tries = 0


@wp.kernel
def place(records: wp.array(dtype=DiscsRecord)):
    """Try the places of each record."""
    try_places(records[wp.tid()])
