"""Who sweeps which pairs, and when: passes over the pairs, set after set or segment after segment.

Where threads meet after every independent set, each takes its share of it. Where every thread has a strip of
its own (strips.py), it sweeps its segments; before each, it waits until each other thread has ended as many
of its own as `dependencies` tells. Either way a pair finds the velocities that it would find if all pairs
were swept one by one in the common order.
"""

import warp as wp

from .record import Scene, wall_count
from .threads import Team, barrier, thread_range, wait_until


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    const long long pass = 1LL << 32;
    __atomic_store_n(&ended.data[8 * rank], (ended.data[8 * rank] / pass + 1) * pass, __ATOMIC_RELEASE);
#endif
""")
def begin_own_segments(ended: wp.array(dtype=wp.int64), rank: int):
    """Count a pass over the pairs in the upper half of a thread's word, and no segments in the lower."""
    ...


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    __atomic_store_n(&ended.data[8 * rank], ended.data[8 * rank] + 1, __ATOMIC_RELEASE);
#endif
""")
def count_own_segment(ended: wp.array(dtype=wp.int64), rank: int):
    """Tell the others that one more segment is over."""
    ...


@wp.func
def wait_for_others(team: Team, s: Scene, segment: int):
    """Wait until every other thread has ended the segments, in this pass, that this one depends on."""
    segments_of_a_pass = wp.int64(1) << wp.int64(32)
    begun = team.ended[8 * team.rank] / segments_of_a_pass * segments_of_a_pass
    for other in range(team.size):
        needed = s.strips.dependencies[segment * team.size + other]
        if needed > 0:
            wait_until(team.ended, 8 * other, begun + wp.int64(needed))


@wp.func
def begin_pass(team: Team, s: Scene):
    """Begin a pass over the pairs. Returns this thread's first set, or segment, and the end of its last."""
    first = int(0)
    last = s.contacts.count.sets
    if s.has_strips != 0:
        begin_own_segments(team.ended, team.rank)
        first = s.strips.first_segment[team.rank]
        last = s.strips.first_segment[team.rank + 1]
    return first, last


@wp.func
def end_set(team: Team, s: Scene):
    """Let others go on with what this set, or segment, has changed."""
    if s.has_strips != 0:
        count_own_segment(team.ended, team.rank)
    else:
        barrier(team)


@wp.func
def pairs_of(team: Team, s: Scene, k: int):
    """The pairs that this thread sweeps of a set, or of its segment, which may have to wait."""
    begin = s.contacts.set_start[k]
    end = s.contacts.set_start[k + 1]
    if s.has_strips != 0:
        wait_for_others(team, s, k)
    else:
        begin, end = thread_range(team, begin, end)
    return begin, end


@wp.func
def walls_of(team: Team, s: Scene):
    """The grains at the walls that this thread sweeps."""
    begin, end = thread_range(team, 0, wall_count(s))
    if s.has_strips != 0:
        begin = s.strips.first_wall[team.rank]
        end = s.strips.first_wall[team.rank + 1]
    return begin, end


@wp.func
def end_pass(team: Team, s: Scene):
    """End a pass: no thread goes on before all have ended their segments."""
    if s.has_strips != 0:
        barrier(team)
