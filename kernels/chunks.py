"""Chunks of fixed length, over which sums are taken and then in order: the same for any number of threads."""

import warp as wp

from .record import Scene, pair_count, wall_count

CHUNK = wp.constant(128)


@wp.func
def chunks_in(count: int) -> int:
    """How many chunks hold so many elements."""
    return (count + CHUNK - 1) // CHUNK


@wp.func
def part_count(s: Scene) -> int:
    """How many parts the pairs have: a chunk may lie in several sets, and is one part in each."""
    return chunks_in(pair_count(s)) + s.contacts.count.sets


@wp.func
def wall_part_count(s: Scene) -> int:
    """How many parts the grains at the walls have."""
    return chunks_in(wall_count(s))
