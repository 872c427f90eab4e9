"""The order in which contacts are swept, and the independent sets that may be swept in parallel.

Every candidate pair is assigned to an independent set, in the lexicographic order of the neighbor list. The
sets are swept one after the other. Pairs of one set share no grain, so they may be swept in parallel.
Contacts with walls follow, as one set.

- levels: the set of a pair is above the sets of all earlier pairs that share a grain with this pair. So each
  pair reads exactly the velocities that it would read in the sequential loop, and the bits are the same.
- colors: first fit. Each pair has the lowest set in which neither of its grains has a pair yet. The order
  differs from that of the sequential loop, and a few large sets suffice.

The loops are sequential by nature, because each pair depends on earlier ones. They run on one thread, and
only if the list has changed.
"""

import warp as wp

from ..access import at, lowest_bit, put
from ..record import Scene, grain_count
from .contact_list import listed_count

MASK_COLORS = wp.constant(64)


@wp.func
def choose_sets(s: Scene):
    """Write the number of the independent set of every pair to `set_of`, and -1 for contacts with walls."""
    rows, n = s.neighbors, grain_count(s)
    taken = s.neighbors.taken  # of every grain: 1 + the level of its last pair, or a mask of its colors
    for i in range(n):
        put(taken, i, wp.uint64(0))
    extra = int(MASK_COLORS)  # a pair for which no color of the mask is free gets a color of no other pair
    for i in range(n):
        own = at(taken, i)  # not written back, because no later row reads it
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
            put(s.neighbors.set_of, k, chosen)
            k += 1


@wp.func
def order_contacts(s: Scene):
    """Write the index of every contact in the order of the sweep, `sweep_index`, and the sets' `set_start`.

    The order is pairs by set, then contacts with walls. This is a counting sort: contacts of a set stay in
    lexicographic order. If sets are merged (`merge`), all pairs become one set, but keep this order.
    """
    listed = listed_count(s)
    start, set_of, sweep_index = s.contacts.set_start, s.neighbors.set_of, s.neighbors.sweep_index
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
