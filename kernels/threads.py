"""A team of threads: how the elements of a stage are shared out, and how threads wait for each other.

On a CPU every OS thread is one thread of the team, and they meet at a barrier after every stage. On a GPU the
team is a launch, and its end is the barrier. No result depends on the size of the team.
"""

import warp as wp

from .access import at, raise_to
from .types import Floats

GPU_PARTIALS = 64  # over which a GPU's threads spread their parts of a maximum
BLOCK = wp.constant(64)  # pairs that a thread corrects before it looks at the grains of large corrections
MOMENTS = wp.constant(2 * BLOCK + 8)  # of a thread: two a pair, and a gap that no cache line bridges


@wp.struct
class TeamRecord:
    """A team, as one of its threads sees it."""

    rank: wp.int32
    size: wp.int32
    arrivals: wp.array(dtype=wp.int64)  # how often a thread has come to the barrier
    ended: wp.array(dtype=wp.int64)  # every eighth: a thread's passes and segments (segments.py)
    scene: wp.array(dtype=wp.int32)  # that the team works on (advance.py)
    going_on: wp.array(dtype=wp.int32)  # whether it goes on with it


Team = wp.ref[TeamRecord]


@wp.func
def member(team: TeamRecord, rank: int) -> TeamRecord:
    """The team as its thread of this rank sees it."""
    one = team
    one.rank = rank
    return one


@wp.func
def thread_range(team: Team, begin: int, end: int):
    """The part of [begin, end) that is this thread's: consecutive, and nearly equal for all threads."""
    first, last = begin, end
    if team.size > 1:
        rank, size, count = wp.int64(team.rank), wp.int64(team.size), wp.int64(end - begin)
        first = begin + int(count * rank / size)
        last = begin + int(count * (rank + wp.int64(1)) / size)
    return first, last


@wp.func
def partial_index(team: Team, partials: int) -> int:
    """Where this thread keeps its part of a maximum or a sum: CPU threads each have their own."""
    k = team.rank
    if k >= partials:
        k = k % partials
    return k


@wp.func
def keep_largest(team: Team, parts: Floats, value: wp.float64):
    """Keep a number if it is the largest of this thread's; it writes seldom, as others write beside it."""
    k = partial_index(team, parts.shape[0])
    if value > at(parts, k):
        raise_to(parts, k, value)


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    for (int look = 0; __atomic_load_n(counts.data + k, __ATOMIC_ACQUIRE) < least; look++) {
#if defined(__x86_64__)
        __builtin_ia32_pause();
#endif
#if defined(__linux__) || defined(__APPLE__)
        int yield_processor(void) __asm__("sched_yield");
        if (look > 1000)
            yield_processor();
#endif
    }
#endif
""")
def wait_until(counts: wp.array(dtype=wp.int64), k: int, least: wp.int64):
    """Wait until other CPU threads have counted that far; give the core away if it takes long."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return 0;
#else
    return __atomic_fetch_add(arrivals.data, 1LL, __ATOMIC_ACQ_REL);
#endif
""")
def arrive(arrivals: wp.array(dtype=wp.int64)) -> wp.int64:
    """Count an arrival. Returns how many there were before."""
    ...


@wp.func(inline=False)
def meet(team: Team):
    """Wait for all threads; called, so that it is compiled once and not after every stage."""
    size = wp.int64(team.size)
    all_here = (arrive(team.arrivals) / size + wp.int64(1)) * size
    wait_until(team.arrivals, 0, all_here)


@wp.func
def barrier(team: Team):
    """Let every CPU thread see what the others have written; a team of one does not wait."""
    if team.size > 1:
        meet(team)
