"""The order in which contacts are swept, and the independent sets that may be swept in parallel.

Every candidate pair (in lexicographic order, as the neighbor list holds them) is given an independent set.
The sets are swept one after the other; pairs of one set share no grain, so they may be swept in parallel.
Contacts with walls follow, as one set.

- levels: a pair's set is above those of all earlier pairs that share a grain with it. Sweeping by sets gives
  every pair exactly what it would have read in the sequential loop: the same bits.
- colors: first-fit, each pair the lowest set that neither of its grains has yet. Another order, in which
  a few wide sets suffice.

The loops are sequential by nature (each pair depends on earlier ones) and run on one thread, only when the
list has changed.
"""

import warp as wp

from ..access import at, lowest_bit, put
from ..record import Scene, grain_count
from .contact_list import listed_count

MASK_COLORS = wp.constant(64)


@wp.func
def choose_sets(s: Scene):
    """Give every pair its set, and contacts with walls none, -1."""
    rows, n = s.neighbors, grain_count(s)
    taken = s.workspace.taken  # of every grain: the level after its last pair's, or a mask of its colors
    for i in range(n):
        put(taken, i, wp.uint64(0))
    extra = int(MASK_COLORS)  # a pair without a free color among those of a mask gets one that no other has
    for i in range(n):
        own = at(taken, i)  # no later row reads it
        k, end = at(rows.start, i), at(rows.start, i + 1)
        while k < end:
            j, chosen = at(rows.neighbor, k), int(-1)
            if j < n:
                its = at(taken, j)
                free = ~(own | its)
                if s.by_color == 0:
                    chosen = int(wp.max(own, its))
                    own = wp.uint64(chosen + 1)
                    put(taken, j, own)
                elif free == wp.uint64(0):
                    chosen = extra
                    extra += 1
                else:
                    chosen = lowest_bit(free)
                    bit = wp.uint64(1) << wp.uint64(chosen)
                    own = own | bit
                    put(taken, j, its | bit)
            put(s.workspace.set_of, k, chosen)
            k += 1


@wp.func
def order_contacts(s: Scene):
    """Give every contact its index in sweeping order: pairs by set, then contacts with walls (counting sort).

    Contacts of a set stay in lexicographic order. Where sets are merged, all pairs are one set, because a
    single thread sweeps them in order anyway.
    """
    listed = listed_count(s)
    start, set_of, sweep_index = s.contacts.set_start, s.workspace.set_of, s.workspace.sweep_index
    sets, pairs = int(0), int(0)
    k = int(0)
    while k < listed:
        sets = wp.max(sets, at(set_of, k) + 1)
        k += 1
    for g in range(sets):
        put(start, g, 0)
    k = int(0)
    while k < listed:
        g = at(set_of, k)
        if g >= 0:
            put(start, g, at(start, g) + 1)
            pairs += 1
        k += 1
    for g in range(1, sets):
        put(start, g, at(start, g) + at(start, g - 1))
    walls = int(listed)
    while k > 0:  # the end of each set is counted down to its start
        k -= 1
        g = at(set_of, k)
        if g >= 0:
            index = at(start, g) - 1
            put(start, g, index)
            put(sweep_index, k, index)
        else:
            walls -= 1
            put(sweep_index, k, walls)
    if s.merge != 0:
        put(start, 0, 0)
        sets = 1
    put(start, sets, pairs)
    put(start, sets + 1, listed)
    s.contacts.count.pairs = pairs
    s.contacts.count.sets = sets
    s.contacts.count.walls = listed - pairs
