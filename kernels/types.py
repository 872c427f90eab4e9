"""A scene as the kernels see it: contacts as records, arrays bundled by purpose, and the numbers of a step.

The numbers of a record change while a kernel runs, as the contents of its arrays do; lengths and parameters do
not.
"""

import warp as wp

from .walls import WallContact, Walls

f64 = wp.float64
Floats = wp.array(dtype=f64)
Ints = wp.array(dtype=wp.int32)
Vectors = wp.array(dtype=wp.vec2d)

SOLVED, WITHOUT_ROOM, NOT_FINITE, NOT_CONVERGED, EXPIRED, UNPROVED = (wp.constant(k) for k in range(6))
"""Outcomes of a step: UNPROVED is solved as far as it can be, and worth a search for a proof that it cannot."""


@wp.struct
class Pair:
    """A candidate pair i < j, 32 bytes: what one correction reads and never writes."""

    n: wp.vec2d  # unit normal from i to j
    gap_rate: f64  # gap / dt [m/s]
    i: wp.int32
    j: wp.int32


@wp.struct
class Grains:
    """State of the grains."""

    position: Vectors  # [m]
    velocity: Vectors  # at the end of the last good step [m/s]
    free_velocity: Vectors  # after Newton's law, before contacts
    next_velocity: Vectors  # what the contact iteration corrects in place
    rebuilt_velocity: Vectors  # what the corrections make of the free velocities
    last_position: Vectors  # where the last good step began, and its contacts were taken
    last_velocity: Vectors  # with which it began
    radius: Floats  # [m]
    mass: Floats  # [kg]


@wp.struct
class ContactCount:
    """How many candidate contacts there are, and in how many independent sets the pairs are swept."""

    pairs: wp.int32
    sets: wp.int32  # or segments, where threads have strips (strips.py)
    walls: wp.int32


@wp.struct
class Contacts:
    """Candidate contacts in the order in which they are swept."""

    pairs: wp.array(dtype=Pair)
    pair_dv: Floats  # accumulated corrections dv_c >= 0 [m/s]
    pair_dv_start: Floats  # dv_c at the start of the step, for a step that is solved again
    weights: Vectors  # mass shares of i and j; empty where all masses are equal
    set_start: Ints  # first pair of every independent set, or segment, and the end of the last
    walls: wp.array(dtype=WallContact)
    wall_dv_start: Floats
    count: ContactCount


@wp.struct
class NeighborList:
    """Candidate pairs by first grain: those of i are (i, neighbor[k]), start[i] <= k < start[i + 1]."""

    start: Ints
    cursor: Ints
    neighbor: Ints
    found: wp.array(dtype=wp.vec2i)  # pairs as they were found; those beyond its end are only counted
    total: Ints


@wp.struct
class CellGrid:
    """Grains by cell: those of bucket b are cell_grain[cell_start[b]:cell_start[b + 1]]."""

    size: f64  # of a cell [m]
    width: wp.int32  # buckets a side, a power of two
    cell_start: Ints
    cell_cursor: Ints
    cell_grain: Ints
    extent: Floats  # of every grain: its part of the distance at which pairs are within reach [m]


@wp.struct
class VerletNumbers:
    """What a list is good for; a state keeps them."""

    frame_velocity: wp.vec2d  # u [m/s]
    frame_shift: wp.vec2d  # path of the frame since the list was built [m]
    mean_velocity: wp.vec2d  # of the reference velocities w_i [m/s]
    base_skin: f64  # [m]
    frame_skin: f64  # how far the frame may have come [m]
    unmonitored_change: f64  # most that a velocity may have changed since it was last looked at [m/s]
    sampled_change: f64  # that change when grains are looked at [m/s]
    max_row_sum: f64  # most that one iteration changes a velocity by, in units of zeta
    elapsed: f64  # since the list was built [s]
    lifetime: f64  # for which the list was built [s]
    spread: f64  # largest |w_i - mean| [m/s]


@wp.struct
class VerletFlags:
    """What the check of the list asks for, and what it has found."""

    monitored: wp.int32  # whether the next sweep looks at every velocity that it changes
    list_expired: wp.int32  # whether a contact may be missing
    bad_grain: wp.int32  # a grain that is no longer finite, or -1


@wp.struct
class Verlet:
    """What proves that no contact is missing from the list (verlet.py)."""

    peak_deviation: Floats  # per grain, largest p_i^2 of the step so far [m2/s2]
    peak_limit: Floats  # the p_i^2 that its skin allows [m2/s2]
    recent_deviation: Floats  # p_i of the last step [m/s]
    skin: Floats  # how far it may stray without meeting an absent contact [m]
    reference_position: Vectors  # when the list was built [m]
    reference_velocity: Vectors  # w_i [m/s]
    numbers: VerletNumbers
    flags: VerletFlags


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
    iterating: wp.int32
    sampling: wp.int32
    rejected: wp.int32
    measuring: wp.int32
    rebuilding: wp.int32
    accepted: wp.int32
    sweeping: wp.int32
    set: wp.int32  # that is swept now, where every set is a launch of its own


@wp.struct
class Partial:
    """What every thread has found; the maximum or sum over all threads counts."""

    zeta: Floats
    residual: Floats
    overlap: Floats
    active: Ints


@wp.struct
class MomentumState:
    """How far the accelerated method goes on (accelerated.py)."""

    t: f64
    beta: f64
    relaxation: f64  # by how much a sweep goes too far at beta = 1


@wp.struct
class Momentum:
    """What lies one sweep back, and the parts of sums, by chunk. Empty in scenes that do not accelerate."""

    pair_last: Floats  # corrections before the last sweep [m/s]
    wall_last: Floats
    last_velocity: Vectors  # velocities that go with them [m/s]
    pair_part: Vectors  # cost in phi less gain, and slope of phi along the momentum
    wall_part: Vectors
    grain_part: wp.array(dtype=wp.vec3d)  # sums of m s.(v + y) and m v.v, largest s.s, where y = v + beta s
    state: MomentumState


@wp.struct
class Strips:
    """Whose pairs are whose, where a team of threads sweeps (strips.py). Empty in teams of one."""

    strip: Ints  # of every grain
    bins: Ints  # pairs by place, for cutting space into strips
    last: wp.array(
        dtype=wp.vec2i
    )  # of every grain: the strip of its last pair so far, and the index after it
    cursor: Ints  # of every strip: its next pair
    late_cursor: Ints  # the same, LAG pairs before
    seen: Ints  # of every strip and other strip: the pair before which it waits already
    segment: Ints  # of every pair
    first_segment: Ints  # of every strip, and the end of the last
    dependencies: Ints  # of every segment and strip: how many of its segments end before
    first_wall: Ints  # of every strip, and the end of the last


@wp.struct
class Workspace:
    """What building a list takes beside the list itself."""

    old: NeighborList  # the list before
    old_pair_dv: Floats  # its corrections [m/s]
    wall_dv: Floats  # corrections at the walls, by grain [m/s]
    sweep_index: Ints  # place of every pair in sweeping order
    group: Ints  # set, or tile, of every pair
    sequence: wp.array(dtype=wp.vec3i)  # pairs in sweeping order: (i, j, place in the neighbor list)
    row_sum: Floats  # of every grain: its shares of its contacts
    next_level: Ints  # by grain
    used_colors: wp.array(dtype=wp.uint64)  # by grain


@wp.struct
class StoppingCriterion:
    """When to stop iterating."""

    on_residual: wp.int32  # whether the tolerance is on the residual, or on zeta
    tolerance: f64  # [m/s]
    max_iterations: wp.int32
    raise_on_unconverged: wp.int32  # whether a step that has not converged is not taken


@wp.struct
class Tuning:
    """Lengths with which lists are made, and limits within which the proof of `verlet.py` holds."""

    smallest_radius: f64  # [m]
    room: f64  # that a list's lifetime leaves to the grains [m]
    acceleration: f64  # |gravity| [m/s2]
    rounding: f64  # of a position [m]
    reserve: f64  # of a base skin, that must be left before the iteration starts
    monitor_threshold: f64  # change of velocity that need not be monitored, in base skins [1/s]
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
    to_search: wp.int32  # iterations until a proof that grains cannot fit is worth a search
    residual: f64
    overlap: f64


@wp.struct
class SceneRecord:
    """One scene: its state, its list of contacts, and its parameters."""

    grains: Grains
    contacts: Contacts
    verlet: Verlet
    momentum: Momentum
    grid: CellGrid
    neighbors: NeighborList
    workspace: Workspace
    strips: Strips
    control: Control
    partial: Partial
    step: StepState
    statistics: RunStatistics
    stopping: StoppingCriterion
    tuning: Tuning
    walls: Walls
    gravity: wp.vec2d  # [m/s2]
    drag: f64  # [kg/s]
    dt: f64  # [s]
    by_color: wp.int32  # whether pairs are swept by colors, or by levels
    merge: wp.int32  # whether all independent sets are swept as one
    has_strips: wp.int32  # whether threads have strips of their own, or share every set out


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
def wall_count(s: Scene) -> int:
    """How many grains are listed at the walls."""
    return s.contacts.count.walls
