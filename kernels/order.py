"""In which order the contacts are swept, and which of them may be swept together.

Every candidate pair (in lexicographic order, as `Rows` hold them) is given a group. The groups are swept one
after the other; pairs of one group share no grain, so they may be swept together.

- levels: a pair's group is above those of all earlier pairs that share a grain with it. Sweeping by groups
  gives every pair exactly what it would have read in the sequential loop: the same bits.
- colors: first-fit, each pair the lowest group that neither of its grains has yet. Another order, in which
  a few wide groups suffice.

The loops are sequential by nature (each pair depends on earlier ones) and run on one thread, only when the
list has changed.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .data import GROUPS, PAIRS, Contacts
from .detect import Rows
from .stage import kernels_of
from .variant import Variant

MASK_COLORS = wp.constant(64)


@wp.func
def lowest_free(used: wp.uint64) -> int:
    """The lowest bit that is not set, or 64."""
    color = int(0)
    while color < MASK_COLORS and ((used >> wp.uint64(color)) & wp.uint64(1)) != wp.uint64(0):
        color = color + 1
    return color


@cache
def stages(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the stages for one kind of scene."""

    @wp.func
    def levels(rows: Rows, next_level: wp.array(dtype=wp.int32), group: wp.array(dtype=wp.int32)):
        """Dependency levels, as few as there can be."""
        n = rows.start.shape[0] - 1
        for i in range(n):
            next_level[i] = 0
        for i in range(n):
            for k in range(rows.start[i], rows.start[i + 1]):
                j = rows.neighbor[k]
                level = wp.max(next_level[i], next_level[j])
                group[k] = level
                next_level[i] = level + 1
                next_level[j] = level + 1

    @wp.func
    def colors(rows: Rows, used: wp.array(dtype=wp.uint64), group: wp.array(dtype=wp.int32)):
        """First-fit. What does not fit in 64 colors (a grain may touch thousands) is swept pair by pair."""
        n = rows.start.shape[0] - 1
        for i in range(n):
            used[i] = wp.uint64(0)
        extra = int(0)
        for i in range(n):
            for k in range(rows.start[i], rows.start[i + 1]):
                j = rows.neighbor[k]
                color = lowest_free(used[i] | used[j])
                if color < MASK_COLORS:
                    bit = wp.uint64(1) << wp.uint64(color)
                    used[i] = used[i] | bit
                    used[j] = used[j] | bit
                    group[k] = color
                else:
                    group[k] = MASK_COLORS + extra
                    extra = extra + 1

    @wp.func
    def place(
        rows: Rows,
        group: wp.array(dtype=wp.int32),
        merge: int,
        contacts: Contacts,
        slot: wp.array(dtype=wp.int32),
    ):
        """Give every pair its slot, sorted by group and in lexicographic order within one.

        With `merge` the groups are told as one: a single worker sweeps the slots in order anyway.
        """
        pairs = rows.start[rows.start.shape[0] - 1]
        groups = int(0)
        for k in range(pairs):
            groups = wp.max(groups, group[k] + 1)
        for g in range(groups + 1):
            contacts.group_start[g] = 0
        for k in range(pairs):
            contacts.group_start[group[k] + 1] = contacts.group_start[group[k] + 1] + 1
        for g in range(groups):
            contacts.group_start[g + 1] = contacts.group_start[g + 1] + contacts.group_start[g]
        for k in range(pairs):
            slot[k] = contacts.group_start[group[k]]
            contacts.group_start[group[k]] = slot[k] + 1
        for g in range(groups):
            contacts.group_start[groups - g] = contacts.group_start[groups - g - 1]
        contacts.group_start[0] = 0
        contacts.count[PAIRS] = pairs
        contacts.count[GROUPS] = groups
        if merge != 0:
            contacts.group_start[1] = pairs
            contacts.count[GROUPS] = 1

    @wp.func
    def line_up(i: int, rows: Rows, slot: wp.array(dtype=wp.int32), sequence: wp.array(dtype=wp.vec3i)):
        """Write the pairs of grain i, (i, j, place in the rows), where they come in sweeping order."""
        for k in range(rows.start[i], rows.start[i + 1]):
            sequence[slot[k]] = wp.vec3i(i, rows.neighbor[k], k)

    @wp.func
    def windows(
        contacts: Contacts,
        sequence: wp.array(dtype=wp.vec3i),
        window: int,
        next_window: wp.array(dtype=wp.int32),
        start: wp.array(dtype=wp.int32),
        slot: wp.array(dtype=wp.int32),
    ):
        """Sweep window after window of the rows, each in the order given: close by in time and in memory.

        A pair waits for the window of every pair before it on its grains, so that it finds what it would have
        found: the same bits.
        """
        pairs = contacts.count[PAIRS]
        if pairs <= window:
            return
        for i in range(next_window.shape[0]):
            next_window[i] = 0
        for w in range(pairs):
            start[w] = 0
            start[w + 1] = 0
        for s in range(pairs):
            pair = sequence[s]
            w = wp.max(pair[2] // window, wp.max(next_window[pair[0]], next_window[pair[1]]))
            next_window[pair[0]] = w
            next_window[pair[1]] = w
            slot[pair[2]] = w
            start[w + 1] = start[w + 1] + 1
        for w in range(pairs):
            start[w + 1] = start[w + 1] + start[w]
        for s in range(pairs):
            k = sequence[s][2]
            w = slot[k]
            slot[k] = start[w]
            start[w] = start[w] + 1

    return SimpleNamespace(levels=levels, colors=colors, place=place, line_up=line_up, windows=windows)


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Kernels of the stages that are launched."""
    own = stages(variant)
    return kernels_of(variant.module, own.levels, own.colors, own.place, own.line_up, own.windows)
