"""A scene as a record: its arrays, the numbers of a step, and parameters.

A kernel changes the numbers and the contents of the arrays, and no length of an array. It changes only those
parameters that follow from the time or from driven walls: `gravity`, the times to which velocities belong
(`staggered`), and the speed and the radius of the outer circle (`walls.surface` and `walls.annulus`). This
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
)
from .walls.walls import Walls

f64 = wp.float64


class Outcome(IntEnum):
    """Result of a step."""

    SOLVED = 0  # accepted: it has converged, or the scene allows that it has not
    WAITING = 1  # not ended: it waits for the host, and its phase says for what
    NOT_FINITE = 2
    TOO_FAR = 3  # a grain may move beyond a wall, or meet two images of another grain
    NOT_CONVERGED = 4
    STOPPED = 5  # cancelled by the host; or solved, but as many steps as the host allows have not converged


class Kind(NamedTuple):
    """The properties of a scene that choose its kernels; scenes of the same kind share kernels."""

    method: str  # a key of `step.METHODS`: "gauss-seidel", "accelerated" or "exact"
    has_friction: bool
    has_restitution: bool
    has_rolling: bool  # whether contacts resist rolling, which requires friction


class Phase(IntEnum):
    """The next part of a step. Stages of stopping.py and attempt.py choose the phase, and step.py reads it.

    Stages that build the list also choose SEARCH, START and LIST_FULL. `contact_list.keep_pair` repeats a
    search. A step that is SLOW or LIST_FULL waits for the host, which changes the phase to the next one.
    """

    ENDED = 0  # no step has begun, or the last one has its outcome
    LIST_FULL = 1  # wait until the host has reserved memory for the list; then SEARCH
    SLOW = 2  # wait until the host has tried to solve the step; then ANSWERED
    SEARCH = 3  # find the candidate contacts
    START = 4  # compute free velocities, unless that is done; freeze contacts, and apply their corrections
    ANSWERED = 5  # measure the corrections of the host; sweeps resume if it has not found better ones
    SCAN = 6  # check the list, measure, and scan all contacts for the working set, before a bout of sweeps
    SWEEP = 7
    VERIFY = 8  # verify the list and judge the step, after the sweeps or because the list has expired


class HostRequest(IntEnum):
    """When a step may request a solution from the host. The method and the host's answers set it."""

    NEVER = 0
    AT_LAST = 1  # after the last sweep
    EARLY = 2  # also as soon as sweeps converge too slowly


@wp.struct
class StepState:
    """Progress of a step, and its results."""

    iterations: wp.int32
    zeta: f64  # largest change of a correction by the last iteration [m/s]
    residual: f64  # eta [m/s]
    overlap: f64  # worst after the move [m]
    active: wp.int32  # contacts that carry a correction
    rebuilds: wp.int32  # lists built
    restarts: wp.int32  # attempts that were repeated because a contact may have been missing
    factorizations: wp.int32  # by the host
    measured: wp.int32  # last iteration after which the residual was measured
    host_request: wp.int32  # a `HostRequest`
    trend_residual: f64  # eta with which the next eta is compared, to see whether it falls too slowly [m/s]
    converged: wp.int32  # whether the step has met the tolerance
    outcome: wp.int32  # an `Outcome`


@wp.struct
class Control:
    """The phase of the step, and flags that do not follow from the phase."""

    phase: wp.int32
    cancelled: wp.int32  # whether the host has cancelled the step
    unordered: wp.int32  # whether the list has still to be sorted into the order of the sweep
    resuming: wp.int32  # whether accelerated sweeps continue from the present velocities and momentum
    may_stop: wp.int32  # whether sweeps end here, if the measurement or scan that follows confirms it
    rejected: wp.int32  # whether the last sweep was rolled back


@wp.struct
class Partial:
    """Partial maxima and sums, one for each CPU thread; the threads of a GPU block share a few."""

    zeta: Floats  # largest change of a correction by a sweep, or largest violation found by a scan [m/s]
    residual: Floats  # [m/s]
    overlap: Floats  # [m]
    active: Ints  # contacts that carry a correction
    kept_velocity: Vectors  # velocities of both grains of each pair of a block, after its correction [m/s]


@wp.struct
class StoppingCriterion:
    """Parameters that decide when iterations stop (stopping.py)."""

    on: wp.int32  # the quantity that the tolerance bounds, a `stopping.StopOn`
    tolerance: f64  # [m/s]
    max_iterations: wp.int32
    patience: wp.int32  # sweeps that cost as much as a solution by the host; 0: the host solves no step
    raise_on_unconverged: wp.int32  # whether a step that has not converged is an error


@wp.struct
class Tuning:
    """Lengths from which lists are built, and limits within which the proof of verlet.py holds."""

    smallest_radius: f64  # [m]
    room: f64  # how far a grain may move from the mean motion before the list is renewed [m]
    acceleration: f64  # |gravity| [m/s2]
    rounding: f64  # bound on the rounding error of a position [m]
    reserve: f64  # part of the base skin that must be left before the iteration starts
    monitor_threshold: f64  # change of a velocity from which it is monitored, over the base skin [1/s]
    nearest: f64  # largest distance from a violation at which a contact is still swept [m/s]


@wp.struct
class StepSums:
    """Sums and maxima over the steps of a run, with the names of `warpgrains.solver.statistics`."""

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
    """The first index outside its array, in checked mode (access.py)."""

    found: wp.int64  # whether an index was outside its array
    array: wp.int64  # address of the first element of this array
    length: wp.int64
    index: wp.int64


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
    control: Control
    partial: Partial
    zeta_history: Floats  # of every iteration of the last step [m/s]; of length 0 unless requested
    residual_history: Floats  # after every iteration [m/s]
    step: StepState
    reported: StepState  # of the last step that was done
    statistics: StepSums
    violation: Violation
    start_time: f64  # [s]
    steps: wp.int64  # since the start
    stopping: StoppingCriterion
    tuning: Tuning
    walls: Walls
    leapfrog: wp.int32  # whether velocities belong to the middle of a step
    staggered: wp.int32  # whether velocities are half a step behind the positions now
    last_staggered: wp.int32  # `staggered` before the last good step
    gravity: wp.vec2d  # at the start of the step [m/s2]
    gravity_start: wp.vec2d  # at time 0 [m/s2]
    gravity_rate: f64  # angular velocity of gravity [rad/s]; 0 if it is constant
    drag: f64  # [kg/s]
    spin_drag: f64  # [kg m2/s]
    friction: f64  # coefficient between grains
    rolling_friction: f64  # coefficient between grains
    restitution: f64  # coefficient between grains
    restitution_speed: f64  # closing speed above which contacts bounce [m/s]
    first_bounce: wp.int64  # steps before the first one in which contacts bounce
    dt: f64  # [s]
    by_color: wp.int32  # whether the independent sets of pairs are colors (1) or levels (0)
    merge: wp.int32  # whether all pairs are swept as one set, in their order


Scene = wp.ref[SceneRecord]
"""The record by reference: a stage reads what the previous stages have written."""


@wp.func
def grain_count(s: Scene) -> int:
    """Return the number of grains."""
    return s.grains.radius.shape[0]


@wp.func
def time_after(s: Scene, steps: wp.int64) -> f64:
    """Return the time [s] after a number of steps since the start of the scene."""
    return s.start_time + f64(steps) * s.dt


@wp.func
def body_count(s: Scene) -> int:
    """Return the number of bodies with a velocity: all grains, and all walls if a wall is driven."""
    return s.grains.position.shape[0]


@wp.func
def is_driven(s: Scene) -> bool:
    """Return whether a force drives at least one wall of the scene (driven.py)."""
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
    return s.contacts.dvr.now.shape[0] > 0


@wp.func
def has_weights(s: Scene) -> bool:
    """Return whether contacts have mass shares (`Contacts.weights`); otherwise, all masses are equal."""
    return s.contacts.weights.shape[0] > 0


@wp.func
def pair_count(s: Scene) -> int:
    """Return the number of listed pairs."""
    return s.contacts.count.pairs


@wp.func
def is_cancelled(s: Scene) -> bool:
    """Return whether the step is cancelled: by the host, or because an index was outside its array."""
    return s.control.cancelled != 0 or s.violation.found != wp.int64(0)


@wp.func
def has_swept(s: Scene) -> bool:
    """Return whether the attempt to solve the step has done at least one sweep."""
    return s.step.iterations > 0


@wp.func
def is_accelerated(s: Scene) -> bool:
    """Return whether the method has momentum, and so stores the corrections before the last sweep."""
    return s.contacts.dv.last.shape[0] > 0
