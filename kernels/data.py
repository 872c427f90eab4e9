"""What the kernels share: contacts as records, and the arrays of a run bundled by purpose."""

import warp as wp

f64 = wp.float64


@wp.struct
class Pair:
    """A candidate pair i < j, 32 bytes: what one correction reads and never writes."""

    n: wp.vec2d  # unit normal from i to j
    gap_rate: f64  # gap / dt [m/s]
    i: wp.int32
    j: wp.int32


@wp.struct
class Wall:
    """A grain that may reach a wall: its unit normal and accumulated correction dv_b [m/s]."""

    n: wp.vec2d
    gap_rate_out: f64
    gap_rate_in: f64
    dv: f64
    i: wp.int32


@wp.struct
class Grains:
    """State of the grains. `radius` and `mass` have one entry where all grains share it."""

    position: wp.array(dtype=wp.vec2d)  # [m]
    velocity: wp.array(dtype=wp.vec2d)  # at the end of the last good step [m/s]
    free_velocity: wp.array(dtype=wp.vec2d)  # after Newton's law, before contacts
    next_velocity: wp.array(dtype=wp.vec2d)  # what the contact iteration corrects in place
    rebuilt_velocity: wp.array(dtype=wp.vec2d)  # what the corrections make of the free velocities
    last_position: wp.array(dtype=wp.vec2d)  # where the contacts of the last step were taken
    radius: wp.array(dtype=f64)
    mass: wp.array(dtype=f64)


@wp.struct
class Contacts:
    """Candidate contacts in the order in which they are swept (slots), in groups that share no grain."""

    pairs: wp.array(dtype=Pair)
    pair_dv: wp.array(dtype=f64)  # accumulated corrections dv_c >= 0 [m/s]
    weights: wp.array(dtype=wp.vec2d)  # mass shares of i and j; empty where all masses are equal
    pair_dv_start: wp.array(dtype=f64)  # dv_c at the start of the step, for a step that is solved again
    group_start: wp.array(dtype=wp.int32)  # first slot of every group, and the end of the last
    walls: wp.array(dtype=Wall)
    wall_dv_start: wp.array(dtype=f64)
    count: wp.array(dtype=wp.int32)  # PAIRS, GROUPS, WALLS


@wp.struct
class Watch:
    """What proves that no contact is missing from the list (watch.py)."""

    peak: wp.array(dtype=f64)  # per grain, largest p_i^2 of the step so far [m2/s2]
    limit: wp.array(dtype=f64)  # the p_i^2 that its reach allows [m2/s2]
    recent: wp.array(dtype=f64)  # p_i of the last step [m/s]
    reach: wp.array(dtype=f64)  # how far it may stray without meeting an absent contact [m]
    built_position: wp.array(dtype=wp.vec2d)  # when the list was built [m]
    built_velocity: wp.array(dtype=wp.vec2d)  # w_i [m/s]
    frame: wp.array(dtype=wp.vec2d)  # FRAME_VELOCITY [m/s], FRAME_SHIFT [m], MEAN_VELOCITY of the w_i [m/s]
    scalar: wp.array(dtype=f64)  # SLACK, FRAME_REACH, DRIFT, LOOK_DRIFT, INFLUENCE, ELAPSED, HORIZON, SPREAD
    flag: wp.array(dtype=wp.int32)  # WATCHING, LOOK, MISSED, BAD_GRAIN


@wp.struct
class Progress:
    """How far the step is, and what it reports. CPU workers keep their parts of a maximum apart."""

    iterating: wp.array(dtype=wp.int32)  # whether to iterate on
    checking: wp.array(dtype=wp.int32)  # whether the residual is asked for
    accepted: wp.array(dtype=wp.int32)  # whether the attempt solved the step
    zeta: wp.array(dtype=f64)  # by worker, of the iteration under way
    residual: wp.array(dtype=f64)  # by worker
    overlap: wp.array(dtype=f64)  # by worker
    carrying: wp.array(dtype=wp.int32)  # by worker, contacts that carry a correction
    report: wp.array(dtype=f64)  # ACCEPTED, ITERATIONS, ZETA, RESIDUAL, OVERLAP, CARRYING


PAIRS, GROUPS, WALLS = (wp.constant(k) for k in range(3))
FRAME_VELOCITY, FRAME_SHIFT, MEAN_VELOCITY = (wp.constant(k) for k in range(3))
SLACK, FRAME_REACH, DRIFT, LOOK_DRIFT, INFLUENCE, ELAPSED, HORIZON, SPREAD = (
    wp.constant(k) for k in range(8)
)
WATCHING, LOOK, MISSED, BAD_GRAIN = (wp.constant(k) for k in range(4))
ACCEPTED, ITERATIONS, ZETA, RESIDUAL, OVERLAP, CARRYING = (wp.constant(k) for k in range(6))
