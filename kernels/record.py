"""A whole scene as one record, so that one kernel can advance many of them, and what it adds up of each."""

import warp as wp

from .data import Contacts, Grains, Progress, Watch
from .detect import Grid, Rows
from .iteration import Stop
from .momentum import Momentum

f64 = wp.float64


@wp.struct
class Workspace:
    """What building a list of candidates takes beside the list itself."""

    old_rows: Rows  # pairs of the list before
    old_pair_dv: wp.array(dtype=f64)  # their corrections [m/s]
    wall_dv: wp.array(dtype=f64)  # corrections at the walls, by grain [m/s]
    slot: wp.array(dtype=wp.int32)  # place of every pair in sweeping order
    group: wp.array(dtype=wp.int32)  # that it is swept with
    influence: wp.array(dtype=f64)  # by grain
    next_level: wp.array(dtype=wp.int32)  # by grain
    used_colors: wp.array(dtype=wp.uint64)  # by grain
    lost: wp.array(dtype=wp.int32)  # whether a pair that carries a correction was lost


@wp.struct
class SceneRecord:
    """One scene: its state, its list of contacts, and its parameters."""

    grains: Grains
    contacts: Contacts
    watch: Watch
    progress: Progress
    momentum: Momentum
    grid: Grid
    rows: Rows
    workspace: Workspace
    flag: wp.array(dtype=wp.int32)  # LISTING, REBUILDS, REDOS
    tally: wp.array(dtype=f64)  # STEPS, ITERATIONS_SUM, ... of `kernels.tally`
    stop: Stop
    gravity: wp.vec2d  # [m/s2]
    drag: f64  # [kg/s]
    dt: f64  # [s]
    radius_in: f64  # [m]
    radius_out: f64  # [m]
    smallest: f64  # radius of a grain [m]
    room: f64  # that a list's horizon leaves to the grains [m]
    acceleration: f64  # |gravity| [m/s2]
    rounding: f64  # of a position [m]
    reserve: f64  # of a slack, that must be left before the iteration starts
    by_color: wp.int32  # whether contacts are swept by colors, or by levels
    window: wp.int32  # pairs that are put in levels together
    merge: wp.int32  # whether all groups are swept as one


LISTING, REBUILDS, REDOS = (wp.constant(k) for k in range(3))
