"""Kernels that advance many scenes: each team acquires a free scene and advances it for a time slice.

Scenes are scheduled dynamically: a slow scene keeps one team busy, and no other team waits for it. No result
depends on which team advances a scene, or when, because a step reads and writes only the record of its scene.
On a GPU, a block advances one scene until its steps are done or the scene waits for the host.
"""

from functools import cache

import warp as wp

from ..record import Outcome, Scene, SceneRecord
from .stages import OPTIONS
from .threads import Team, TeamRecord, is_on_gpu
from .waiting import barrier, seconds

f64 = wp.float64
TIME_SLICE = wp.constant(f64(1.0e-3))  # seconds after which a team on a CPU releases its scene
MAX_REGISTERS = 64  # per GPU thread; with 128 or more, fewer scenes would run at a time


@wp.struct
class Queue:
    """The work left: arrays by scene, except those with one element."""

    cursor: wp.array(dtype=wp.int64)  # number of time slices begun by all teams, shape (1,)
    taken: wp.array(dtype=wp.int32)  # whether a team holds the scene
    left: wp.array(dtype=wp.int32)  # number of steps left
    outcome: wp.array(dtype=wp.int32)  # of the last step
    seconds: wp.array(dtype=f64)  # wall time spent on the scene
    going_on: wp.array(dtype=wp.int32)  # whether its team begins another step of the scene
    cancel: wp.array(dtype=wp.int32)  # whether no team may begin another step, shape (1,)
    most_unconverged: wp.array(dtype=wp.int32)  # unconverged steps after which a scene stops, shape (1,)


@wp.func_native("return __atomic_fetch_add(cursor.data, 1LL, __ATOMIC_RELAXED);")
def next_slice(cursor: wp.array(dtype=wp.int64)) -> wp.int64:
    """Return the number, from 0, of the time slice that begins, counted over all teams."""
    ...


@wp.func_native("return __atomic_exchange_n(taken.data + k, 1, __ATOMIC_ACQUIRE) == 0;")
def try_acquire(taken: wp.array(dtype=wp.int32), k: int) -> bool:
    """Acquire scene k if no other team holds it; return whether that succeeded."""
    ...


@wp.func_native("__atomic_store_n(taken.data + k, 0, __ATOMIC_RELEASE);")
def release(taken: wp.array(dtype=wp.int32), k: int):
    """Release scene k."""
    ...


@wp.func_native("return *(volatile int *)cancel.data != 0;")
def has_stopped(cancel: wp.array(dtype=wp.int32)) -> bool:
    """Return whether the host has requested that no further step begins, which it may do at any time."""
    ...


@wp.func
def has_work(queue: Queue, k: int) -> bool:
    """Return whether scene k has steps left and its last step was solved; otherwise it waits or has ended."""
    return queue.left[k] > 0 and queue.outcome[k] == Outcome.SOLVED


@wp.func
def acquire(queue: Queue) -> int:
    """Acquire a free scene that has steps left; return its number, or -1 if there is none."""
    scenes = queue.left.shape[0]
    found = int(-1)
    if not has_stopped(queue.cancel):
        first = int(next_slice(queue.cursor) % wp.int64(scenes))
        look = int(0)
        while look < scenes and found < 0:
            k = (first + look) % scenes
            look = look + 1
            if not has_work(queue, k):
                continue
            if try_acquire(queue.taken, k):
                if has_work(queue, k):
                    found = k
                else:
                    release(queue.taken, k)
    return found


@cache
def kernel(name: str, solve: wp.Function, on_gpu: bool) -> wp.Kernel:
    """Return the kernel that advances scenes, in a separate module.

    On a CPU, each thread of a team launches it once. On a GPU, one launch covers the blocks of all scenes.

    Parameters
    ----------
    name : str
        Name of the module.
    solve : wp.Function
        Function `(team, scene)` that does one thread's part of a step.
    on_gpu : bool
        Whether the kernel is for a GPU, where a block is a team.
    """
    module = wp.get_module(name)
    wp.set_module_options(OPTIONS, module)

    @wp.func(inline=False)
    def advance_scene(team: Team, s: Scene, queue: Queue, k: int):
        """Advance a scene until its steps are done, it waits for the host, or its time slice is over."""
        begun, most_unconverged = seconds(), queue.most_unconverged[0]
        left, going_on = int(queue.left[k]), int(1)  # copied, because a GPU reads memory of the host slowly
        while going_on != 0:
            solve(team, s)
            if team.rank == 0:
                outcome = int(s.step.outcome)
                if outcome == Outcome.SOLVED:
                    left -= 1
                if s.statistics.unconverged >= most_unconverged:
                    outcome = int(Outcome.STOPPED)
                queue.left[k] = left
                queue.outcome[k] = outcome
                spent = seconds() - begun
                going_on = (
                    1 if left > 0 and outcome == Outcome.SOLVED and not has_stopped(queue.cancel) else 0
                )
                if spent > TIME_SLICE and not is_on_gpu(team):
                    going_on = 0
                if going_on == 0:
                    queue.seconds[k] = queue.seconds[k] + spent
                queue.going_on[k] = going_on
            barrier(team)
            going_on = queue.going_on[k]
            barrier(team)  # all threads have read going_on before it is written again

    if on_gpu:

        @wp.kernel(module=module, cuda_max_registers=MAX_REGISTERS)
        def advance_on_gpu(records: wp.array(dtype=SceneRecord), queue: Queue, block: TeamRecord):
            """Do one thread's part in advancing scene wp.tid() // team.size, which a block shares."""
            team = block
            k = wp.tid() // team.size
            team.rank = wp.tid() - k * team.size
            if team.rank == 0:
                queue.going_on[k] = 1 if has_work(queue, k) and not has_stopped(queue.cancel) else 0
            barrier(team)
            if queue.going_on[k] != 0:
                advance_scene(team, records[k], queue, k)

        return advance_on_gpu

    @wp.kernel(module=module)
    def advance(records: wp.array(dtype=SceneRecord), queue: Queue, team: TeamRecord):
        """Advance scenes, one after the other, until no scene is free."""
        k = int(0)
        while k >= 0:
            if team.rank == 0:
                team.scene[0] = acquire(queue)
            barrier(team)
            k = team.scene[0]
            if k >= 0:
                advance_scene(team, records[k], queue, k)
                if team.rank == 0:
                    release(queue.taken, k)
            barrier(team)  # all threads have read team.scene before it is written again

    return advance
