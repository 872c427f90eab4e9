"""What the contacts carry, in the units of forces (SPEC.md, "What the solver returns besides velocities")."""

import numpy as np

from warpgrains.reports import Corrections, FloatArray, PairContacts, WallContacts
from warpgrains.scene import Scene


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
