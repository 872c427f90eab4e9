"""Time schemes: free velocities, without contacts, and the inverse map (kernels/MODEL.md, "Half steps")."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from warpgrains.base.arrays import FloatArray

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

SCHEMES = ("euler", "leapfrog")


def free_velocity(scene: Scene, velocity: FloatArray, staggered: bool, time: float = 0.0) -> FloatArray:
    """Return the velocities v* [m/s], shape (n, 2), after gravity and drag, before contacts act.

    The step starts at `time` [s]. See eqs. 2, 16 and 17, and `State` for `staggered`.
    """
    dt, gravity, drag = scene.dt, np.array(scene.gravity_at(time)), scene.drag
    mass = scene.mass[:, np.newaxis]
    if scene.scheme == "euler":
        return velocity + dt * (gravity - drag / mass * velocity)
    a = drag * dt / (2.0 * mass)
    kicked = (1.0 - a) * velocity + dt * gravity if staggered else velocity + 0.5 * dt * gravity
    return kicked / (1.0 + a)


def free_spin(scene: Scene, spin: FloatArray, staggered: bool) -> FloatArray:
    """Return the angular velocities after drag, before contacts act, [rad/s], shape (n,) (eq. 21)."""
    dt, drag, inertia = scene.dt, scene.spin_drag, scene.inertia
    if scene.scheme == "euler":
        return spin - dt * (drag / inertia * spin)
    a = drag * dt / (2.0 * inertia)
    return ((1.0 - a) * spin if staggered else spin) / (1.0 + a)


def at_positions(
    scene: Scene, velocity: FloatArray, spin: FloatArray, time: float
) -> tuple[FloatArray, FloatArray]:
    """Advance staggered velocities [m/s], (n, 2), and spins [rad/s] by half a step, to `time` (eq. 17)."""
    a = scene.drag * scene.dt / (2.0 * scene.mass[:, np.newaxis])
    b = scene.spin_drag * scene.dt / (2.0 * scene.inertia)
    return (1.0 - a) * velocity + 0.5 * scene.dt * np.array(scene.gravity_at(time)), (1.0 - b) * spin


def before_positions(
    scene: Scene, velocity: FloatArray, spin: FloatArray, time: float
) -> tuple[FloatArray, FloatArray]:
    """Invert `at_positions`: return staggered velocities [m/s] and spins; inf or NaN if drag dt = 2 m."""
    a = scene.drag * scene.dt / (2.0 * scene.mass[:, np.newaxis])
    b = scene.spin_drag * scene.dt / (2.0 * scene.inertia)
    with np.errstate(divide="ignore", invalid="ignore"):
        return (velocity - 0.5 * scene.dt * np.array(scene.gravity_at(time))) / (1.0 - a), spin / (1.0 - b)


class Kick(NamedTuple):
    """Gravity and drag in a step: m (velocity - before) = m g * time - drag * path + impulses of contacts.

    For spins, velocities are angular velocities, m is the moment of inertia, drag is `spin_drag`, and g is 0.
    """

    before: FloatArray
    """Velocities [m/s], shape (n, 2), or spins [rad/s], shape (n,), at the start of the step."""
    time: float
    """Duration for which gravity acted [s]."""
    path: FloatArray
    """Time integral of the velocity [m] or spin [rad] on which drag acted, shape (n, 2) or (n,)."""


def kick_of(scene: Scene, free: FloatArray, velocity: FloatArray, staggered: bool, time: float) -> Kick:
    """Return the kick of a step from its free velocities and its end velocities [m/s], shape (n, 2).

    `time` [s] is the start of the step. `Kick.before` is the inverse of `free_velocity`. In the leapfrog
    scheme, it is not finite if drag dt = 2 m.
    """
    rate = (scene.drag / scene.mass)[:, np.newaxis]
    return _kick(scene, np.array(scene.gravity_at(time)), rate, free, velocity, staggered)


def spin_kick_of(scene: Scene, free: FloatArray, spin: FloatArray, staggered: bool) -> Kick:
    """Return the kick of a step for spins [rad/s], shape (n,), see `kick_of`."""
    return _kick(scene, np.zeros(()), scene.spin_drag / scene.inertia, free, spin, staggered)


def _kick(
    scene: Scene, gravity: FloatArray, rate: FloatArray, free: FloatArray, now: FloatArray, staggered: bool
) -> Kick:
    """Return the kick of a step from an acceleration and the drag rate, drag / mass [1/s].

    `free` are the velocities or spins before contacts act, `now` those at the end of the step.
    """
    dt = scene.dt
    if scene.scheme == "euler":
        before = (free - dt * gravity) / (1.0 - dt * rate)
        return Kick(before, dt, dt * before)
    a = 0.5 * dt * rate
    if not staggered:
        return Kick((1.0 + a) * free - 0.5 * dt * gravity, 0.5 * dt, 0.5 * dt * now)
    with np.errstate(divide="ignore", invalid="ignore"):
        before = ((1.0 + a) * free - dt * gravity) / (1.0 - a)
    return Kick(before, dt, 0.5 * dt * (before + now))
