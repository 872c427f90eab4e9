"""Tiles assigned to the CPU threads of a team in turn, and the dependencies between their pairs.

A tile is a range of the list's rows (coloring.py). The first thread sweeps the first tile, the second the
next, and so on round and round. Pairs wait for those of another tile where the two share a grain, mostly at
their common border: a thread follows the one before it at some distance, and rarely waits.

A thread sweeps its pairs in the common order, in segments: ranges that it sweeps without waiting. Where the
last pair before c on one of c's grains belongs to another thread, a segment begins with c and depends on that
pair. So that one wait serves many pairs, it depends on a few later pairs of that thread too, but on none that
comes after c in the common order. The first pair in that order which is not yet swept thus never waits, and
there is no deadlock.

No result depends on which thread sweeps a pair, because each pair reads the same velocities in any case.
"""

import warp as wp

from .access import at, put
from .coloring import tile_length
from .record import Scene, dealt_threads, grain_count, pair_count

LONGEST = wp.constant(2)  # tile that one thread sweeps, in lengths: orders without rows make longer ones
STRETCHES = wp.constant(4)  # parts of a tile; a segment waits for the end of a part


@wp.func
def piece_end(s: Scene, begin: int, length: int) -> int:
    """Return the end of the range of the common order, from `begin` on, that one thread is assigned."""
    tile = int(0)
    while at(s.workspace.tile_end, tile) <= begin:
        tile += 1
    end = at(s.workspace.tile_end, tile)
    if end - begin > LONGEST * length:
        end = begin + length
    return end


@wp.func
def begin_dealing(s: Scene, length: int):
    """Find the first index of every thread, and reset the cursors and dependencies."""
    team, pairs, first = dealt_threads(s), pair_count(s), s.dealt.first
    for w in range(team + 1):
        put(first, w, 0)
    begin, piece = int(0), int(0)
    while begin < pairs:
        end = piece_end(s, begin, length)
        put(first, piece % team + 1, at(first, piece % team + 1) + end - begin)
        begin = end
        piece += 1
    for w in range(team):
        put(first, w + 1, at(first, w + 1) + at(first, w))
        put(s.dealt.cursor, w, at(first, w))
    for k in range(team * team):
        put(s.dealt.seen, k, 0)
    for i in range(grain_count(s)):
        put(s.dealt.last, i, 0)
    c = int(0)
    while c < pairs:
        put(s.dealt.begins, c, 0)
        c += 1


@wp.func
def begin_segment(s: Scene, place: int):
    """Begin a segment with the pair at this index, if none begins there; it has no dependencies yet."""
    if at(s.dealt.begins, place) == 0:
        put(s.dealt.begins, place, 1)
        team = dealt_threads(s)
        for other in range(team):
            put(s.dealt.dependencies, place * team + other, 0)


@wp.func
def wait_for(s: Scene, w: int, place: int, before: int, stretch: int):
    """Make the pair at `place`, of thread w, depend on another thread's pairs before the index `before`."""
    team, first = dealt_threads(s), s.dealt.first
    other = int(0)
    while before > at(first, other + 1):
        other += 1
    if before > at(s.dealt.seen, w * team + other):
        end = wp.min((before + stretch - 1) // stretch * stretch, at(s.dealt.cursor, other))
        put(s.dealt.seen, w * team + other, end)
        begin_segment(s, place)
        put(s.dealt.dependencies, place * team + other, end)
        if end < at(first, other + 1):
            begin_segment(s, end)


@wp.func
def deal(s: Scene, w: int, begin: int, end: int, stretch: int):
    """Assign the pairs [begin, end) of the common order to thread w, with their dependencies."""
    last, first = s.dealt.last, at(s.dealt.first, w)
    place = at(s.dealt.cursor, w)
    c = int(begin)
    while c < end:
        pair = at(s.workspace.sequence, c)
        for side in range(2):
            before = at(last, pair[side])
            if before > place or (before > 0 and before <= first):
                wait_for(s, w, place, before, stretch)
            put(last, pair[side], place + 1)
        put(s.workspace.sweep_index, pair[2], place)
        place += 1
        c += 1
    put(s.dealt.cursor, w, place)


@wp.func
def number_segments(s: Scene):
    """Number the segments, and write the first pair and the dependencies of each."""
    team, first = dealt_threads(s), s.dealt.first
    segments = int(0)
    for w in range(team):
        put(s.dealt.first_segment, w, segments)
        c, end = at(first, w), at(first, w + 1)
        if c < end:
            begin_segment(s, c)
        while c < end:
            if at(s.dealt.begins, c) != 0:
                put(s.contacts.set_start, segments, c)
                for other in range(team):
                    dependency = at(s.dealt.dependencies, c * team + other)
                    put(s.dealt.dependencies, segments * team + other, dependency)
                segments += 1
            c += 1
    put(s.dealt.first_segment, team, segments)
    put(s.contacts.set_start, segments, pair_count(s))
    s.contacts.count.sets = segments


@wp.func
def deal_out(s: Scene):
    """Assign the pairs of a list to the threads."""
    pairs, length = pair_count(s), tile_length(s)
    begin_dealing(s, length)
    begin, piece = int(0), int(0)
    while begin < pairs:
        end = piece_end(s, begin, length)
        deal(s, piece % dealt_threads(s), begin, end, wp.max(1, length // STRETCHES))
        begin = end
        piece += 1
    number_segments(s)
