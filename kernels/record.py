"""A scene as a record: its arrays, the numbers of a step, and parameters.

A kernel changes the numbers and the contents of the arrays. It changes neither their lengths nor parameters,
but for those that follow from the time or from driven walls: `gravity`, the times to which velocities belong
(`TimeScheme`), and the speed and the radius of the outer circle (`walls.surface` and `walls.annulus`). This
radius is also the coordinate of the circle's body (driven.py).
"""

from enum import IntEnum
from typing import NamedTuple

import warp as wp

from .types import (
    CellGrid,
    Contacts,
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
from .walls.walls import Walls

f64 = wp.float64

SOLVED, WITHOUT_ROOM, NOT_FINITE, NOT_CONVERGED, EXPIRED, CANCELLED, TOO_FAR, SLOW, PAUSED = (
    wp.constant(k) for k in range(9)
)
"""Outcomes of a step. A SOLVED one is taken, converged or, if the scene allows it, not. An EXPIRED one begins
again with another list, and a SLOW one waits for the host. A scene is PAUSED after a step that is taken."""


class Kind(NamedTuple):
    """Kind of scenes that share kernels."""

    method: str
    has_friction: bool
    has_restitution: bool
    has_rolling: bool  # resistance to it, only with friction


class Phase(IntEnum):
    """The next part of a step. Serial stages choose it, by stopping.py and attempt.py; step.py reads it.

    Besides, the list's own stages choose SEARCH, START and FULL, `contact_list.keep_pair` repeats a search,
    and the host answers steps that are FULL or SLOW.
    """

    ENDED = 0  # nothing: no step has begun, or the last one has its outcome; the host solves a SLOW one
    FULL = 1  # nothing: the host reserves memory for the list
    SEARCH = 2  # find the candidate contacts
    START = 3  # freeze contacts, and apply their corrections; at first also free velocities
    CORRECTED = 4  # take the velocities that the host's corrections make
    DECLINED = 5  # go on: the host has found no better corrections
    SCAN = 6  # check the list, measure, and scan all contacts for the working set, before a bout of sweeps
    SWEEP = 7
    VERIFY = 8  # verify the list and judge the step: the sweeps have stopped, or the list has not sufficed


class Asking(IntEnum):
    """When the host is still asked to solve a step. Its answers say so, and before them the method."""

    NEVER = 0
    AT_LAST = 1  # after the last sweep
    EARLY = 2  # also as soon as sweeps converge too slowly


@wp.struct
class StepState:
    """The progress of a step, and its results."""

    iterations: wp.int32
    zeta: f64  # of the last iteration [m/s]
    residual: f64  # eta [m/s]
    overlap: f64  # worst after the move [m]
    active: wp.int32  # contacts that carry a correction
    rebuilds: wp.int32  # lists built
    restarts: wp.int32  # attempts that a missing contact made void
    factorizations: wp.int32  # by the host
    measured: wp.int32  # last iteration after which the residual was measured
    asking: wp.int32  # an `Asking`
    trend_residual: f64  # eta with which the next one is compared, by which it falls too slowly [m/s]
    converged: wp.int32  # whether it has met the tolerance
    outcome: wp.int32


@wp.struct
class Control:
    """The phase of the step, and flags that it does not imply."""

    phase: wp.int32
    cancelled: wp.int32  # whether the host wants the step given up
    unordered: wp.int32  # whether the list is not in sweeping order
    resuming: wp.int32  # whether accelerated sweeps continue from the velocities and momentum that they have
    may_stop: wp.int32  # whether sweeps end here, if a measurement or a scan that follows agrees
    rejected: wp.int32  # whether the last sweep was rolled back


@wp.struct
class Partial:
    """Partial maxima and sums, by thread of a CPU; the threads of a GPU's block share a few."""

    zeta: Floats  # largest change of a correction by a sweep, or violation found by a scan [m/s]
    residual: Floats  # [m/s]
    overlap: Floats  # [m]
    active: Ints
    kept_velocity: Vectors  # velocities of a block of pairs, as the corrections make them [m/s]


@wp.struct
class History:
    """Zeta and residual of every iteration of the last step; of length 0 unless they are asked for."""

    zeta: Floats  # of every iteration [m/s]
    residual: Floats  # after it [m/s]


@wp.struct
class StoppingCriterion:
    """The parameters by which iterations stop (stopping.py)."""

    on: wp.int32  # the quantity that the tolerance bounds, a `stopping.StopOn`
    tolerance: f64  # [m/s]
    max_iterations: wp.int32
    patience: wp.int32  # sweeps that the host's factorizations are worth; 0: it does none
    raise_on_unconverged: wp.int32  # whether a step that has not converged is not taken


@wp.struct
class TimeScheme:
    """The times to which velocities belong."""

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


@wp.struct
class StepSums:
    """Sums and maxima over the steps of a run, by the names of `warpgrains.solver.statistics`."""

    steps: wp.int32
    unconverged: wp.int32
    iterations: wp.int64
    rebuilds: wp.int64
    restarts: wp.int64
    iterations_max: wp.int32
    residual: f64
    overlap: f64


@wp.struct
class Violation:
    """The first index outside of its array, where they are tested (access.py)."""

    found: wp.int64  # whether there was one
    array: wp.int64  # address of its first element
    length: wp.int64
    index: wp.int64


@wp.struct
class Turning:
    """Gravity that turns."""

    start: wp.vec2d  # gravity at time 0 [m/s2]
    rate: f64  # [rad/s]; 0 where gravity is constant


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
    control: Control
    partial: Partial
    history: History
    step: StepState
    statistics: StepSums
    violation: Violation
    start_time: f64  # [s]
    steps: wp.int64  # since the start
    stopping: StoppingCriterion
    tuning: Tuning
    walls: Walls
    scheme: TimeScheme
    gravity: wp.vec2d  # at the start of the step [m/s2]
    turning: Turning
    drag: f64  # [kg/s]
    spin_drag: f64  # [kg m2/s]
    friction: f64  # coefficient between grains
    rolling_friction: f64  # the same of rolling
    restitution: f64  # the same, of contacts that bounce
    restitution_speed: f64  # at which they must close [m/s]
    dt: f64  # [s]
    by_color: wp.int32  # whether pairs are swept by colors, or by levels
    merge: wp.int32  # whether all independent sets are swept as one


Scene = wp.ref[SceneRecord]
"""The record by reference: what a stage writes, the next one reads."""


@wp.func
def grain_count(s: Scene) -> int:
    """Return the number of grains."""
    return s.grains.radius.shape[0]


@wp.func
def time_after(s: Scene, steps: wp.int64) -> f64:
    """Return the time after a number of steps [s]."""
    return s.start_time + f64(steps) * s.dt


@wp.func
def body_count(s: Scene) -> int:
    """Return the number of bodies that have a velocity: grains and, if one is driven, walls."""
    return s.grains.position.shape[0]


@wp.func
def is_driven(s: Scene) -> bool:
    """Return whether a force acts on a wall (driven.py)."""
    return s.walls.drive.shape[0] > 0


@wp.func
def rotates(s: Scene, i: int) -> bool:
    """Return whether a body has a spin: a grain of a scene with friction."""
    return i < s.grains.spin.shape[0]


@wp.func
def has_friction(s: Scene) -> bool:
    """Return whether contacts have tangential corrections."""
    return rotates(s, 0)


@wp.func
def has_rolling(s: Scene) -> bool:
    """Return whether contacts have rolling corrections."""
    return s.contacts.dvr.shape[0] > 0


@wp.func
def has_weights(s: Scene) -> bool:
    """Return whether contacts have weights; without them, masses are equal (solver/sizes.py)."""
    return s.contacts.weights.shape[0] > 0


@wp.func
def pair_count(s: Scene) -> int:
    """Return the number of listed pairs."""
    return s.contacts.count.pairs


@wp.func
def is_cancelled(s: Scene) -> bool:
    """Return whether the step is given up: the host wants it, or an index was outside of its array."""
    return s.control.cancelled != 0 or s.violation.found != wp.int64(0)


@wp.func
def has_swept(s: Scene) -> bool:
    """Return whether the attempt has begun to sweep: its list has not expired before."""
    return s.step.iterations > 0


@wp.func
def is_accelerated(s: Scene) -> bool:
    """Return whether the method has momentum, and so keeps the state of one sweep before."""
    return s.contacts.last_dv.shape[0] > 0
