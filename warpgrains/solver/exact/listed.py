"""The listed contacts of a scene in memory, also as constraints of a step that waits for the host."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warpgrains.base.arrays import FloatArray, IntArray
from warpgrains.solver.exact.constraints import StepConstraints

if TYPE_CHECKING:
    from warpgrains.solver.records import SceneRecords


def listed_pairs(records: SceneRecords, k: int) -> tuple[IntArray, IntArray]:
    """Return the listed pairs i < j in lexicographic order, shape (m, 2), and their indices, shape (m,).

    The indices are those in arrays by contact, such as "contacts.dv.now", which are in the order of sweeps.
    """
    body, index = listed(records, k)
    is_pair = body[:, 1] < records.scenes[k].n
    return body[is_pair], index[is_pair]


def listed_walls(records: SceneRecords, k: int) -> tuple[IntArray, IntArray]:
    """Return (grain, wall body) of the listed wall contacts, shape (m, 2), and their indices, shape (m,).

    Order and indices are as in `listed_pairs`. Wall bodies are numbered as in kernels/walls/walls.py: body 0
    is the annulus.
    """
    (body, index), n = listed(records, k), records.scenes[k].n
    is_wall = body[:, 1] >= n
    return body[is_wall] - np.array([0, n], np.int32), index[is_wall]


def listed(records: SceneRecords, k: int) -> tuple[IntArray, IntArray]:
    """Return (grain, second body) of all listed contacts in lexicographic order, shape (m, 2), and indices.

    The indices, shape (m,), are as in `listed_pairs`. The second body is a grain, or n plus the number of a
    wall body.
    """
    rows = np.diff(records.array(k, "neighbors.start"))
    first = np.repeat(np.arange(len(rows), dtype=np.int32), rows)
    body = np.stack([first, records.array(k, "neighbors.neighbor")[: len(first)]], axis=1)
    return body, records.array(k, "neighbors.sweep_index")[: len(first)]


class ListedContacts:
    """The listed contacts of scene k: pairs in lexicographic order, then wall contacts ordered by wall.

    Attributes
    ----------
    constraints : StepConstraints
        Constraints of these contacts, in this order, with the gaps at the start of the step.
    """

    def __init__(self, records: SceneRecords, k: int):
        (pair, self._at_pair), (listed, index) = listed_pairs(records, k), listed_walls(records, k)
        self._records, self._k, scene = records, k, records.scenes[k]
        if scene.has_driven_walls:
            coordinates = records.array(k, "grains.position")[scene.n :, 0]
            scene = scene.placed(coordinates[scene.bodies.of_walls])
        bodies = scene.bodies
        number, at = np.nonzero(bodies.of_walls[:, np.newaxis] == listed[:, 1])
        self._at_wall = index[at]
        wall = np.stack([listed[at, 0], number], axis=1)
        self._sign = bodies.sign(wall[:, 1])
        time = scene.time_after(int(records.host["steps"][k]))
        start = records.array(k, "grains.position"), records.array(k, "grains.velocity")
        self.constraints = StepConstraints.at(scene, start, pair, wall, time)

    def read(self, name: str) -> FloatArray:
        """Return the corrections `name`, "dv", "dvt" or "dvr" [m/s], shape (m,).

        Both circles of the annulus share one correction. It is < 0 for the circle that does not carry it.
        """
        own = self._records.array(self._k, f"contacts.{name}.now")
        return np.concatenate([own[self._at_pair], self._sign * own[self._at_wall]])

    def write(self, name: str, correction: FloatArray) -> None:
        """Write the corrections `name`, "dv", "dvt" or "dvr" [m/s], shape (m,).

        Both circles of the annulus share one stored correction: that of the outer circle minus that of the
        inner one.
        """
        own = self._records.array(self._k, f"contacts.{name}.now")
        pairs, walls = np.split(correction, [len(self._at_pair)])
        own[self._at_pair] = pairs
        own[self._at_wall] = 0.0
        np.add.at(own, self._at_wall, self._sign * walls)
