"""Tiles dealt out to the CPU threads of a team in turn: who sweeps which pairs, and after whom.

A tile is a stretch of the list's rows (coloring.py). The first thread sweeps the first tile, the second the
next, and so on round and round. Pairs wait for those of another tile where the two share a grain, mostly at
their common border: a thread follows the one before it at some distance, and rarely waits.

A thread sweeps its pairs in the common order, in segments: stretches that it sweeps without a pause. Where
the last pair before c on one of c's grains is another thread's, a segment begins with c that comes after
it. So that one wait does for many pairs, it comes after a few more of that thread's, but after none that
comes after c in the common order. The first pair in that order which is not yet swept thus never waits, and
the threads never block each other for good.

Who sweeps a pair does not change what it finds: no result depends on it.
"""

import warp as wp

from .access import at, put
from .coloring import tile_length
from .record import Scene, dealt_threads, grain_count, pair_count

LONGEST = wp.constant(2)  # tile that one thread sweeps, in lengths: orders without rows make longer ones
STRETCHES = wp.constant(4)  # of a tile, one of which is waited for at a time


@wp.func
def piece_end(s: Scene, begin: int, length: int) -> int:
    """Where the stretch of the common order ends that a thread is dealt at once."""
    tile = int(0)
    while at(s.workspace.tile_end, tile) <= begin:
        tile += 1
    end = at(s.workspace.tile_end, tile)
    if end - begin > LONGEST * length:
        end = begin + length
    return end


@wp.func
def begin_dealing(s: Scene, length: int):
    """Find where the places of every thread begin; nothing is dealt yet, and nobody waits."""
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
    """Let a segment begin with the pair at this place, if none does; it waits for nobody yet."""
    if at(s.dealt.begins, place) == 0:
        put(s.dealt.begins, place, 1)
        team = dealt_threads(s)
        for other in range(team):
            put(s.dealt.dependencies, place * team + other, 0)


@wp.func
def wait_for(s: Scene, w: int, place: int, before: int, stretch: int):
    """Let the pair at this place, of thread w, come after all of another thread before a place of its."""
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
    """Give thread w a stretch of the common order, and mark where it has to wait."""
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
    """Number the segments, and tell where each begins, and what it comes after."""
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
    """Deal the pairs of a list out to the threads."""
    pairs, length = pair_count(s), tile_length(s)
    begin_dealing(s, length)
    begin, piece = int(0), int(0)
    while begin < pairs:
        end = piece_end(s, begin, length)
        deal(s, piece % dealt_threads(s), begin, end, wp.max(1, length // STRETCHES))
        begin = end
        piece += 1
    number_segments(s)
