"""What the contacts carry, in the units of forces (SPEC.md, "What the solver returns besides velocities")."""

from dataclasses import dataclass

import numpy as np

from warpgrains.arrays import FloatArray, IntArray
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import Corrections


@dataclass(frozen=True, eq=False)
class PairContacts:
    """Contacts between grains during the last step: the pairs that carry a correction.

    Attributes
    ----------
    pair : ndarray
        Grains i < j, in lexicographic order, shape (m, 2).
    normal : ndarray
        Unit normals from i to j, shape (m, 2).
    gap : ndarray
        Free distances at the start of the step [m], shape (m,).
    correction : ndarray
        Accumulated corrections dv_c [m/s], shape (m,).
    force : ndarray
        m_i m_j / (m_i + m_j) dv_c / dt, along the normal on j and against it on i [N], shape (m,).
    """

    pair: IntArray
    normal: FloatArray
    gap: FloatArray
    correction: FloatArray
    force: FloatArray


@dataclass(frozen=True, eq=False)
class WallContacts:
    """Contacts with the walls during the last step, one entry a grain.

    Attributes
    ----------
    correction : ndarray
        Accumulated corrections dv_b [m/s], shape (n,): > 0 at the outer wall, < 0 at the inner one.
    force : ndarray
        m_i dv_b / dt, towards the origin [N], shape (n,).
    """

    correction: FloatArray
    force: FloatArray


def pair_contacts(scene: Scene, position: FloatArray, corrections: Corrections) -> PairContacts:
    """Return the contacts between grains.

    Parameters
    ----------
    scene : Scene
    position : ndarray
        Centres when the contacts were taken [m], shape (n, 2).
    corrections : Corrections
    """
    i, j = corrections.pair.T
    d = position[j] - position[i]
    distance = np.sqrt(d[:, 0] * d[:, 0] + d[:, 1] * d[:, 1])
    mass_i, mass_j = scene.mass[i], scene.mass[j]
    return PairContacts(
        pair=corrections.pair,
        normal=d / distance[:, None],
        gap=distance - (scene.radius[i] + scene.radius[j]),
        correction=corrections.pair_correction,
        force=mass_i * mass_j / (mass_i + mass_j) * corrections.pair_correction / scene.dt,
    )


def wall_contacts(scene: Scene, corrections: Corrections) -> WallContacts:
    """Return the contacts with the walls, one entry a grain."""
    force = scene.mass * corrections.wall_correction / scene.dt
    return WallContacts(correction=corrections.wall_correction, force=force)
