"""Turns of their own for CPU workers, so that they wait for each other at a border and nowhere else.

Every grain belongs to a lane, every worker has a lane, and a pair is swept by the worker of its first grain's
lane. A worker sweeps its pairs in the common order. Where the last pair before c on one of c's grains is
another worker's, a turn of that worker ends with it, and a turn that comes after it begins with c. If that
pair is far behind c, the turn ends only LAG pairs before c in the common order, so that one wait does for
many pairs. The first pair in the common order that is not yet swept never waits, so the workers never block
each other for good.

The lanes decide who sweeps a pair, and not what it finds: no result depends on them.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .data import GROUPS, PAIRS, Contacts
from .stage import kernels_of
from .variant import Variant

LAG = wp.constant(1024)


@wp.struct
class Lanes:
    """What it takes to deal the pairs out."""

    lane: wp.array(dtype=wp.int32)  # of every grain
    sequence: wp.array(dtype=wp.vec3i)  # the pairs in the common order (order.py)
    turn: wp.array(dtype=wp.int32)  # of every slot
    last: wp.array(dtype=wp.vec2i)  # of every grain: the lane of its last pair so far, and the slot after it
    cursor: wp.array(dtype=wp.int32)  # of every lane: its next slot
    late_cursor: wp.array(dtype=wp.int32)  # the same, LAG pairs before
    seen: wp.array(dtype=wp.int32)  # of every lane and other lane: the slot before which it waits already


@cache
def stages(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the stages for one kind of scene."""

    @wp.func
    def begin_walk(lanes: Lanes, pairs: int):
        """Forget what came last on every grain, and find where every lane begins."""
        count = lanes.cursor.shape[0]
        for i in range(lanes.last.shape[0]):
            lanes.last[i] = wp.vec2i(-1, 0)
        for pair_of_lanes in range(count * count):
            lanes.seen[pair_of_lanes] = 0
        for w in range(count):
            lanes.cursor[w] = 0
        for s in range(pairs):
            w = lanes.lane[lanes.sequence[s][0]]
            if w + 1 < count:
                lanes.cursor[w + 1] = lanes.cursor[w + 1] + 1
        for w in range(1, count):
            lanes.cursor[w] = lanes.cursor[w] + lanes.cursor[w - 1]
        for w in range(count):
            lanes.late_cursor[w] = lanes.cursor[w]

    @wp.func
    def wait_of(lanes: Lanes, w: int, i: int):
        """Whom lane w must wait for on grain i, up to which slot of it; or (-1, 0) if it already does."""
        before = lanes.last[i]
        other = before[0]
        if other < 0 or other == w:
            return -1, 0
        place = w * lanes.cursor.shape[0] + other
        if before[1] <= lanes.seen[place]:
            return -1, 0
        end = wp.max(before[1], lanes.late_cursor[other])
        lanes.seen[place] = end
        return other, end

    @wp.func
    def walk_on(lanes: Lanes, s: int):
        """Go on from place s of the common order to the next."""
        pair = lanes.sequence[s]
        w = lanes.lane[pair[0]]
        c = lanes.cursor[w] + 1
        lanes.cursor[w] = c
        lanes.last[pair[0]] = wp.vec2i(w, c)
        lanes.last[pair[1]] = wp.vec2i(w, c)
        if s >= LAG:
            late = lanes.lane[lanes.sequence[s - LAG][0]]
            lanes.late_cursor[late] = lanes.late_cursor[late] + 1

    @wp.func
    def deal(contacts: Contacts, slot: wp.array(dtype=wp.int32), lanes: Lanes):
        """Give every pair its slot, lane by lane, and number the turns."""
        pairs = contacts.count[PAIRS]
        count = lanes.cursor.shape[0]
        begin_walk(lanes, pairs)
        for c in range(pairs):
            lanes.turn[c] = 0
        for w in range(count):
            contacts.lane_turn[w] = lanes.cursor[w]
            if lanes.cursor[w] < pairs:
                lanes.turn[lanes.cursor[w]] = 1
        for s in range(pairs):
            pair = lanes.sequence[s]
            w = lanes.lane[pair[0]]
            c = lanes.cursor[w]
            for k in range(2):
                other, end = wait_of(lanes, w, pair[k])
                if other >= 0:
                    lanes.turn[c] = 1
                    if end < pairs:
                        lanes.turn[end] = 1
            slot[pair[2]] = c
            walk_on(lanes, s)
        number_turns(contacts, lanes)

    @wp.func
    def number_turns(contacts: Contacts, lanes: Lanes):
        """Number the turns from slot to slot, and tell where each, and each lane, begins."""
        pairs = contacts.count[PAIRS]
        count = lanes.cursor.shape[0]
        turns = int(0)
        for c in range(pairs):
            if lanes.turn[c] != 0:
                contacts.group_start[turns] = c
                turns += 1
            lanes.turn[c] = turns - 1
        contacts.group_start[turns] = pairs
        contacts.count[GROUPS] = turns
        for w in range(count):
            begin = contacts.lane_turn[w]
            contacts.lane_turn[w] = turns
            if begin < pairs:
                contacts.lane_turn[w] = lanes.turn[begin]
        contacts.lane_turn[count] = turns

    @wp.func
    def hold_back(contacts: Contacts, lanes: Lanes):
        """Tell after how many turns of each other worker a turn comes."""
        pairs = contacts.count[PAIRS]
        count = lanes.cursor.shape[0]
        for t in range(contacts.count[GROUPS] * count):
            contacts.turn_after[t] = 0
        begin_walk(lanes, pairs)
        for s in range(pairs):
            pair = lanes.sequence[s]
            w = lanes.lane[pair[0]]
            c = lanes.cursor[w]
            for k in range(2):
                other, end = wait_of(lanes, w, pair[k])
                if other >= 0:
                    ended = lanes.turn[end - 1] + 1 - contacts.lane_turn[other]
                    contacts.turn_after[lanes.turn[c] * count + other] = ended
            walk_on(lanes, s)

    return SimpleNamespace(deal=deal, hold_back=hold_back)


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Kernels of the stages that are launched."""
    own = stages(variant)
    return kernels_of(variant.module, own.deal, own.hold_back)
