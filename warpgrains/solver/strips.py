"""Lanes: which worker sweeps which pairs, so that workers wait for each other at a border only."""

import numpy as np
import warp as wp

from warpgrains.arrays import FloatArray, IntArray
from warpgrains.kernels import data, lanes
from warpgrains.kernels.variant import Variant
from warpgrains.solver.buffers import ContactBuffers
from warpgrains.solver.launch import Replay

BINS = 4096  # of the coordinate that is cut into strips


def strips(position: FloatArray, pairs: IntArray, count: int) -> IntArray:
    """Cut space into strips, each with grains all over the order of numbers.

    Contacts are swept in the order of their grains' numbers. Where a row of grains is numbered along x,
    strips cut x, so that every worker soon has something to do.

    Parameters
    ----------
    position : FloatArray
        Centres [m], shape (n, 2).
    pairs : IntArray
        Pairs of which each grain is the first, shape (n,).
    count : int
        Strips.

    Returns
    -------
    IntArray
        The strip of every grain, shape (n,).
    """
    number = np.arange(len(position)) - 0.5 * (len(position) - 1)
    spread = position - position.mean(axis=0)
    alike = np.abs(number @ spread) / np.maximum(np.linalg.norm(spread, axis=0), np.finfo(float).tiny)
    x = position[:, np.argmin(alike)]
    weight, edges = np.histogram(x, BINS, weights=pairs)
    share = np.cumsum(weight) / max(weight.sum(), 1.0)
    cuts = edges[np.searchsorted(share, np.arange(1, count) / count)]
    return np.searchsorted(cuts, x, side="right").astype(np.int32)


class Lanes:
    """Deals the pairs of a list out to the workers.

    Parameters
    ----------
    buffers : ContactBuffers
        The list, with its pairs in the common order.
    variant : Variant
        What the scene's kernels are compiled for.
    replay : Replay
        Its workers get the lanes.
    """

    def __init__(self, buffers: ContactBuffers, variant: Variant, replay: Replay):
        self._buffers, self._replay, self._kernels = buffers, replay, lanes.kernels(variant)
        self._grains, workers = buffers.rows.start.shape[0] - 1, replay.launchers
        self._lanes = lanes.Lanes()
        self._lanes.lane = self._empty(self._grains, wp.int32)
        self._lanes.last = self._empty(self._grains, wp.vec2i)
        self._lanes.cursor = self._empty(workers, wp.int32)
        self._lanes.late_cursor = self._empty(workers, wp.int32)
        self._lanes.seen = self._empty(workers**2, wp.int32)
        self._lanes.sequence, self._lanes.turn = self._empty(0, wp.vec3i), self._empty(0, wp.int32)
        buffers.contacts.own_turns = 1
        for name in ("lane_turn", "lane_wall"):
            setattr(buffers.contacts, name, wp.zeros(workers + 1, dtype=wp.int32, device=replay.device))

    def _empty(self, count: int, dtype: type) -> wp.array:
        return wp.empty(count, dtype=dtype, device=self._replay.device)

    def deal(self, position: FloatArray) -> None:
        """Give every pair a new slot in its worker's lane, and cut the lanes into turns.

        Parameters
        ----------
        position : FloatArray
            Centres [m], shape (n, 2).
        """
        buffers, workers = self._buffers, self._replay.launchers
        contacts, found = buffers.contacts, np.diff(buffers.rows.start.numpy())
        self._lanes.lane.assign(strips(position, found, workers))
        if self._lanes.turn.shape[0] != buffers.sequence.shape[0]:
            self._lanes.sequence = buffers.sequence
            self._lanes.turn = self._empty(buffers.sequence.shape[0], wp.int32)
            self._replay.forget()
        self._replay.alone(self._deal)
        needed = buffers.counts[data.GROUPS] * workers
        if needed > contacts.turn_after.shape[0]:
            contacts.turn_after = self._empty(needed + needed // 4, wp.int32)
            self._replay.forget()
        self._replay.alone(self._hold_back)

    def deal_walls(self) -> None:
        """Sort the grains at the walls by lane."""
        contacts = self._buffers.contacts
        walls = slice(self._buffers.counts[data.WALLS])
        listed, dv_start = contacts.walls.numpy()[walls], contacts.wall_dv_start.numpy()[walls]
        lane = self._lanes.lane.numpy()[listed["i"]]
        by_lane = np.argsort(lane, kind="stable")
        listed[:], dv_start[:] = listed[by_lane], dv_start[by_lane]
        contacts.lane_wall.assign(np.searchsorted(lane[by_lane], np.arange(self._replay.launchers + 1)))

    def _deal(self) -> None:
        buffers = self._buffers
        self._replay.each(self._kernels.deal, 1, buffers.contacts, buffers.slot, self._lanes)

    def _hold_back(self) -> None:
        self._replay.each(self._kernels.hold_back, 1, self._buffers.contacts, self._lanes)
