"""Walls that move as given in advance: translation, and rotation about a pivot (eq. 26).

Kinds of walls know nothing of it: a grain is put into the frame in which the wall is as the scene gives it,
and the normal that is found there is turned back.
"""

import warp as wp

from .types import Motion, MotionOf, Pose, PoseOf

f64 = wp.float64


@wp.func
def moving_time(motion: Motion, time: f64) -> f64:
    """Return for how long a wall has moved at a time [s]."""
    begin = motion[MotionOf.FROM_TIME]
    return wp.min(wp.max(time, begin), motion[MotionOf.TO_TIME]) - begin


@wp.func
def pose_at(motion: Motion, begin: f64, end: f64) -> Pose:
    """Return the pose of a wall at the end of a step from time begin to time end [s].

    It has a velocity if it moves for more than half of the step.
    """
    px, py, w = motion[MotionOf.PIVOT_X], motion[MotionOf.PIVOT_Y], motion[MotionOf.ANGULAR_VELOCITY]
    vx, vy = motion[MotionOf.VELOCITY_X], motion[MotionOf.VELOCITY_Y]
    moved, before = moving_time(motion, end), moving_time(motion, begin)
    c, s = wp.cos(w * moved), wp.sin(w * moved)
    pose = Pose()
    pose[PoseOf.COSINE] = c
    pose[PoseOf.SINE] = s
    pose[PoseOf.SHIFT_X] = px - (c * px - s * py) + vx * moved
    pose[PoseOf.SHIFT_Y] = py - (s * px + c * py) + vy * moved
    if moved - before > f64(0.5) * (end - begin):
        pose[PoseOf.VELOCITY_X] = vx + w * (py + vy * moved)
        pose[PoseOf.VELOCITY_Y] = vy - w * (px + vx * moved)
        pose[PoseOf.ANGULAR_VELOCITY] = w
    return pose


@wp.func
def to_frame(pose: Pose, x: wp.vec2d) -> wp.vec2d:
    """Return a point in the frame of a wall [m]."""
    c, s = pose[PoseOf.COSINE], pose[PoseOf.SINE]
    dx, dy = x[0] - pose[PoseOf.SHIFT_X], x[1] - pose[PoseOf.SHIFT_Y]
    return wp.vec2d(c * dx + s * dy, c * dy - s * dx)


@wp.func
def from_frame(pose: Pose, n: wp.vec2d) -> wp.vec2d:
    """Return a direction that is given in the frame of a wall."""
    c, s = pose[PoseOf.COSINE], pose[PoseOf.SINE]
    return wp.vec2d(c * n[0] - s * n[1], s * n[0] + c * n[1])


@wp.func
def velocity_at(pose: Pose, x: wp.vec2d) -> wp.vec2d:
    """Return the velocity of a wall at a point x of it [m/s]."""
    w = pose[PoseOf.ANGULAR_VELOCITY]
    return wp.vec2d(pose[PoseOf.VELOCITY_X] - w * x[1], pose[PoseOf.VELOCITY_Y] + w * x[0])
