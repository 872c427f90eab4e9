"""Records of contacts, and records that group the arrays of a scene by purpose."""

from enum import IntEnum

import warp as wp

f64 = wp.float64
Floats = wp.array(dtype=f64)
Ints = wp.array(dtype=wp.int32)
Vectors = wp.array(dtype=wp.vec2d)
Triples = wp.array(dtype=wp.vec3d)
MOST_NUMBERS = 6  # of a kind of wall, as on the host (walls/wall.py)
Shape = wp.types.vector(length=1 + MOST_NUMBERS + 3, dtype=f64)
"""A wall other than the annulus: its kind (`kind_number` of the host), its numbers [m], and center and
radius [m] of a circle around all points where grains touch it; the radius of a line or row is infinite."""


class MotionOf(IntEnum):
    """Indices of the numbers of a `Motion`, which describes how a wall moves (names of walls/motion.py)."""

    PIVOT_X = 0  # of the pivot before the motion [m]
    PIVOT_Y = 1
    VELOCITY_X = 2  # [m/s]
    VELOCITY_Y = 3
    ANGULAR_VELOCITY = 4  # [rad/s]
    FREQUENCY = 5  # of the oscillation [Hz]; 0: no oscillation
    PHASE = 6  # of the oscillation at START_TIME [rad]
    START_TIME = 7  # at which the motion begins [s]
    END_TIME = 8  # at which the motion ends [s]
    SPEED = 9  # largest speed of a wall point [m/s]; rotation that maps a wall onto itself does not count


class PoseOf(IntEnum):
    """Indices of the numbers of a `Pose`: where a wall is at the start of a step, and its motion (eq. 26)."""

    COSINE = 0  # of the wall's angle
    SINE = 1
    SHIFT_X = 2  # [m]
    SHIFT_Y = 3
    VELOCITY_X = 4  # of the wall's point at the origin, displacement over dt [m/s]
    VELOCITY_Y = 5
    ALONG = 6  # what a point at x moves in addition, over dt: ALONG x + ACROSS tangent(x) [1/s]
    ACROSS = 7
    ANGULAR_VELOCITY = 8  # [rad/s]


class DriveOf(IntEnum):
    """Indices of the numbers of a `Drive`, the force on a wall, in the order of walls/wall.py."""

    INVERSE_MASS = 0  # [1/kg]; 0 if no force acts on the wall
    FORCE = 1  # [N]
    PRESSURE = 2  # [N/m]
    LENGTH = 3  # of a line on which the pressure acts [m], unless two other lines bound this line
    FROM_LINE = 4  # bodies of the two lines that bound this line; 0 if there are none
    TO_LINE = 5
    DIRECTION_X = 6  # in which the coordinate grows; 0, 0 for the outer circle
    DIRECTION_Y = 7
    LEADER = 8  # index of the wall that this wall moves with: for a row its driven line, otherwise itself


Motion = wp.types.vector(length=len(MotionOf), dtype=f64)
Pose = wp.types.vector(length=len(PoseOf), dtype=f64)
Drive = wp.types.vector(length=len(DriveOf), dtype=f64)


@wp.struct
class Contact:
    """A candidate contact of grains i < j, or of grain i and wall j - n, where n is the number of grains.

    A sweep reads the 32 bytes of a contact and does not write them. i and j are stored doubled: these are the
    indices at which the velocities of both bodies begin in an array of numbers. To compute them from the
    indices of vectors would take a tenth of a sweep.
    """

    n: wp.vec2d  # unit normal from i to j
    gap_rate: f64  # gap / dt, or less where the contact bounces (eq. 35) [m/s]
    i: wp.uint32  # 2 i
    j: wp.uint32  # 2 j


@wp.struct
class Grains:
    """State of the grains. In a scene with driven walls, the state of all walls follows (driven.py).

    A wall uses the first component of position and velocities only, and has a contact mass.
    """

    position: Vectors  # [m]
    velocity: Vectors  # at the end of the last good step [m/s]
    free_velocity: Vectors  # after Newton's law, before contacts [m/s]
    next_velocity: Vectors  # that the contact iteration corrects in place [m/s]
    recomputed_velocity: Vectors  # free velocity plus all corrections, summed again [m/s]
    last_position: Vectors  # at the start of the last good step, for which its contacts were found [m]
    last_velocity: Vectors  # at the start of the last good step [m/s]
    radius: Floats  # [m]
    mass: Floats  # m_i [kg]
    contact_mass: Floats  # M_i: impulse that changes the velocity by 1 m/s [kg]
    # The rest is empty in scenes without friction. A rim speed is the radius times the spin.
    spin: Floats  # at the end of the last good step [rad/s]
    last_spin: Floats  # at the start of the last good step [rad/s]
    angle: Floats  # by which the grain has turned [rad]
    free_rim: Floats  # rim speed after drag, before contacts [m/s]
    next_rim: Floats  # rim speed that the contact iteration corrects in place [m/s]
    recomputed_rim: Floats  # free rim speed plus all corrections, summed again [m/s]
    rim_mass: Floats  # J_i: impulse at the rim that changes the rim speed by 2 m/s [kg]


@wp.struct
class ContactCount:
    """Numbers of candidate contacts, and of the independent sets in which they are swept."""

    pairs: wp.int32
    sets: wp.int32  # of pairs; one more set contains the contacts with walls
    walls: wp.int32  # contacts with walls, after the pairs


@wp.struct
class Correction:
    """Accumulated corrections of contacts in one direction: normal, tangential or rolling [m/s].

    All arrays are empty if the scene has no such corrections.
    """

    now: Floats
    start: Floats  # at the end of the last good step, with which each attempt of a step starts
    last: Floats  # before the last sweep; empty without acceleration
    saved: Triples  # now, start and last in the rows of the previous list, from which a new one starts


CorrectionByRef = wp.ref[Correction]


@wp.struct
class Contacts:
    """Candidate contacts in the order in which they are swept: pairs, then contacts with walls.

    In the working set of accelerated sweeps, some of these arrays are copies and the rest are empty.
    """

    contact: wp.array(dtype=Contact)
    dv: Correction  # normal; < 0 if the other side of a wall pushes
    dvt: Correction  # tangential, with friction
    dvr: Correction  # rolling, with rolling friction
    weights: Vectors  # mass shares of i and j; empty if all masses are equal
    limits: Vectors  # of contacts with walls: gap / dt of the other side, A_i / dt (eq. 18) [m/s]; or empty
    wall_speed: Floats  # of contacts with walls: surface speed [m/s] (eq. 23); empty if no wall is mobile
    roll_weights: Vectors  # part of i's rim speed that rolls, and 1 / K_r (eq. 37); empty without rolling
    rim_weights: wp.array(dtype=wp.vec3d)  # 1 / K_t, shares of the rims of i and j (eq. 22); may be empty
    set_start: Ints  # first contact of every set of `stages.Sets`, and the end of the last set
    count: ContactCount


ContactsByRef = wp.ref[Contacts]
"""The contacts that a sweep visits: all contacts, or those of the working set."""


@wp.struct
class NeighborList:
    """Candidate contacts in rows: row i contains (i, neighbor[k]) for start[i] <= k < start[i + 1].

    A row is in ascending order, so that contacts with walls (`Contact`) are at the end of it.
    """

    start: Ints
    neighbor: Ints
    sweep_index: Ints  # of every contact: its index in the order of the sweep
    # The rest is used while a list is built.
    old_start: Ints  # rows of the previous list
    old_neighbor: Ints
    old_index: Ints  # of every contact: its index in the previous list, or -1
    set_of: Ints  # independent set of every pair; -1 for contacts with walls
    taken: wp.array(dtype=wp.uint64)  # of every grain: the sets of its pairs so far (coloring.py)
    row_sum: Floats  # of every grain: sum of its mass shares over its contacts
    second: Ints  # number of contacts in which a grain or wall is the second body
    found: wp.array(dtype=wp.vec2i)  # contacts in the order of the search, as many as fit
    by_second: wp.array(dtype=wp.vec2i)  # contacts sorted by second body
    slots: Ints  # number of slots of `found` that threads have taken, shape (1,)
    empty: Ints  # of every CPU thread: number of slots that it took and left empty
    total: Ints  # number of contacts, shape (1,)


@wp.struct
class CellGrid:
    """Grains sorted by cell: bucket b contains the indices k with cell_start[b] <= k < cell_start[b + 1].

    The extent of a grain is the share of this grain in the distance at which a pair is within reach.
    """

    inverse_size: f64  # of a cell [1/m]
    width: wp.int32  # buckets along a side, a power of two
    cell_start: Ints
    bucket: Ints  # of every grain, by grain; the arrays below are by index k
    grain: Ints
    x: Floats  # [m]
    y: Floats  # [m]
    velocity: Vectors  # v0_i minus the mean of all v0_i [m/s]
    skin: Floats  # skin plus radius [m]
    extent: Floats  # [m]


@wp.struct
class Verlet:
    """Arrays by body, and numbers, that prove that no contact is missing from the list (verlet.py)."""

    peak_square: Floats  # per grain, largest p_i^2 of the step so far [m2/s2]
    peak_limit: Floats  # the p_i that the skin allows [m/s]
    recent_deviation: Floats  # p_i of the last step [m/s]
    skin: Floats  # skin_i: bound on s_i + dt p_i for which the list is valid [m]
    reference_position: Vectors  # position when the list was built [m]
    reference_velocity: Vectors  # v0_i [m/s]
    # Numbers that bound how long the list is valid; a state saves them under these names (`VerletList`).
    frame_shift: wp.vec2d  # path of the frame since the list was built [m]
    base_skin: f64  # [m]
    frame_skin: f64  # largest path of the frame for which the list is valid [m]
    elapsed: f64  # since the list was built [s]
    lifetime: f64  # for which the list was built [s]
    # Numbers that a step computes before it uses them, so that a saved state does not contain them.
    frame_velocity: wp.vec2d  # v_f [m/s]
    mean_velocity: wp.vec2d  # of the reference velocities v0_i [m/s]
    unmonitored_change: f64  # bound on the change of a velocity since velocities were last sampled [m/s]
    max_row_sum: f64  # bound on the change of a velocity by one iteration, in units of zeta
    # Results of the check.
    list_expired: wp.int32  # whether a contact may be missing from the list
    without_normal: wp.int32  # whether a grain is where the normal of a wall is undefined
    bad_body: wp.int32  # a body that is not finite or moves too far (NOT_FINITE, TOO_FAR), or -1


@wp.struct
class Momentum:
    """The momentum of the accelerated method (momentum.py), and sums by chunk (contacts.py)."""

    t: f64
    beta: f64
    relaxation: f64  # over-relaxation omega - 1 at beta = 1
    first_zeta: f64  # zeta of the first sweep of the step [m/s]
    change: f64  # of the last sweep with friction, squared and summed in the mass metric [kg m2/s2]
    # The arrays are empty without acceleration.

    last_rim: Floats  # rim speeds before the last sweep [m/s]
    last_velocity: Vectors  # before the last sweep [m/s]
    # by chunk of contacts: rise of phi (with friction: `change`), and slope along the momentum
    contact_sums: Vectors
    body_sums: Vectors  # sums of M s.(v + y) and M v.v, where y = v + beta s; unused with friction


@wp.struct
class WorkingSet:
    """The contacts that accelerated sweeps visit, by chunk (working_set.py). Empty without acceleration."""

    contacts: Contacts
    index: Ints  # index of each contact in the list of all contacts
    mass: Floats  # mu_c of pairs [kg]; empty if all masses are equal
    range: wp.array(dtype=wp.vec2i)  # first contact and end of every chunk
