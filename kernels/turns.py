"""Who sweeps which pairs, and when: passes over the pairs, turn after turn.

Where workers meet after every group, a turn is a group, and each worker takes its share of it. Where every
worker has turns of its own (lanes.py), a turn is a stretch of slots that it sweeps without a pause; before
it, it waits until each other worker has ended as many of its turns as `turn_after` tells. Either way a pair
finds the velocities that it would find if all slots were swept one by one in the common order.
"""

import warp as wp

from .crew import Crew, meet, share, wait_until
from .data import GROUPS, WALLS, Contacts


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    const long long pass = 1LL << 32;
    __atomic_store_n(&ended.data[8 * worker], (ended.data[8 * worker] / pass + 1) * pass, __ATOMIC_RELEASE);
#endif
""")
def begin_own_turns(ended: wp.array(dtype=wp.int64), worker: int):
    """Count a pass over the pairs in the upper half of a worker's word, and no turns in the lower."""
    ...


@wp.func
def wait_for_others(crew: Crew, contacts: Contacts, turn: int, worker: int):
    """Wait until every other worker has ended the turns, in this pass, that this one comes after."""
    turns_of_a_pass = wp.int64(1) << wp.int64(32)
    begun = crew.ended[8 * worker] / turns_of_a_pass * turns_of_a_pass
    for other in range(crew.workers):
        needed = contacts.turn_after[turn * crew.workers + other]
        if needed > 0:
            wait_until(crew.ended, 8 * other, begun + wp.int64(needed))


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    __atomic_store_n(&ended.data[8 * worker], ended.data[8 * worker] + 1, __ATOMIC_RELEASE);
#endif
""")
def count_own_turn(ended: wp.array(dtype=wp.int64), worker: int):
    """Tell the others that one more turn is over."""
    ...


@wp.func
def begin_turns(crew: Crew, tid: int, contacts: Contacts):
    """Begin a pass. Returns this worker's first turn, and the one after its last."""
    worker = crew.first + tid
    first = int(0)
    last = contacts.count[GROUPS]
    if contacts.own_turns != 0:
        begin_own_turns(crew.ended, worker)
        first = contacts.lane_turn[worker]
        last = contacts.lane_turn[worker + 1]
    return first, last


@wp.func
def take_turn(crew: Crew, tid: int, contacts: Contacts, turn: int):
    """Wait for a turn. Returns the first slot that this worker sweeps in it, and the one after the last."""
    begin = contacts.group_start[turn]
    end = contacts.group_start[turn + 1]
    if contacts.own_turns != 0:
        wait_for_others(crew, contacts, turn, crew.first + tid)
    else:
        begin, end = share(crew, tid, begin, end)
    return begin, end


@wp.func
def end_turn(crew: Crew, tid: int, contacts: Contacts):
    """Let others go on with what this turn has changed."""
    if contacts.own_turns != 0:
        count_own_turn(crew.ended, crew.first + tid)
    else:
        meet(crew)


@wp.func
def walls_of(crew: Crew, tid: int, contacts: Contacts):
    """The grains at the walls that this worker sweeps: the first, and the one after the last."""
    begin, end = share(crew, tid, 0, contacts.count[WALLS])
    if contacts.own_turns != 0:
        begin = contacts.lane_wall[crew.first + tid]
        end = contacts.lane_wall[crew.first + tid + 1]
    return begin, end


@wp.func
def end_turns(crew: Crew, contacts: Contacts):
    """End a pass: no worker goes on before all have ended their turns."""
    if contacts.own_turns != 0:
        meet(crew)
