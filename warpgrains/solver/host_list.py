"""A list of contacts as NumPy arrays: what the host reads of it, and writes to it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from warpgrains.arrays import FloatArray, IntArray
from warpgrains.scene.state import Corrections


@dataclass(frozen=True)
class HostList:
    """Arrays of a list of contacts, views of those of the device or copies.

    Attributes
    ----------
    start, neighbor, old_start, old_neighbor : ndarray
        The listed pairs by first grain, and those of the list before (`kernels.detect.Rows`).
    slot : ndarray
        Place of every pair in sweeping order.
    pair_dv, pair_dv_start, walls, wall_dv_start, count : ndarray
        As in `kernels.data.Contacts`, in sweeping order.
    old_pair_dv : ndarray
        Corrections of the pairs of the list before [m/s].
    """

    start: IntArray
    neighbor: IntArray
    old_start: IntArray
    old_neighbor: IntArray
    slot: IntArray
    pair_dv: FloatArray
    pair_dv_start: FloatArray
    walls: np.ndarray[Any, Any]
    wall_dv_start: FloatArray
    count: IntArray
    old_pair_dv: FloatArray

    @property
    def grains(self) -> int:
        """How many grains there are."""
        return len(self.start) - 1

    def listed_pairs(self) -> IntArray:
        """Return the listed pairs in lexicographic order, shape (m, 2)."""
        first = np.repeat(np.arange(self.grains, dtype=np.int32), np.diff(self.start))
        return np.stack([first, self.neighbor[: len(first)]], axis=1)

    def listed_walls(self) -> IntArray:
        """Return the grains that are listed at the walls, in ascending order."""
        return np.sort(self.walls["i"][: self.count[2]])

    def corrections(self) -> Corrections:
        """Return what the contacts carry after the last good step."""
        pairs, _, walls = self.count
        dv = self.pair_dv[self.slot[:pairs]]
        carrying = dv != 0.0
        wall_correction = np.zeros(self.grains)
        wall_correction[self.walls["i"][:walls]] = self.walls["dv"][:walls]
        return Corrections(self.listed_pairs()[carrying], dv[carrying], wall_correction)

    def load(self, pair: IntArray, wall: IntArray, corrections: Corrections) -> None:
        """List pairs, in lexicographic order, and walls, as of before they were put in sweeping order."""
        dv = np.zeros(len(pair))
        key = np.array([self.grains, 1])
        dv[np.searchsorted(pair @ key, corrections.pair @ key)] = corrections.pair_correction
        self.start[:] = self.old_start[:] = np.searchsorted(pair[:, 0], np.arange(self.grains + 1))
        self.neighbor[: len(pair)] = self.old_neighbor[: len(pair)] = pair[:, 1]
        self.slot[: len(pair)] = np.arange(len(pair))
        self.pair_dv[: len(pair)] = self.pair_dv_start[: len(pair)] = dv
        self.old_pair_dv[: len(pair)] = dv
        self.walls["i"][: len(wall)] = wall
        self.walls["dv"][: len(wall)] = corrections.wall_correction[wall]
        self.wall_dv_start[: len(wall)] = corrections.wall_correction[wall]
        self.count[:] = len(pair), 0, len(wall)

    def revert(self) -> None:
        """Take back what an unfinished step did to the corrections."""
        pairs, _, walls = self.count
        self.pair_dv[:pairs] = self.pair_dv_start[:pairs]
        self.walls["dv"][:walls] = self.wall_dv_start[:walls]
