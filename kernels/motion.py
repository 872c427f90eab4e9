"""Walls inside the annulus that move as given in advance: translation, and rotation about a pivot (eq. 26).

Kinds of walls know nothing of it: a grain is put into the frame in which the wall is as the scene gives it,
and the normal that is found there is turned back.
"""

import warp as wp

from .types import Motion, Pose

f64 = wp.float64


@wp.func
def moving_time(motion: Motion, time: f64) -> f64:
    """Return for how long a wall has moved at a time [s]."""
    return wp.min(wp.max(time, motion[5]), motion[6]) - motion[5]


@wp.func
def pose_at(motion: Motion, begin: f64, end: f64) -> Pose:
    """Return the pose of a wall at the end of a step from time begin to time end [s].

    It has a velocity if it moves for more than half of the step.
    """
    px, py, vx, vy, w = motion[0], motion[1], motion[2], motion[3], motion[4]
    moved, before = moving_time(motion, end), moving_time(motion, begin)
    c, s = wp.cos(w * moved), wp.sin(w * moved)
    pose = Pose()
    pose[0] = c
    pose[1] = s
    pose[2] = px - (c * px - s * py) + vx * moved
    pose[3] = py - (s * px + c * py) + vy * moved
    if moved - before > f64(0.5) * (end - begin):
        pose[4] = vx + w * (py + vy * moved)
        pose[5] = vy - w * (px + vx * moved)
        pose[6] = w
    return pose


@wp.func
def to_frame(pose: Pose, x: wp.vec2d) -> wp.vec2d:
    """Return a point in the frame of a wall [m]."""
    c, s, dx, dy = pose[0], pose[1], x[0] - pose[2], x[1] - pose[3]
    return wp.vec2d(c * dx + s * dy, c * dy - s * dx)


@wp.func
def from_frame(pose: Pose, n: wp.vec2d) -> wp.vec2d:
    """Return a direction that is given in the frame of a wall."""
    c, s = pose[0], pose[1]
    return wp.vec2d(c * n[0] - s * n[1], s * n[0] + c * n[1])


@wp.func
def speed_of_surface(pose: Pose, x: wp.vec2d, n: wp.vec2d) -> f64:
    """Return the velocity of a wall at a point x of it, along the tangent of a normal n [m/s]."""
    u, v = pose[4] - pose[6] * x[1], pose[5] + pose[6] * x[0]
    return n[0] * v - n[1] * u
