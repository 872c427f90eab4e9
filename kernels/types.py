"""Contacts as records, and the arrays of a scene bundled by purpose."""

from enum import IntEnum

import warp as wp

f64 = wp.float64
Floats = wp.array(dtype=f64)
Ints = wp.array(dtype=wp.int32)
Vectors = wp.array(dtype=wp.vec2d)
MOST_NUMBERS = 6  # of a kind of wall, as on the host (walls/wall.py)
Shape = wp.types.vector(length=1 + MOST_NUMBERS + 3, dtype=f64)
"""A wall other than the annulus: the number of its kind (`kind_number` of the host), its numbers [m], and a
circle about the places where grains touch it, center and radius [m]; that of a line or row is infinite."""


class MotionOf(IntEnum):
    """The numbers of a `Motion`, how a wall moves, by the names of those of walls/motion.py."""

    PIVOT_X = 0  # before it moves [m]
    PIVOT_Y = 1
    VELOCITY_X = 2  # [m/s]
    VELOCITY_Y = 3
    ANGULAR_VELOCITY = 4  # [rad/s]
    FREQUENCY = 5  # at which it oscillates [Hz]; 0: it does not
    PHASE = 6  # at which it begins to [rad]
    FROM_TIME = 7  # at which it begins [s]
    TO_TIME = 8  # at which it ends [s]
    SPEED = 9  # largest one of a point that changes its place [m/s]


class PoseOf(IntEnum):
    """The numbers of a `Pose`: where a wall is at the start of a step, and what it moves in it (eq. 26)."""

    COSINE = 0  # of the angle
    SINE = 1
    SHIFT_X = 2  # [m]
    SHIFT_Y = 3
    VELOCITY_X = 4  # that a point of it at the origin would have in the step [m/s]
    VELOCITY_Y = 5
    ALONG = 6  # what a point at unit distance from there moves along this way besides,
    ACROSS = 7  # and to the left of it [1/s]
    ANGULAR_VELOCITY = 8  # [rad/s]


class DriveOf(IntEnum):
    """The numbers of a `Drive`, what drives a wall, in the order of those of walls/wall.py."""

    INVERSE_MASS = 0  # [1/kg]; 0 where no force acts on it
    FORCE = 1  # [N]
    PRESSURE = 2  # [N/m]
    LENGTH = 3  # of a line on which it acts [m], unless two others bound it:
    FROM_LINE = 4  # the bodies of these; 0 if none do
    TO_LINE = 5
    DIRECTION_X = 6  # 0 for the outer circle, as the next
    DIRECTION_Y = 7
    LEADER = 8  # the wall whose speed and coordinate it has: its own number, or that of a row's line


Motion = wp.types.vector(length=len(MotionOf), dtype=f64)
Pose = wp.types.vector(length=len(PoseOf), dtype=f64)
Drive = wp.types.vector(length=len(DriveOf), dtype=f64)


@wp.struct
class Contact:
    """A candidate contact of grains i < j, or of grain i and wall j - n, where n is the number of grains.

    A correction reads its 32 bytes and never writes them. They hold the indices at which the velocities of
    its bodies begin in an array of numbers: a processor reads these at no cost, while to compute indices of
    vectors takes a tenth of a sweep.
    """

    n: wp.vec2d  # unit normal from i to j
    gap_rate: f64  # gap / dt, or less where the contact bounces (eq. 35) [m/s]
    i: wp.uint32  # 2 i
    j: wp.uint32  # 2 j


@wp.struct
class Grains:
    """State of the grains, in scenes with driven walls followed by that of the walls (driven.py).

    A wall has one component of position and velocities, the first one, and a contact mass.
    """

    position: Vectors  # [m]
    velocity: Vectors  # at the end of the last good step [m/s]
    free_velocity: Vectors  # after Newton's law, before contacts
    next_velocity: Vectors  # what the contact iteration corrects in place
    recomputed_velocity: Vectors  # what the corrections make of the free velocities
    last_position: Vectors  # where the last good step began, and its contacts were taken
    last_velocity: Vectors  # with which it began
    radius: Floats  # [m]
    mass: Floats  # m_i [kg]
    contact_mass: Floats  # M_i: impulse that changes the velocity by 1 m/s [kg]
    # The rest is empty in scenes without friction. A rim speed is the radius times the spin.
    spin: Floats  # at the end of the last good step [rad/s]
    last_spin: Floats  # with which it began
    angle: Floats  # by which it has turned [rad]
    free_rim: Floats  # rim speed after its drag, before contacts [m/s]
    next_rim: Floats  # that the contact iteration corrects in place
    recomputed_rim: Floats  # that the corrections make of the free one
    rim_mass: Floats  # J_i: impulse at the rim that changes the rim speed by 2 m/s [kg]


@wp.struct
class ContactCount:
    """Numbers of candidate contacts, and of the independent sets in which they are swept."""

    pairs: wp.int32
    sets: wp.int32  # of pairs; one more set has the contacts with walls
    walls: wp.int32  # contacts with walls, after the pairs


@wp.struct
class Contacts:
    """Candidate contacts in the order in which they are swept: pairs, then contacts with walls.

    The working set of accelerated sweeps has copies of some of the arrays; the others are empty there.
    """

    contact: wp.array(dtype=Contact)
    dv: Floats  # accumulated corrections dv_c [m/s]; < 0 only where the other side of a wall pushes
    dv_start: Floats  # dv_c of the last good step, with which a step starts, again if need be
    last_dv: Floats  # dv_c before the last sweep [m/s]; empty without acceleration
    weights: Vectors  # mass shares of i and j; empty where all masses are equal
    limits: Vectors  # at walls: gap / dt on the other side, A_i / dt of eq. 18 [m/s]; or empty
    wall_speed: Floats  # of contacts with walls: that of the surface [m/s] (eq. 23); empty if none is mobile
    dvt: Floats  # accumulated tangential corrections [m/s]; empty without friction
    dvt_start: Floats  # those with which a step starts
    last_dvt: Floats  # those before the last sweep
    dvr: Floats  # accumulated rolling corrections [m/s]; empty without rolling friction, as the next three
    dvr_start: Floats  # those with which a step starts
    last_dvr: Floats  # those before the last sweep
    roll_weights: Vectors  # part of its rim speed with which i rolls, and 1 / K_r (eq. 37)
    rim_weights: wp.array(dtype=wp.vec3d)  # 1 / K_t, and parts for the rims of i and j (eq. 22); as `weights`
    set_start: Ints  # first contact of every set of `stages.Sets`, and the end of the last
    count: ContactCount


ContactsByRef = wp.ref[Contacts]
"""All contacts, or those of the working set: what a sweep visits."""


@wp.struct
class NeighborList:
    """Candidate contacts by first grain: those of i are (i, neighbor[k]), start[i] <= k < start[i + 1].

    A row is in ascending order, so that contacts with walls (types.Contact) are at its end.
    """

    start: Ints
    neighbor: Ints
    second: Ints  # of every grain and wall: contacts that have it second
    found: wp.array(dtype=wp.vec2i)  # contacts as they were found; those beyond its end are only counted
    by_second: wp.array(dtype=wp.vec2i)  # contacts by second body
    slots: Ints  # taken for them
    empty: Ints  # of every CPU thread: how many of its slots have no contact
    total: Ints  # of contacts


@wp.struct
class CellGrid:
    """Grains by cell: those of bucket b are at cell_start[b] <= k < cell_start[b + 1] of the other arrays.

    The extent of a grain is its part of the distance at which pairs are within reach.
    """

    inverse_size: f64  # of a cell [1/m]
    width: wp.int32  # buckets a side, a power of two
    cell_start: Ints
    bucket: Ints  # of every grain
    grain: Ints
    x: Floats  # [m]
    y: Floats  # [m]
    velocity: Vectors  # v0_i beside their mean [m/s]
    skin: Floats  # with the radius [m]
    extent: Floats  # [m]


@wp.struct
class VerletNumbers:
    """The numbers by which a list is valid; a state keeps them under their names (`VerletList`)."""

    frame_shift: wp.vec2d  # path of the frame since the list was built [m]
    base_skin: f64  # [m]
    frame_skin: f64  # how far the frame may have come [m]
    elapsed: f64  # since the list was built [s]
    lifetime: f64  # for which the list was built [s]


@wp.struct
class VerletWork:
    """Numbers that are found again before they are used, in a step that begins from a state."""

    frame_velocity: wp.vec2d  # v_f [m/s]
    mean_velocity: wp.vec2d  # of the reference velocities v0_i [m/s]
    unmonitored_change: f64  # most that a velocity may have changed since it was last sampled [m/s]
    max_row_sum: f64  # most that one iteration changes a velocity by, in units of zeta


@wp.struct
class VerletFlags:
    """The findings of the list's check."""

    list_expired: wp.int32  # whether a contact may be missing
    without_normal: wp.int32  # whether a grain is where a wall has no normal
    bad_body: wp.int32  # a grain or wall that is no longer finite, or leaves a round wall or no room; or -1


@wp.struct
class Verlet:
    """The numbers that prove that no contact is missing from the list (verlet.py)."""

    peak_square: Floats  # per grain, largest p_i^2 of the step so far [m2/s2]
    peak_limit: Floats  # the p_i that its skin allows [m/s]
    recent_deviation: Floats  # p_i of the last step [m/s]
    skin: Floats  # how far it may stray without meeting an absent contact [m]
    reference_position: Vectors  # when the list was built [m]
    reference_velocity: Vectors  # v0_i [m/s]
    numbers: VerletNumbers
    work: VerletWork
    flags: VerletFlags


@wp.struct
class MomentumState:
    """The momentum of the accelerated method (momentum.py)."""

    t: f64
    beta: f64
    relaxation: f64  # by how much a sweep goes too far at beta = 1
    first_zeta: f64  # of the step's first sweep [m/s]
    change: f64  # of the last sweep with friction, squared and summed in the mass metric [kg m2/s2]


@wp.struct
class Momentum:
    """State before the last sweep, and sums by chunk (contacts.py). Empty if sweeps are not accelerated."""

    last_rim: Floats  # rim speeds [m/s]
    last_velocity: Vectors  # [m/s]
    # of contacts: cost in phi less gain (with friction: MomentumState.change); slope along the momentum
    contact_sums: Vectors
    body_sums: Vectors  # M s.(v + y) and M v.v, where y = v + beta s; unused with friction
    state: MomentumState


@wp.struct
class WorkingSet:
    """The contacts that are swept, by chunk (working_set.py). Empty if sweeps are not accelerated."""

    contacts: Contacts
    index: Ints  # among all contacts
    mass: Floats  # mu_c of pairs [kg]; empty where all masses are equal
    range: wp.array(dtype=wp.vec2i)  # first contact, and end, of every chunk


@wp.struct
class Workspace:
    """Temporary arrays for building a list."""

    old: NeighborList  # the list before
    old_dv: wp.array(dtype=wp.vec3d)  # of its contacts: now, at the step's start, a sweep back [m/s]
    old_dvt: wp.array(dtype=wp.vec3d)  # the same of tangential corrections; empty without friction
    old_dvr: wp.array(dtype=wp.vec3d)  # and of rolling ones; empty without rolling friction
    old_index: Ints  # of every contact in the list before, or -1
    sweep_index: Ints  # of every contact: its index in sweeping order
    set_of: Ints  # independent set of every pair; -1 of contacts with walls
    row_sum: Floats  # of every grain: its shares of its contacts
    taken: wp.array(dtype=wp.uint64)  # of every grain: the sets of its pairs so far (coloring.py)
