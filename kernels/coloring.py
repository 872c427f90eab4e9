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
def renumber_extra_colors(s: Scene) -> int:
    """Renumber the kept colors above 64 without gaps, in their order. Returns the first free one.

    Each belongs to one pair, and with gaps they would grow from list to list. Without, there are never more
    sets than the largest list so far has contacts, for which `set_start` has capacity. A color that is given
    belongs to a list with at least as many other pairs: those of lower colors that keep it from these. A
    color that is kept was given in an earlier list, and renumbering only lowers it.
    """
    listed, color, rank = listed_count(s), s.workspace.color, s.workspace.color_rank
    old_listed = at(s.workspace.old.start, grain_count(s))
    k = int(0)
    while k < old_listed:
        put(rank, k, 0)
        k += 1
    k = int(0)
    while k < listed:
        if at(color, k) >= MASK_COLORS:
            put(rank, at(color, k) - MASK_COLORS, 1)
        k += 1
    extra = int(MASK_COLORS)
    k = int(0)
    while k < old_listed:
        kept = at(rank, k)
        put(rank, k, extra)
        extra += kept
        k += 1
    k = int(0)
    while k < listed:
        if at(color, k) >= MASK_COLORS:
            put(color, k, at(rank, at(color, k) - MASK_COLORS))
        k += 1
    return extra


@wp.func
def keep_colors(s: Scene) -> int:
    """Copy the colors of pairs of the old list; other contacts get -1. Returns the first extra color."""
    rows, used, color, n = s.neighbors, s.workspace.used_colors, s.workspace.color, grain_count(s)
    extra = int(0)
    for i in range(n):
        own = at(used, i)
        k, end = at(rows.start, i), at(rows.start, i + 1)
        while k < end:
            kept = int(-1)
            j, k_old = at(rows.neighbor, k), at(s.workspace.old_place, k)
            if k_old >= 0 and j < n:
                kept = at(s.workspace.old_color, k_old)
                if kept < MASK_COLORS:
                    bit = wp.uint64(1) << wp.uint64(kept)
                    own = own | bit
                    put(used, j, at(used, j) | bit)
                else:
                    extra += 1
            put(color, k, kept)
            k += 1
        put(used, i, own)
    if extra == 0:
        return int(MASK_COLORS)
    return renumber_extra_colors(s)


@wp.func
def colors(s: Scene):
    """Color pairs by first-fit. A pair that does not fit in 64 colors gets a color that no other pair has.

    Contacts with walls have no color, -1. While an attempt resumes, pairs that stay listed keep their colors,
    so that all its sweeps have one order.
    """
    rows, used, color = s.neighbors, s.workspace.used_colors, s.workspace.color
    n = grain_count(s)
    for i in range(n):
        put(used, i, wp.uint64(0))
    extra = int(MASK_COLORS)
    resuming = s.control.resuming != 0
    if resuming:
        extra = keep_colors(s)
    for i in range(n):
        own = at(used, i)  # no later row reads it
        k, end = at(rows.start, i), at(rows.start, i + 1)
        while k < end:
            j, found = at(rows.neighbor, k), at(color, k)
            if j >= n:
                found = -1
            elif not resuming or found < 0:
                its = at(used, j)
                found = lowest_free(own | its)
                if found < MASK_COLORS:
                    bit = wp.uint64(1) << wp.uint64(found)
                    own = own | bit
                    put(used, j, its | bit)
                else:
                    found = extra
                    extra = extra + 1
                put(color, k, found)
            put(s.workspace.group, k, found)
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
def is_tiled(s: Scene) -> bool:
    """Return whether the list is long enough to be swept tile after tile."""
    return s.merge != 0 and pair_count(s) > s.tuning.tile


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
        colors(s)
    else:
        levels(s.neighbors, s.workspace.next_level, s.workspace.group)


@wp.func
def gather(s: Scene, i: int):
    """Write the pairs of grain i in sweeping order, as (i, j, index in the neighbor list)."""
    k, end = at(s.neighbors.start, i), at(s.neighbors.start, i + 1)
    while k < end:
        j = at(s.neighbors.neighbor, k)
        if j < grain_count(s):
            put(s.workspace.sequence, at(s.workspace.sweep_index, k), wp.vec3i(i, j, k))
        k += 1


@wp.func
def tile_pairs(s: Scene):
    """Sweep tile after tile of the rows, each in the order given: close by in time and in memory.

    A pair is in no earlier tile than any pair before it on its grains, so that it reads the same velocities
    as without tiles: the same bits.
    """
    pairs, length = pair_count(s), s.tuning.tile
    tiles = (listed_count(s) + length - 1) // length
    sequence, next_tile, tile = s.workspace.sequence, s.workspace.next_tile, s.workspace.tile
    tile_end = s.workspace.tile_end
    for i in range(grain_count(s)):
        put(next_tile, i, 0)
    for w in range(tiles + 1):
        put(tile_end, w, 0)
    c = int(0)
    while c < pairs:
        pair = at(sequence, c)
        earlier = wp.max(at(next_tile, pair[0]), at(next_tile, pair[1]))
        w = wp.max(pair[2] // length, earlier)
        put(next_tile, pair[0], w)
        put(next_tile, pair[1], w)
        put(tile, c, w)
        put(tile_end, w + 1, at(tile_end, w + 1) + 1)
        c += 1
    for w in range(tiles):
        put(tile_end, w + 1, at(tile_end, w + 1) + at(tile_end, w))
    c = int(0)
    while c < pairs:
        w = at(tile, c)
        place = at(tile_end, w)
        put(s.workspace.sweep_index, at(sequence, c)[2], place)
        put(tile_end, w, place + 1)
        c += 1
