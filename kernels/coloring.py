"""The order in which contacts are swept, and the independent sets that may be swept in parallel.

Every candidate pair (in lexicographic order, as the neighbor list holds them) is given an independent set.
The sets are swept one after the other; pairs of one set share no grain, so they may be swept in parallel.
Contacts with walls follow, in sets of their own.

- levels: a pair's set is above those of all earlier pairs that share a grain with it. Sweeping by sets gives
  every pair exactly what it would have read in the sequential loop: the same bits.
- colors: first-fit, each pair the lowest set that neither of its grains has yet. Another order, in which
  a few wide sets suffice.

The loops are sequential by nature (each pair depends on earlier ones) and run on one thread, only when the
list has changed.
"""

import warp as wp

from .access import at, lowest_bit, put
from .contact_list import listed_count, pair_end
from .record import Scene, grain_count, is_driven, pair_count
from .types import Ints, NeighborList

MASK_COLORS = wp.constant(64)


@wp.func
def lowest_free(used: wp.uint64) -> int:
    """Return the lowest bit that is not set, or 64."""
    free = ~used
    if free == wp.uint64(0):
        return int(MASK_COLORS)
    return lowest_bit(free)


@wp.func
def levels(rows: NeighborList, next_level: Ints, group: Ints):
    """Give every pair its dependency level, as few as there can be, and contacts with walls none, -1."""
    n = rows.start.shape[0] - 1
    for i in range(n):
        put(next_level, i, 0)
    for i in range(n):
        own = at(next_level, i)  # no later row reads it
        k, end = at(rows.start, i), at(rows.start, i + 1)
        while k < end:
            j = at(rows.neighbor, k)
            level = int(-1)
            if j < n:
                level = wp.max(own, at(next_level, j))
                own = level + 1
                put(next_level, j, own)
            put(group, k, level)
            k += 1


@wp.func
def colors(rows: NeighborList, used: wp.array(dtype=wp.uint64), group: Ints):
    """Color pairs by first-fit, contacts with walls by -1. A pair beyond 64 colors gets one of its own."""
    n = rows.start.shape[0] - 1
    for i in range(n):
        put(used, i, wp.uint64(0))
    extra = int(MASK_COLORS)
    for i in range(n):
        own = at(used, i)  # no later row reads it
        k, end = at(rows.start, i), at(rows.start, i + 1)
        while k < end:
            j, color = at(rows.neighbor, k), int(-1)
            if j < n:
                its = at(used, j)
                color = lowest_free(own | its)
                if color < MASK_COLORS:
                    bit = wp.uint64(1) << wp.uint64(color)
                    own = own | bit
                    put(used, j, its | bit)
                else:
                    color = extra
                    extra += 1
            put(group, k, color)
            k += 1


@wp.func
def place_pairs(s: Scene):
    """Give every pair its index in sweeping order, sorted by set and in lexicographic order within one.

    Where sets are merged, all pairs are one set, because a single thread sweeps them in order anyway.
    """
    listed = listed_count(s)
    start, group, sweep_index = s.contacts.set_start, s.workspace.group, s.workspace.sweep_index
    sets, pairs = int(0), int(0)
    k = int(0)
    while k < listed:
        sets = wp.max(sets, at(group, k) + 1)
        pairs += wp.where(at(group, k) >= 0, 1, 0)
        k += 1
    for g in range(sets + 1):
        put(start, g, 0)
    k = int(0)
    while k < listed:
        g = at(group, k)
        if g >= 0:
            put(start, g + 1, at(start, g + 1) + 1)
        k += 1
    for g in range(sets):
        put(start, g + 1, at(start, g + 1) + at(start, g))
    k = int(0)
    while k < listed:
        g = at(group, k)
        if g >= 0:
            place = at(start, g)
            put(sweep_index, k, place)
            put(start, g, place + 1)
        k += 1
    for g in range(sets):
        put(start, sets - g, at(start, sets - g - 1))
    put(start, 0, 0)
    if s.merge != 0:
        put(start, 1, pairs)
        sets = 1
    s.contacts.count.pairs = pairs
    s.contacts.count.sets = sets


@wp.func
def place_walls(s: Scene):
    """Give every contact with a wall its index, after the pairs, and put them in independent sets.

    The first contact of every grain is in the first set, the second one in the second, and so on. So every
    contact reads the velocities that it would read grain by grain. If a wall is driven, all are in one set,
    in the order of the list: they share the speed of that wall.
    """
    rows, listed, first_set = s.neighbors, listed_count(s), s.contacts.count.sets
    place = pair_count(s)
    sets = int(0)
    if is_driven(s):
        for i in range(grain_count(s)):
            for k_wall in range(pair_end(rows, i), at(rows.start, i + 1)):
                put(s.workspace.sweep_index, k_wall, place)
                place += 1
        put(s.contacts.set_start, first_set + 1, place)
        sets = wp.where(place > pair_count(s), 1, 0)
    else:
        while place < listed:
            for i in range(grain_count(s)):
                k = pair_end(rows, i) + sets
                if k < at(rows.start, i + 1):
                    put(s.workspace.sweep_index, k, place)
                    place += 1
            sets += 1
            put(s.contacts.set_start, first_set + sets, place)
    s.contacts.count.walls = listed - pair_count(s)
    s.contacts.count.wall_sets = sets


@wp.func
def group_pairs(s: Scene):
    """Give every pair its set."""
    if s.by_color != 0:
        colors(s.neighbors, s.workspace.used_colors, s.workspace.group)
    else:
        levels(s.neighbors, s.workspace.next_level, s.workspace.group)
