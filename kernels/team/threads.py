"""A team of threads, among which the elements of a stage are divided.

On a CPU every OS thread is one thread of the team, on a GPU every thread of a block. They meet at a barrier
after every stage (waiting.py). No result depends on the size of the team.
"""

import warp as wp

from ..access import at, larger, put, raise_to
from ..types import Floats

WORDS = 24  # of a team, by which its threads wait
GPU_PARTIALS = 8  # over which a GPU's threads spread partial maxima and sums


@wp.struct
class TeamRecord:
    """A team, as one of its threads sees it."""

    rank: wp.int32
    size: wp.int32
    words: wp.array(dtype=wp.int64)  # by which CPU threads wait for each other (waiting.py); empty on a GPU
    scene: wp.array(dtype=wp.int32)  # that CPU threads work on (advance.py)


Team = wp.ref[TeamRecord]


def team_records(size: int) -> list[TeamRecord]:
    """Return the record of a new team of CPU threads for each of them."""
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
    """Return whether the team is a block of a GPU."""
    return team.words.shape[0] == 0


@wp.func
def thread_range(team: Team, begin: int, end: int):
    """Return this thread's range of [begin, end): consecutive ranges, of one length but for the last."""
    first, last = begin, end
    if team.size > 1:  # to divide takes as long as a small scene's stage
        length = (end - begin + team.size - 1) // team.size
        first = wp.min(begin + team.rank * length, end)
        last = wp.min(first + length, end)
    return first, last


@wp.func
def partial_index(team: Team, partials: int) -> int:
    """Return the index of this thread's partial maximum or sum; each CPU thread has a separate one."""
    if team.rank < partials:
        return team.rank
    return team.rank % partials


@wp.func
def update_max(team: Team, partial: Floats, value: wp.float64):
    """Raise this thread's partial maximum to a value; write it seldom, because threads share cache lines."""
    k = partial_index(team, partial.shape[0])
    if value > at(partial, k):
        if is_on_gpu(team):
            raise_to(partial, k, value)
        else:  # an atomic exchange takes 3 % of a step of 15 grains
            put(partial, k, value)


@wp.func
def take_max(partial: Floats) -> wp.float64:
    """Return the maximum of the partial maxima, and reset these to 0."""
    largest = wp.float64(0.0)
    k = int(0)
    while k < partial.shape[0]:
        largest = larger(largest, at(partial, k))
        put(partial, k, wp.float64(0.0))
        k += 1
    return largest
