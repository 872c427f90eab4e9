"""A team of threads, among which the elements of a stage are divided.

On a CPU every OS thread is one thread of the team, and they meet at a barrier after every stage (waiting.py).
On a GPU the team is a launch, and its end is the barrier. No result depends on the size of the team.
"""

import warp as wp

from .access import at, put, raise_to
from .types import Floats

WORDS = 24  # of a team, by which its threads wait
GPU_PARTIALS = 64  # over which a GPU's threads spread partial maxima and sums


@wp.struct
class TeamRecord:
    """A team, as one of its threads sees it."""

    rank: wp.int32
    size: wp.int32
    words: wp.array(dtype=wp.int64)  # by which CPU threads wait for each other (waiting.py); empty on a GPU
    scene: wp.array(dtype=wp.int32)  # that the team works on (advance.py)
    going_on: wp.array(dtype=wp.int32)  # whether it goes on with it


Team = wp.ref[TeamRecord]


def team_records(size: int) -> list[TeamRecord]:
    """Return the record of a new team of CPU threads for each of them."""
    scene, going_on = (wp.zeros(1, dtype=wp.int32, device="cpu") for _ in range(2))
    words = wp.zeros(WORDS, dtype=wp.int64, device="cpu")
    records = []
    for rank in range(size):
        record = TeamRecord()
        record.rank, record.size, record.words = rank, size, words
        record.scene, record.going_on = scene, going_on
        records.append(record)
    return records


@wp.func
def thread_range(team: Team, begin: int, end: int):
    """Return this thread's range of [begin, end): ranges are consecutive and of nearly equal length."""
    first, last = begin, end
    if team.size > 1:
        rank, size, count = wp.int64(team.rank), wp.int64(team.size), wp.int64(end - begin)
        first = begin + int(count * rank / size)
        last = begin + int(count * (rank + wp.int64(1)) / size)
    return first, last


@wp.func
def partial_index(team: Team, partials: int) -> int:
    """Return the index of this thread's partial maximum or sum; each CPU thread has a separate one."""
    return team.rank % partials


@wp.func
def update_max(team: Team, partial: Floats, value: wp.float64):
    """Raise this thread's partial maximum to a value; write it seldom, because threads share cache lines."""
    k = partial_index(team, partial.shape[0])
    if value > at(partial, k):
        raise_to(partial, k, value)


@wp.func
def take_max(partial: Floats) -> wp.float64:
    """Return the maximum of the partial maxima, and reset these to 0."""
    largest = wp.float64(0.0)
    for k in range(partial.shape[0]):
        largest = wp.max(largest, at(partial, k))
        put(partial, k, wp.float64(0.0))
    return largest
