"""What grains carry at the circles of an annulus, by grain: > 0 at the outer one, < 0 at the inner one."""

from typing import NamedTuple

import numpy as np

from warpgrains import Simulation
from warpgrains.arrays import FloatArray, IntArray
from warpgrains.scene.walls import INNER


class AtAnnulus(NamedTuple):
    """By grain, shape (n,)."""

    correction: FloatArray
    force: FloatArray


def by_grain(wall: IntArray, values: FloatArray, n: int) -> FloatArray:
    """Return values of contacts with walls by grain, shape (n,)."""
    every = np.zeros(n)
    every[wall[:, 0]] = np.where(wall[:, 1] == INNER, -values, values)
    return every


def at_annulus(simulation: Simulation) -> AtAnnulus:
    """Return what the grains of a simulation carried during the last step."""
    contacts, n = simulation.wall_contacts(), simulation.scene.n
    return AtAnnulus(
        *(by_grain(contacts.wall, values, n) for values in (contacts.correction, contacts.force))
    )
