"""Walls with a prescribed motion: translation, and rotation about a pivot (eq. 26).

Functions of the kinds of walls do not depend on motion. A grain is transformed to the frame of the wall, in
which the wall is where the scene defines it, and the normal is transformed back.
"""

from math import pi

import warp as wp

from ..types import Motion, MotionOf, Pose, PoseOf

f64 = wp.float64
TURN = wp.constant(f64(2.0 * pi))


@wp.func
def moving_time(motion: Motion, time: f64) -> f64:
    """Return tau of eq. 26: for how long a wall has moved until `time` [s]; 0 before the motion begins."""
    begin = motion[MotionOf.START_TIME]
    return wp.min(wp.max(time, begin), motion[MotionOf.END_TIME]) - begin


@wp.func
def progress(motion: Motion, time: f64) -> f64:
    """Return xi of eq. 26 at a time [s]: the displacement since the start, divided by the velocity [s].

    An oscillation may make it < 0.
    """
    moved, rate = moving_time(motion, time), TURN * motion[MotionOf.FREQUENCY]
    if rate > f64(0.0):
        phase = motion[MotionOf.PHASE]
        return (wp.sin(rate * moved + phase) - wp.sin(phase)) / rate
    return moved


@wp.func
def share_of_step(motion: Motion, begin: f64, end: f64) -> f64:
    """Return f of eq. 26b: mean velocity from time begin to time end [s], divided by that of the motion."""
    if motion[MotionOf.FREQUENCY] > f64(0.0):
        return (progress(motion, end) - progress(motion, begin)) / (end - begin)
    moved = wp.min(end, motion[MotionOf.END_TIME]) - wp.max(begin, motion[MotionOf.START_TIME])
    return wp.max(f64(0.0), moved) / (end - begin)


@wp.func
def pose_at(motion: Motion, begin: f64, end: f64, dt: f64) -> Pose:
    """Return the `Pose` of a wall: its place at time begin [s], and its motion from then to time end.

    dt = end - begin is the time step [s], without the rounding of the two times.
    """
    px, py, w = motion[MotionOf.PIVOT_X], motion[MotionOf.PIVOT_Y], motion[MotionOf.ANGULAR_VELOCITY]
    vx, vy = motion[MotionOf.VELOCITY_X], motion[MotionOf.VELOCITY_Y]
    moved, share = progress(motion, begin), share_of_step(motion, begin, end)
    x, y = px + vx * moved, py + vy * moved
    c, s, along, across = f64(1.0), f64(0.0), f64(0.0), f64(0.0)
    if w != f64(0.0):
        c, s = wp.cos(w * moved), wp.sin(w * moved)
        turn = w * (share * dt)
        half = wp.sin(f64(0.5) * turn)
        along, across = f64(-2.0) * (half * half) / dt, wp.sin(turn) / dt
    pose = Pose()
    pose[PoseOf.COSINE] = c
    pose[PoseOf.SINE] = s
    pose[PoseOf.SHIFT_X] = x - (c * px - s * py)
    pose[PoseOf.SHIFT_Y] = y - (s * px + c * py)
    pose[PoseOf.VELOCITY_X] = vx * share - (along * x - across * y)
    pose[PoseOf.VELOCITY_Y] = vy * share - (across * x + along * y)
    pose[PoseOf.ALONG] = along
    pose[PoseOf.ACROSS] = across
    pose[PoseOf.ANGULAR_VELOCITY] = w * share
    return pose


@wp.func
def to_frame(pose: Pose, x: wp.vec2d) -> wp.vec2d:
    """Return a point x, transformed to the frame of a wall [m]."""
    c, s = pose[PoseOf.COSINE], pose[PoseOf.SINE]
    dx, dy = x[0] - pose[PoseOf.SHIFT_X], x[1] - pose[PoseOf.SHIFT_Y]
    return wp.vec2d(c * dx + s * dy, c * dy - s * dx)


@wp.func
def from_frame(pose: Pose, n: wp.vec2d) -> wp.vec2d:
    """Return a direction n, transformed from the frame of a wall."""
    c, s = pose[PoseOf.COSINE], pose[PoseOf.SINE]
    return wp.vec2d(c * n[0] - s * n[1], s * n[0] + c * n[1])


@wp.func
def velocity_at(pose: Pose, x: wp.vec2d) -> wp.vec2d:
    """Return the mean velocity in the step [m/s] of a wall's point that is at x when the step begins."""
    along, across = pose[PoseOf.ALONG], pose[PoseOf.ACROSS]
    return wp.vec2d(
        pose[PoseOf.VELOCITY_X] + (along * x[0] - across * x[1]),
        pose[PoseOf.VELOCITY_Y] + (across * x[0] + along * x[1]),
    )
