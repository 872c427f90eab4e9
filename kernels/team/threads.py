"""A team of threads, among which the elements of a stage are divided.

On a CPU the threads of a team are OS threads, on a GPU the threads of a block. They wait for each other at a
barrier after every stage (waiting.py). No result depends on the size of the team.
"""

import warp as wp

from ..access import at, larger, put, raise_to
from ..types import Floats

WORDS = 24  # length of TeamRecord.words
GPU_PARTIALS = 8  # number of partial maxima and sums that the threads of a GPU block share


@wp.struct
class TeamRecord:
    """The record of one thread of a team: its rank, the size of the team, and what the threads share."""

    rank: wp.int32
    size: wp.int32
    words: wp.array(dtype=wp.int64)  # state of the barrier of CPU threads (waiting.py); empty on a GPU
    scene: wp.array(dtype=wp.int32)  # number of the scene that CPU threads advance (advance.py), shape (1,)


Team = wp.ref[TeamRecord]


def team_records(size: int) -> list[TeamRecord]:
    """Return the records of a new team of `size` CPU threads, one for each thread."""
    scene = wp.zeros(1, dtype=wp.int32, device="cpu")
    words = wp.zeros(WORDS, dtype=wp.int64, device="cpu")
    records = []
    for rank in range(size):
        record = TeamRecord()
        record.rank, record.size, record.words, record.scene = rank, size, words, scene
        records.append(record)
    return records


@wp.func
def is_on_gpu(team: Team) -> bool:
    """Return whether the team is a block of GPU threads."""
    return team.words.shape[0] == 0


@wp.func
def thread_range(team: Team, begin: int, end: int):
    """Return (first, end) of this thread's part of [begin, end): parts are consecutive and about equal."""
    first, last = begin, end
    if team.size > 1:  # a division takes as long as a stage of a small scene
        length = (end - begin + team.size - 1) // team.size
        first = wp.min(begin + team.rank * length, end)
        last = wp.min(first + length, end)
    return first, last


@wp.func
def partial_index(team: Team, partials: int) -> int:
    """Return this thread's index in an array of `partials` partial results.

    Each CPU thread has its own index; GPU threads share them.
    """
    if team.rank < partials:
        return team.rank
    return team.rank % partials


@wp.func
def update_max(team: Team, partial: Floats, value: wp.float64):
    """Raise this thread's partial maximum to `value`, if `value` is larger.

    Otherwise nothing is written, because threads share cache lines.
    """
    k = partial_index(team, partial.shape[0])
    if value > at(partial, k):
        if is_on_gpu(team):
            raise_to(partial, k, value)
        else:  # an atomic exchange takes 3 % of a step of 15 grains
            put(partial, k, value)


@wp.func
def take_max(partial: Floats) -> wp.float64:
    """Return the maximum of all partial maxima, and reset them to 0."""
    largest = wp.float64(0.0)
    k = int(0)
    while k < partial.shape[0]:
        largest = larger(largest, at(partial, k))
        put(partial, k, wp.float64(0.0))
        k += 1
    return largest
