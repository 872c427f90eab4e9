"""A scene's list of contacts as the host reads and writes it."""

from typing import Any

import numpy as np

from warpgrains.arrays import IntArray
from warpgrains.scene.state import Corrections
from warpgrains.solver.records import SceneRecords


class ContactList:
    """The listed contacts of one scene.

    Parameters
    ----------
    records : SceneRecords
    k : int
        The scene.
    """

    def __init__(self, records: SceneRecords, k: int):
        self._records, self._k = records, k
        self._count = records.host["contacts"]["count"]

    def _array(self, name: str) -> np.ndarray[Any, Any]:
        return self._records.array(self._k, name)

    @property
    def pairs(self) -> int:
        """How many pairs are listed."""
        return int(self._count["pairs"][self._k])

    @property
    def walls(self) -> int:
        """How many grains are listed at the walls."""
        return int(self._count["walls"][self._k])

    def listed_pairs(self) -> IntArray:
        """Return the listed pairs in lexicographic order, shape (m, 2)."""
        start = self._array("neighbors.start")
        first = np.repeat(np.arange(len(start) - 1, dtype=np.int32), np.diff(start))
        return np.stack([first, self._array("neighbors.neighbor")[: len(first)]], axis=1)

    def listed_walls(self) -> IntArray:
        """Return the grains that are listed at the walls, in ascending order."""
        return np.sort(self._array("contacts.walls")["i"][: self.walls])

    def corrections(self) -> Corrections:
        """Return what the contacts carry after the last good step."""
        dv = self._array("contacts.pair_dv")[self._array("workspace.sweep_index")[: self.pairs]]
        active = dv != 0.0
        wall_correction = np.zeros(len(self._array("grains.radius")))
        walls = self._array("contacts.walls")[: self.walls]
        wall_correction[walls["i"]] = walls["dv"]
        return Corrections(self.listed_pairs()[active], dv[active], wall_correction)

    def load(self, pair: IntArray, wall: IntArray, corrections: Corrections) -> None:
        """List pairs, in lexicographic order, and walls, as of before they were put in sweeping order."""
        self._records.make_room(self._k, len(pair))
        dv, n = np.zeros(len(pair)), len(self._array("grains.radius"))
        key = np.array([n, 1])
        dv[np.searchsorted(pair @ key, corrections.pair @ key)] = corrections.pair_correction
        for rows in ("neighbors", "workspace.old"):
            self._array(f"{rows}.start")[:] = np.searchsorted(pair[:, 0], np.arange(n + 1))
            self._array(f"{rows}.neighbor")[: len(pair)] = pair[:, 1]
        for name in ("contacts.pair_dv", "contacts.pair_dv_start", "workspace.old_pair_dv"):
            self._array(name)[: len(pair)] = dv
        self._array("workspace.sweep_index")[: len(pair)] = np.arange(len(pair))
        walls = self._array("contacts.walls")[: len(wall)]
        walls["i"], walls["dv"] = wall, corrections.wall_correction[wall]
        self._array("contacts.wall_dv_start")[: len(wall)] = walls["dv"]
        self._array("strips.first_segment")[:] = 0
        self._array("strips.first_wall")[1:] = len(wall)  # the first thread has them all
        self._count[self._k] = len(pair), 0, len(wall)

    def revert(self) -> None:
        """Take back what an unfinished step did to the corrections."""
        self._array("contacts.pair_dv")[: self.pairs] = self._array("contacts.pair_dv_start")[: self.pairs]
        walls = self._array("contacts.walls")[: self.walls]
        walls["dv"] = self._array("contacts.wall_dv_start")[: self.walls]
