"""Passes over the pairs, set after set or segment after segment, by the threads of a team.

If threads meet after every independent set, each sweeps its share of it. If threads are assigned tiles
(dealing.py), each sweeps its segments, and begins one as soon as the other threads have swept the pairs that
it depends on. If a team has lost members, a thread sweeps the segments of several, in any order that the
dependencies allow. In both cases a pair reads the velocities that it would read if all pairs were swept one
by one in the common order.
"""

import warp as wp

from .access import at
from .contacts import is_wall_set
from .pace import barrier, count_waiting
from .record import Scene, dealt_threads, is_driven
from .threads import Team, is_member, thread_range
from .waiting import LINE, begin_look, end_look, seconds, wake, word_at


@wp.func_native(f"""
#if !defined(__CUDA_ARCH__)
    const long long pass = 1LL << 32;
    long long *own = ended.data + {LINE} * w;
    own[1] = first;
    __atomic_store_n(own, (own[0] / pass + 1) * pass, __ATOMIC_RELEASE);
#endif
""")
def begin_segments(ended: wp.array(dtype=wp.int64), w: int, first: int):
    """Count a pass in the upper half of thread w's word, clear the lower half, and set its next segment."""
    ...


@wp.func_native(f"""
#if !defined(__CUDA_ARCH__)
    const long long pass = 1LL << 32;
    long long *own = ended.data + {LINE} * w;
    own[1] += 1;
    __atomic_store_n(own, own[0] / pass * pass + place, __ATOMIC_RELEASE);
#endif
""")
def end_segment(ended: wp.array(dtype=wp.int64), w: int, place: int):
    """Publish that all pairs of thread w before an index are swept, and advance to its next segment."""
    ...


@wp.func
def may_begin(team: Team, s: Scene, w: int, segment: int) -> bool:
    """Return whether all pairs that a segment depends on are swept in this pass."""
    threads = dealt_threads(s)
    places_of_a_pass = wp.int64(1) << wp.int64(32)
    begun = team.ended[LINE * w] / places_of_a_pass * places_of_a_pass
    for other in range(threads):
        needed = at(s.dealt.dependencies, segment * threads + other)
        if needed > 0 and word_at(team.ended, LINE * other) < begun + wp.int64(needed):
            return False
    return True


@wp.func
def next_segment(team: Team, s: Scene) -> int:
    """Wait for a segment that may begin, of this thread or of one that has left. Returns -1 at the end."""
    found = int(-1)
    look = int(0)
    waiting = bool(True)
    begun = wp.float64(0.0)
    while waiting:
        event = begin_look(team.words, look)
        waiting = bool(False)
        w = int(team.rank)
        while w < dealt_threads(s) and found < 0:
            segment = int(team.ended[LINE * w + 1])
            if segment < at(s.dealt.first_segment, w + 1):
                if may_begin(team, s, w, segment):
                    found = segment
                else:
                    waiting = True
            w += team.size
        waiting = waiting and found < 0
        end_look(team.words, look, event, not waiting)
        if waiting and look == 0 and team.rank == 0:
            begun = seconds()
        look += 1
    if begun > wp.float64(0.0):
        count_waiting(team, begun)
    return found


@wp.func
def begin_pass(team: Team, s: Scene):
    """Begin a pass over the pairs."""
    w = int(team.rank)
    while w < dealt_threads(s) and is_member(team):
        begin_segments(team.ended, w, at(s.dealt.first_segment, w))
        w += team.size


@wp.func
def next_set(team: Team, s: Scene, k: int) -> int:
    """Return the set after set k, or the segment that this thread sweeps next; -1 at the end of the pass."""
    following = int(k) + 1
    if not is_member(team):
        following = -1
    elif dealt_threads(s) > 0:
        following = next_segment(team, s)
    elif following >= s.contacts.count.sets:
        following = -1
    return following


@wp.func
def end_set(team: Team, s: Scene, k: int):
    """Make the changes of this thread in an independent set, or segment, visible to the other threads."""
    if dealt_threads(s) > 0:
        w = int(team.rank)
        while k >= at(s.dealt.first_segment, w + 1):
            w += team.size
        end_segment(team.ended, w, at(s.contacts.set_start, k + 1))
        if team.size > 1:
            wake(team.words)
    else:
        barrier(team)


@wp.func
def range_of_set(team: Team, s: Scene, k: int, begin: int, end: int):
    """Return this thread's range of [begin, end), of set k: all or nothing if its contacts share a wall."""
    first, last = thread_range(team, begin, end)
    if is_driven(s) and is_wall_set(s, k):
        first = wp.where(team.rank == 0, begin, end)
        last = end
    return first, last


@wp.func
def contacts_of(team: Team, s: Scene, k: int):
    """Return the contacts that this thread sweeps of a set, or of a segment."""
    begin = at(s.contacts.set_start, k)
    end = at(s.contacts.set_start, k + 1)
    if dealt_threads(s) == 0 or is_wall_set(s, k):
        begin, end = range_of_set(team, s, k, begin, end)
    return begin, end


@wp.func
def end_pass(team: Team, s: Scene):
    """End a pass: wait until all threads have ended their segments."""
    if dealt_threads(s) > 0:
        barrier(team)
