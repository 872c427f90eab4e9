"""Loads of the grains in a frame: pressure, and mobilized friction, the share of Coulomb's bound in use."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.drawing.frames import Frame

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.forces import PairContacts, WallContacts


def pressure(frame: Frame, radius: FloatArray) -> FloatArray:
    """Return the sum of the forces on each grain divided by its circumference [N/m], shape (n,).

    It is the mean of the two principal stresses that the contacts exert on the disc.
    """
    contacts, wall_contacts = frame.forces()
    grain = np.concatenate([*contacts.pair.T, wall_contacts.wall[:, 0]])
    force = np.concatenate([contacts.force, contacts.force, wall_contacts.force])
    total = np.bincount(grain, force, len(radius)).astype(np.float64)  # integers without contacts
    return total / (2.0 * np.pi * radius)


def mobilized(scene: Scene, contacts: PairContacts, wall_contacts: WallContacts) -> FloatArray:
    """Return the largest |tangential force| / (friction * normal force) of each grain's contacts, shape (n,).

    It is 1 where a contact slides; contacts without friction are left out, and 0 stands for no contacts.
    """
    found, (i, j) = np.zeros(scene.n), contacts.pair.T
    between = _share(contacts, scene.friction)
    at_wall = _share(wall_contacts, np.array(scene.wall_frictions)[wall_contacts.wall[:, 1]])
    for grain, share in ((i, between), (j, between), (wall_contacts.wall[:, 0], at_wall)):
        np.maximum.at(found, grain, share)
    return found


def _share(contacts: PairContacts | WallContacts, friction: float | FloatArray) -> FloatArray:
    """Return |tangential force| over what friction allows, of each contact, shape (m,)."""
    most = friction * contacts.force
    return np.divide(np.abs(contacts.tangential_force), most, out=np.zeros_like(most), where=most > 0.0)
