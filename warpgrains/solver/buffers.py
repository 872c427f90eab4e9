"""The buffers behind a list of contacts: counted first, grown, and read and written by the host."""

import numpy as np
import warp as wp

from warpgrains.arrays import IntArray
from warpgrains.kernels.data import Contacts, Pair, Wall
from warpgrains.kernels.detect import Rows
from warpgrains.kernels.momentum import Momentum
from warpgrains.kernels.variant import Variant
from warpgrains.scene.state import Corrections
from warpgrains.solver.host_list import HostList
from warpgrains.solver.launch import Replay, reader
from warpgrains.solver.memory import require_memory


class ContactBuffers:
    """Contacts in sweeping order, and the same pairs in lexicographic order.

    Parameters
    ----------
    grains : int
    variant : Variant
        What the scene's kernels are compiled for.
    momentum : Momentum
        What the accelerated method keeps of every pair grows with the list.
    replay : Replay
        Forgets its graphs when buffers have grown.

    Attributes
    ----------
    contacts : Contacts
        In sweeping order.
    rows, old_rows : Rows
        The listed pairs by first grain, and those of the list before.
    slot, group : array of int
        Place of every pair in sweeping order, and the group that it is swept with.
    sequence : array of vec3i
        The pairs in sweeping order, see `order.line_up`.
    old_pair_dv, wall_dv : array of float
        Corrections of the pairs of the list before, and by grain those of the walls [m/s].
    """

    def __init__(self, grains: int, variant: Variant, momentum: Momentum, replay: Replay):
        self._grains, self._replay, self._capacity = grains, replay, 0
        self.rows, self.old_rows = self._empty_rows(), self._empty_rows()
        self.contacts = contacts = Contacts()
        contacts.pairs = self._zeros(0, Pair)
        contacts.pair_dv = self._zeros(0, wp.float64)
        contacts.weights = self._zeros(0, wp.vec2d)
        contacts.pair_dv_start = self._zeros(0, wp.float64)
        contacts.group_start = self._zeros(2, wp.int32)
        contacts.own_turns = 0
        for name in ("lane_turn", "turn_after", "lane_wall"):
            setattr(contacts, name, self._zeros(0, wp.int32))
        contacts.walls = self._zeros(grains, Wall)
        contacts.wall_dv_start = self._zeros(grains, wp.float64)
        contacts.count = self._zeros(3, wp.int32)
        self._read_count = reader(contacts.count)
        self.slot, self.group = self._zeros(0, wp.int32), self._zeros(0, wp.int32)
        self.sequence = self._zeros(0, wp.vec3i)
        self.old_pair_dv, self.wall_dv = self._zeros(0, wp.float64), self._zeros(grains, wp.float64)
        self._growing = [
            (contacts, "pairs"),
            (contacts, "pair_dv"),
            (contacts, "pair_dv_start"),
            (contacts, "group_start"),
            (self.rows, "found"),
            (self.rows, "neighbor"),
            (self.old_rows, "neighbor"),
            (self, "old_pair_dv"),
            (self, "slot"),
            (self, "group"),
            (self, "sequence"),
        ]
        if variant.distinct_masses:
            self._growing.append((contacts, "weights"))
        if variant.accelerated:
            self._growing += [(momentum, "pair_last"), (momentum, "pair_part")]

    def _zeros(self, count: int, dtype: type) -> wp.array:
        return wp.zeros(count, dtype=dtype, device=self._replay.device)

    def _empty_rows(self) -> Rows:
        rows = Rows()
        rows.start, rows.cursor = (
            self._zeros(self._grains + 1, wp.int32),
            self._zeros(self._grains + 1, wp.int32),
        )
        rows.neighbor, rows.found = self._zeros(0, wp.int32), self._zeros(0, wp.vec2i)
        rows.total = self._zeros(1, wp.int32)
        return rows

    @property
    def counts(self) -> tuple[int, int, int]:
        """Listed pairs, groups that they are swept in, and listed grains at the walls."""
        pairs, groups, walls = self._read_count().tolist()
        return pairs, groups, walls

    def reserve(self, pairs: int) -> bool:
        """Make room for so many pairs, keeping what the buffers hold. Returns whether they have grown."""
        if pairs <= self._capacity:
            return False
        capacity = pairs + pairs // 4
        require_memory(0, capacity, self._replay.device)
        self._capacity = capacity
        for owner, name in self._growing:
            old = getattr(owner, name)
            new = self._zeros(self._capacity + 2, old.dtype)
            if old.shape[0] > 0:
                wp.copy(new, old, count=old.shape[0])
            setattr(owner, name, new)
        self._replay.forget()
        return True

    def host(self) -> HostList:
        """Return the list as the host sees it: on a CPU the arrays themselves, elsewhere copies."""
        return HostList(**{name: array.numpy() for name, array in self._listed().items()})

    def _listed(self) -> dict[str, wp.array]:
        contacts = self.contacts
        return {
            "start": self.rows.start,
            "neighbor": self.rows.neighbor,
            "old_start": self.old_rows.start,
            "old_neighbor": self.old_rows.neighbor,
            "slot": self.slot,
            "pair_dv": contacts.pair_dv,
            "pair_dv_start": contacts.pair_dv_start,
            "walls": contacts.walls,
            "wall_dv_start": contacts.wall_dv_start,
            "count": contacts.count,
            "old_pair_dv": self.old_pair_dv,
        }

    def _write(self, host: HostList) -> None:
        """Take over what the host has written."""
        for name, array in self._listed().items():
            array.assign(getattr(host, name))

    def load(self, pair: IntArray, wall: IntArray, corrections: Corrections) -> None:
        """List pairs, in lexicographic order, and walls, as of before they were put in sweeping order."""
        self.reserve(len(pair))
        host = self.host()
        host.load(pair, wall, corrections)
        self._write(host)
        self.contacts.lane_turn.zero_()
        lane_wall = np.full(self.contacts.lane_wall.shape, len(wall))  # the first worker takes them all
        lane_wall[:1] = 0
        self.contacts.lane_wall.assign(lane_wall)

    def revert(self) -> None:
        """Take back what an unfinished step did to the corrections."""
        host = self.host()
        host.revert()
        self._write(host)
