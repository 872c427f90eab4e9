"""Forces of contacts, from their corrections (kernels/MODEL.md, eq. 9)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warpgrains.base.arrays import BoolArray, FloatArray, IntArray
from warpgrains.base.described import fields_in_help
from warpgrains.base.tables import Tabular

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.scene.state import Corrections, State

_ROUNDING = 4.0 * np.finfo(np.float64).eps
"""Bound on the relative error of dv_t of a contact that slides.

A visit adds b to dv_t, so that the sum is mu dv (eq. 23). Difference and sum have rounding errors of eps / 2
each. So the error is at most eps / 2 (|b| + mu dv), which is within this bound if |b| <= 7 mu dv."""


@fields_in_help
@dataclass(frozen=True, eq=False)
class PairContacts(Tabular):
    """Contacts between grains that carry a correction after the last step.

    Examples
    --------
    >>> contacts = simulation.contacts()
    >>> contacts.pair.shape, contacts.normal.shape, f"{contacts.force.max():.4f} N"
    ((15, 2), (15, 2), '2.0264 N')
    """

    pair: IntArray
    """Grains i < j, in lexicographic order, shape (m, 2)."""
    normal: FloatArray
    """Unit normals from i to j, shape (m, 2)."""
    gap: FloatArray
    """Gaps at the start of the step [m], shape (m,)."""
    correction: FloatArray
    """Accumulated corrections dv_c [m/s], shape (m,)."""
    force: FloatArray
    """M_i M_j / (M_i + M_j) dv_c / dt, along the normal on j and against it on i [N], shape (m,).

    M are the contact masses of the scene."""
    tangential_force: FloatArray
    """M_i M_j / (M_i + M_j) dv_t / dt, along the tangent on j and against it on i [N], shape (m,).

    The tangent is the normal turned counterclockwise by 90 degrees, (-n_y, n_x). 0 without friction."""
    slides: BoolArray
    """Whether the tangential force is as large as friction allows, shape (m,): True without friction."""


@fields_in_help
@dataclass(frozen=True, eq=False)
class WallContacts(Tabular):
    """Wall contacts that carry a correction after the last step.

    Examples
    --------
    >>> contacts = simulation.wall_contacts()
    >>> contacts.wall.shape, contacts.force.shape, f"{contacts.force.max():.4f} N"
    ((10, 2), (10,), '2.0098 N')
    """

    wall: IntArray
    """Grain of each contact, and index of its wall in `Scene.walls`, shape (m, 2)."""
    normal: FloatArray
    """Unit normals from the grain into the wall, shape (m, 2)."""
    gap: FloatArray
    """Gaps at the start of the step [m], shape (m,)."""
    correction: FloatArray
    """Accumulated corrections [m/s], shape (m,), > 0."""
    force: FloatArray
    """M_i dv / dt, against the normal [N], shape (m,). M are the contact masses of the scene."""
    tangential_force: FloatArray
    """M_i dv_t / dt, against the tangent (-n_y, n_x) on the grain [N], shape (m,); 0 without friction."""
    slides: BoolArray
    """Whether the tangential force is as large as friction allows, shape (m,): True without friction."""


def start_of_step(scene: Scene, state: State) -> tuple[FloatArray, Scene]:
    """Return grains and walls at the start of the last step, for which its contacts were computed.

    Returns
    -------
    Centers of the grains [m], shape (n, 2), and the scene of that step with its driven walls at these
    positions.
    """
    last, walls = scene if state.last_scene is None else state.last_scene, None
    if state.driven is not None:
        way, speed = state.driven.T
        walls = way - last.dt * speed
    return state.position - last.dt * state.velocity, last.placed(walls)


def contacts_of(scene: Scene, state: State) -> tuple[PairContacts, WallContacts]:
    """Return the contacts between grains and with walls that carry a correction after the last step."""
    return contacts_at(*start_of_step(scene, state), state)


def contacts_at(start: FloatArray, scene: Scene, state: State) -> tuple[PairContacts, WallContacts]:
    """Return the contacts that carry a correction after the last step, from the start of this step.

    `start` holds the centers [m], shape (n, 2), and `scene` the walls at that time, see `start_of_step`.
    """
    pairs = pair_contacts(scene, start, state.corrections)
    return pairs, wall_contacts(scene, start, state.corrections, scene.time_after(state.steps - 1))


def pair_contacts(scene: Scene, position: FloatArray, corrections: Corrections) -> PairContacts:
    """Return the pairs that carry these corrections, with forces and gaps.

    `position` holds the centers at the start of the step [m], shape (n, 2).
    """
    i, j = corrections.pair.T
    normal, gap = scene.pair_frames(position, corrections.pair)
    mass = scene.contact_mass
    mass_i, mass_j = mass[i], mass[j]
    mass_c = mass_i * mass_j / (mass_i + mass_j)
    dv, dvt = corrections.pair_correction, _tangential(corrections.pair_friction, corrections.pair_correction)
    return PairContacts(
        pair=corrections.pair,
        normal=normal,
        gap=gap,
        correction=dv,
        force=mass_c * dv / scene.dt,
        tangential_force=mass_c * dvt / scene.dt,
        slides=_slides(scene.friction, dv, dvt),
    )


def wall_contacts(
    scene: Scene, position: FloatArray, corrections: Corrections, time: float = 0.0
) -> WallContacts:
    """Return the wall contacts that carry these corrections, with forces and gaps.

    `position` holds the centers at the start of the step [m], shape (n, 2), and `time` is that of the start
    [s].
    """
    # free=0.0, because these contacts exist; rounding may pick either of two equally near walls at a joint
    normal, gap = scene.wall_frames(position, corrections.wall, time=time, free=0.0)
    mass = scene.contact_mass[corrections.wall[:, 0]]
    dv, dvt = corrections.wall_correction, _tangential(corrections.wall_friction, corrections.wall_correction)
    return WallContacts(
        wall=corrections.wall,
        normal=normal,
        gap=gap,
        correction=dv,
        force=mass * dv / scene.dt,
        tangential_force=mass * dvt / scene.dt,
        slides=_slides(scene.at_walls["friction"][corrections.wall[:, 1]], dv, dvt),
    )


def _tangential(dvt: FloatArray | None, dv: FloatArray) -> FloatArray:
    """Return dvt, or zeros of the shape of dv if dvt is None (no friction) [m/s], shape (m,)."""
    return np.zeros_like(dv) if dvt is None else dvt


def _slides(friction: float | FloatArray, dv: FloatArray, dvt: FloatArray) -> BoolArray:
    """Return a mask of the contacts with |dv_t| = mu dv up to rounding (Coulomb's bound), shape (m,)."""
    slides: BoolArray = np.abs(dvt) >= (1.0 - _ROUNDING) * (friction * dv)
    return slides
