"""Who sweeps which pairs, and when: passes over the pairs, set after set or segment after segment.

Where threads meet after every independent set, each takes its share of it. Where threads are dealt tiles
(dealing.py), each sweeps its segments; before one, it waits until the others have come as far as
`dependencies` tells. Either way a pair finds the velocities that it would find if all pairs were swept one by
one in the common order.
"""

import warp as wp

from .access import at
from .record import Scene, dealt_threads
from .threads import Team, barrier, thread_range, wait_until


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    const long long pass = 1LL << 32;
    __atomic_store_n(&ended.data[8 * rank], (ended.data[8 * rank] / pass + 1) * pass, __ATOMIC_RELEASE);
#endif
""")
def begin_own_segments(ended: wp.array(dtype=wp.int64), rank: int):
    """Count a pass over the pairs in the upper half of a thread's word, and no place in the lower."""
    ...


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    const long long pass = 1LL << 32;
    __atomic_store_n(&ended.data[8 * rank], ended.data[8 * rank] / pass * pass + place, __ATOMIC_RELEASE);
#endif
""")
def tell_place(ended: wp.array(dtype=wp.int64), rank: int, place: int):
    """Tell the others that this thread has swept all its pairs before a place."""
    ...


@wp.func
def wait_for_others(team: Team, s: Scene, segment: int):
    """Wait until every other thread has come, in this pass, to the place that a segment depends on."""
    places_of_a_pass = wp.int64(1) << wp.int64(32)
    begun = team.ended[8 * team.rank] / places_of_a_pass * places_of_a_pass
    for other in range(team.size):
        needed = at(s.dealt.dependencies, segment * team.size + other)
        if needed > 0:
            wait_until(team.ended, 8 * other, begun + wp.int64(needed))


@wp.func
def begin_pass(team: Team, s: Scene):
    """Begin a pass over the pairs. Returns this thread's first set, or segment, and the end of its last."""
    first = int(0)
    last = s.contacts.count.sets
    if dealt_threads(s) > 0:
        begin_own_segments(team.ended, team.rank)
        first = at(s.dealt.first_segment, team.rank)
        last = at(s.dealt.first_segment, team.rank + 1)
    return first, last


@wp.func
def end_set(team: Team, s: Scene, k: int):
    """Let others go on with what this set, or segment, has changed."""
    if dealt_threads(s) > 0:
        tell_place(team.ended, team.rank, at(s.contacts.set_start, k + 1))
    else:
        barrier(team)


@wp.func
def pairs_of(team: Team, s: Scene, k: int):
    """The pairs that this thread sweeps of a set, or of its segment, which may have to wait."""
    begin = at(s.contacts.set_start, k)
    end = at(s.contacts.set_start, k + 1)
    if dealt_threads(s) > 0:
        wait_for_others(team, s, k)
    else:
        begin, end = thread_range(team, begin, end)
    return begin, end


@wp.func
def end_pass(team: Team, s: Scene):
    """End a pass: no thread goes on before all have ended their segments."""
    if dealt_threads(s) > 0:
        barrier(team)
