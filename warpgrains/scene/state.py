"""States: all that the steps after them depend on."""

from dataclasses import dataclass
from typing import ClassVar

from warpgrains.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Corrections:
    """Accumulated corrections: all that the warm start of the next step needs.

    Attributes
    ----------
    pair : ndarray
        Grains i < j of the pairs that carry a correction, in lexicographic order, shape (m, 2).
    pair_correction : ndarray
        Their corrections dv_c [m/s], shape (m,).
    wall_correction : ndarray
        Wall corrections dv_b of all grains [m/s], shape (n,).
    """

    pair: IntArray
    pair_correction: FloatArray
    wall_correction: FloatArray


@dataclass(frozen=True, eq=False)
class Lists:
    """What is listed as a candidate contact, and what the watch has seen of it (kernels/watch.py).

    Colors depend on what is listed, so a run in color order continues with the same bits only from these.

    Attributes
    ----------
    pair, wall : ndarray
        Listed pairs i < j in lexicographic order, shape (m, 2), and listed grains at the walls, shape (k,).
    reach, recent, built_position, built_velocity, frame, scalar : ndarray
        As in `kernels.data.Watch`.
    """

    WATCHED: ClassVar = ("reach", "recent", "built_position", "built_velocity", "frame", "scalar")

    pair: IntArray
    wall: IntArray
    reach: FloatArray
    recent: FloatArray
    built_position: FloatArray
    built_velocity: FloatArray
    frame: FloatArray
    scalar: FloatArray


@dataclass(frozen=True, eq=False)
class State:
    """The exact state between two steps: all that the following steps depend on.

    Attributes
    ----------
    steps : int
        Steps done since the start.
    position, velocity : ndarray
        [m] and [m/s], shape (n, 2).
    corrections : Corrections
        What the contacts carry.
    lists : Lists or None
        What was listed; without it, a run in color order continues with an order of its own.
    """

    steps: int
    position: FloatArray
    velocity: FloatArray
    corrections: Corrections
    lists: Lists | None = None
