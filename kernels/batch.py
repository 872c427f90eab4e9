"""Many scenes shared out among CPU threads: each takes a free one, advances it for a while, takes another.

Scenes are handed out, not split in equal parts: a slow one keeps one thread busy, and no other waits for it.
No result depends on who advances a scene, or when: it reads and writes nothing but its own record.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from . import step
from .crew import Crew
from .rebuild import stages as rebuild_stages
from .record import SceneRecord
from .step import SOLVED
from .tally import add_step
from .variant import OPTIONS, Variant

f64 = wp.float64
TURN = wp.constant(f64(1.0e-3))  # seconds after which a thread looks for another scene


@wp.struct
class Queue:
    """What is left to do, by scene."""

    cursor: wp.array(dtype=wp.int64)  # turns begun
    taken: wp.array(dtype=wp.int32)  # whether a thread has the scene
    left: wp.array(dtype=wp.int32)  # steps
    outcome: wp.array(dtype=wp.int32)  # of the last step
    seconds: wp.array(dtype=f64)  # spent
    halt: wp.array(dtype=wp.int32)  # whether to begin no other turn


@wp.func_native("return __atomic_fetch_add(cursor.data, 1LL, __ATOMIC_RELAXED);")
def next_turn(cursor: wp.array(dtype=wp.int64)) -> wp.int64:
    """Number the turns of all threads."""
    ...


@wp.func_native("return __atomic_exchange_n(taken.data + k, 1, __ATOMIC_ACQUIRE) == 0;")
def is_taken_now(taken: wp.array(dtype=wp.int32), k: int) -> bool:
    """Take scene k, if no other thread has it; what that one wrote is seen."""
    ...


@wp.func_native("__atomic_store_n(taken.data + k, 0, __ATOMIC_RELEASE);")
def give_back(taken: wp.array(dtype=wp.int32), k: int):
    """Leave scene k to the next thread."""
    ...


@wp.func_native("""
    double time = 0.0;
#if defined(__linux__)
    long long now[2];
    int read_clock(int, long long *) __asm__("clock_gettime");
    read_clock(1, now);
    time = double(now[0]) + 1e-9 * double(now[1]);
#endif
    return time;
""")
def seconds() -> f64:
    """Read a clock that never goes back; where there is none, all turns last to the end."""
    ...


@wp.func
def has_work(queue: Queue, k: int) -> bool:
    """Whether scene k is to be advanced."""
    return queue.left[k] > 0 and queue.outcome[k] == SOLVED


@wp.func
def take(queue: Queue) -> int:
    """Take a scene that has steps left and that no other thread has; -1 if there is none."""
    scenes = queue.left.shape[0]
    found = int(-1)
    if queue.halt[0] == 0:
        first = int(next_turn(queue.cursor) % wp.int64(scenes))
        look = int(0)
        while look < scenes and found < 0:
            k = (first + look) % scenes
            look = look + 1
            if not has_work(queue, k):
                continue
            if is_taken_now(queue.taken, k):
                if has_work(queue, k):
                    found = k
                else:
                    give_back(queue.taken, k)
    return found


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the kernels for one kind of scene, in a module of their own."""
    module = wp.get_module(f"{variant.module.name}_batch")
    wp.set_module_options(OPTIONS, module)
    solve, put_in_order = step.stages(variant).solve, rebuild_stages(variant).put_in_order

    @wp.func
    def advance_scene(crew: Crew, s: SceneRecord, queue: Queue, k: int):
        """Advance a scene until it is done, cannot go on, or its turn is over."""
        start = seconds()
        spent = f64(0.0)
        left = queue.left[k]
        outcome = int(SOLVED)
        while left > 0 and outcome == SOLVED and spent < TURN:
            outcome = solve(crew, s)
            if outcome == SOLVED:
                add_step(s)
                left = left - 1
            spent = seconds() - start
        queue.left[k] = left
        queue.outcome[k] = outcome
        queue.seconds[k] = queue.seconds[k] + spent

    @wp.kernel(module=module)
    def advance(crew: Crew, records: wp.array(dtype=SceneRecord), queue: Queue):
        """Advance scenes as long as one is free: one thread's launch."""
        k = take(queue)
        while k >= 0:
            advance_scene(crew, records[k], queue, k)
            give_back(queue.taken, k)
            k = take(queue)

    @wp.kernel(module=module)
    def order_list(records: wp.array(dtype=SceneRecord), k: int):
        """Put a list that the host has written in order."""
        put_in_order(records[k])

    return SimpleNamespace(advance=advance, order_list=order_list)
