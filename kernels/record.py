"""A scene as the kernels see it: one record of its arrays, of the numbers of a step, and of parameters.

The numbers change while a kernel runs, as the contents of the arrays do; lengths and parameters do not.
"""

import warp as wp

from .types import (
    CellGrid,
    Contacts,
    Dealt,
    Floats,
    Grains,
    Ints,
    Momentum,
    NeighborList,
    Vectors,
    Verlet,
    WorkingSet,
    Workspace,
)
from .walls import Walls

f64 = wp.float64

SOLVED, WITHOUT_ROOM, NOT_FINITE, NOT_CONVERGED, EXPIRED, UNPROVED, HALTED, BEYOND_WALL, SLOW = (
    wp.constant(k) for k in range(9)
)
"""Outcomes of a step. A SOLVED one is taken, converged or, where the scene allows it, not; so is an UNPROVED
one, which is worth a search for a proof that none solves it. A SLOW one waits for the host (exact.py)."""


@wp.struct
class StepState:
    """What the step has done so far, and what is reported of it."""

    iterations: wp.int32
    zeta: f64  # of the last iteration [m/s]
    residual: f64  # eta [m/s]
    overlap: f64  # worst after the move [m]
    active: wp.int32  # contacts that carry a correction
    rebuilds: wp.int32  # lists built
    redos: wp.int32  # attempts that a missing contact made void
    factorizations: wp.int32  # by the host
    converged: wp.int32  # whether it has met the tolerance
    outcome: wp.int32


@wp.struct
class Control:
    """What is to be done next (conditions.py): a GPU's graph reads it as well."""

    starting: wp.int32
    unsolved: wp.int32
    unlisted: wp.int32
    searching: wp.int32
    roomy: wp.int32
    unordered: wp.int32
    tiled: wp.int32
    attempting: wp.int32
    fresh: wp.int32
    corrected: wp.int32  # whether the host has tried to solve the step
    declined: wp.int32  # whether it could not, so that sweeps alone go on to the step's end
    resuming: wp.int32  # whether the attempt goes on where the last list expired
    unfinished: wp.int32  # whether iterations are left to do
    recoloring: wp.int32
    iterating: wp.int32
    looking: wp.int32
    sampling: wp.int32
    rejected: wp.int32
    measuring: wp.int32
    rebuilding: wp.int32
    accepted: wp.int32
    sweeping: wp.int32
    halted: wp.int32  # whether the host wants the step given up
    set: wp.int32  # that is swept now, where every set is a launch of its own


@wp.struct
class Partial:
    """What every thread has found; the maximum or sum over all threads counts."""

    zeta: Floats
    residual: Floats
    overlap: Floats
    active: Ints
    moments: Vectors  # velocities of a block of pairs, as the corrections make them [m/s]


@wp.struct
class History:
    """What the iterations of the last step have come to; of length 0 where nobody asks."""

    zeta: Floats  # of every iteration [m/s]
    residual: Floats  # after it [m/s]


@wp.struct
class StoppingCriterion:
    """When to stop iterating."""

    on_residual: wp.int32  # whether the tolerance is on the residual, or on zeta
    tolerance: f64  # [m/s]
    max_iterations: wp.int32
    patience: wp.int32  # sweeps that the host's factorizations are worth; 0: it does none
    raise_on_unconverged: wp.int32  # whether a step that has not converged is not taken


@wp.struct
class TimeScheme:
    """Of which moments velocities are."""

    leapfrog: wp.int32  # whether velocities belong to the middle of a step
    staggered: wp.int32  # whether they are half a step behind the positions now
    last_staggered: wp.int32  # and whether they were before the last good step


@wp.struct
class Tuning:
    """Lengths with which lists are made, and limits within which the proof of `verlet.py` holds."""

    smallest_radius: f64  # [m]
    room: f64  # that a list's lifetime leaves to the grains [m]
    acceleration: f64  # |gravity| [m/s2]
    rounding: f64  # of a position [m]
    reserve: f64  # of a base skin, that must be left before the iteration starts
    monitor_threshold: f64  # change of velocity that need not be monitored, in base skins [1/s]
    nearest: f64  # how near to a violation contacts are swept, at most [m/s]
    tile: wp.int32  # pairs that are interleaved


@wp.struct
class RunStatistics:
    """What is added up of the steps of a run; `warpgrains.solver.statistics` has a field of each name."""

    steps: wp.int32
    unconverged: wp.int32
    iterations: wp.int64
    rebuilds: wp.int64
    redos: wp.int64
    iterations_max: wp.int32
    residual: f64
    overlap: f64


@wp.struct
class Violation:
    """The first index outside of its array, where they are tested (access.py)."""

    found: wp.int64  # 0: none; 1: one; 2: one, and the stage is known
    array: wp.int64  # address of its first element
    length: wp.int64
    index: wp.int64
    stage: wp.int64  # number of its name (stages.py)


@wp.struct
class SceneRecord:
    """One scene: its state, its list of contacts, and its parameters."""

    grains: Grains
    contacts: Contacts
    verlet: Verlet
    momentum: Momentum
    working: WorkingSet
    grid: CellGrid
    neighbors: NeighborList
    workspace: Workspace
    dealt: Dealt
    control: Control
    partial: Partial
    history: History
    step: StepState
    statistics: RunStatistics
    violation: Violation
    to_search: wp.int32  # iterations until a proof that grains cannot fit is worth a search
    stopping: StoppingCriterion
    tuning: Tuning
    walls: Walls
    scheme: TimeScheme
    gravity: wp.vec2d  # [m/s2]
    drag: f64  # [kg/s]
    spin_drag: f64  # [kg m2/s]
    friction: f64  # coefficient between grains
    dt: f64  # [s]
    by_color: wp.int32  # whether pairs are swept by colors, or by levels
    merge: wp.int32  # whether all independent sets are swept as one


Scene = wp.ref[SceneRecord]
"""A stage is handed the record itself: what it writes, the next one reads."""


@wp.func
def grain_count(s: Scene) -> int:
    """How many grains there are."""
    return s.grains.position.shape[0]


@wp.func
def pair_count(s: Scene) -> int:
    """How many pairs are listed."""
    return s.contacts.count.pairs


@wp.func
def is_accelerated(s: Scene) -> bool:
    """Whether the method looks one sweep back."""
    return s.momentum.last_dv.shape[0] > 0


@wp.func
def dealt_threads(s: Scene) -> int:
    """How many threads are dealt tiles; 0 where a thread is alone, or all share every set out."""
    return s.dealt.cursor.shape[0]


@wp.func
def amid_sweeps(s: Scene) -> bool:
    """Whether a list was made after sweeps in which a contact that it has newly may have been missing."""
    return s.control.resuming != 0 and not is_accelerated(s)
