"""Many scenes advanced by teams of CPU threads: each team acquires a free scene and advances it for a while.

Scenes are scheduled dynamically: a slow one keeps one team busy, and no other team waits for it. No result
depends on which team advances a scene, or when, because a step reads and writes its scene's record alone.
"""

from functools import cache

import warp as wp

from .record import PAUSED, SOLVED, Phase, Scene, SceneRecord
from .stages import OPTIONS
from .threads import Team, TeamRecord
from .waiting import barrier, seconds

f64 = wp.float64
TIME_SLICE = wp.constant(f64(1.0e-3))  # seconds after which a team looks for another scene


@wp.struct
class Queue:
    """The steps left to do, and the teams' claims, by scene."""

    cursor: wp.array(dtype=wp.int64)  # slices begun
    taken: wp.array(dtype=wp.int32)  # whether a team has the scene
    left: wp.array(dtype=wp.int32)  # steps
    outcome: wp.array(dtype=wp.int32)  # of the last step
    seconds: wp.array(dtype=f64)  # spent
    cancel: wp.array(dtype=wp.int32)  # whether to begin no other step
    most_unconverged: wp.array(dtype=wp.int32)  # steps, after which a scene waits for the host


@wp.func_native("return __atomic_fetch_add(cursor.data, 1LL, __ATOMIC_RELAXED);")
def next_slice(cursor: wp.array(dtype=wp.int64)) -> wp.int64:
    """Return the number of the next time slice, counted over all teams."""
    ...


@wp.func_native("return __atomic_exchange_n(taken.data + k, 1, __ATOMIC_ACQUIRE) == 0;")
def is_taken_now(taken: wp.array(dtype=wp.int32), k: int) -> bool:
    """Acquire scene k; return whether no other team holds it."""
    ...


@wp.func_native("__atomic_store_n(taken.data + k, 0, __ATOMIC_RELEASE);")
def give_back(taken: wp.array(dtype=wp.int32), k: int):
    """Release scene k."""
    ...


@wp.func
def has_work(queue: Queue, k: int) -> bool:
    """Return whether scene k has steps left and does not wait for the host."""
    return queue.left[k] > 0 and queue.outcome[k] == SOLVED


@wp.func
def take(queue: Queue) -> int:
    """Acquire a scene that has steps left. Returns its number, or -1 if there is none."""
    scenes = queue.left.shape[0]
    found = int(-1)
    if queue.cancel[0] == 0:
        first = int(next_slice(queue.cursor) % wp.int64(scenes))
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
def kernel(name: str, solve: wp.Function) -> wp.Kernel:
    """Return the kernel that advances scenes, the launch of one thread, in a separate module.

    Parameters
    ----------
    name : str
        Of the module.
    solve : wp.Function
        A thread's part in one step of a scene, `(team, scene)`.
    """
    module = wp.get_module(name)
    wp.set_module_options(OPTIONS, module)

    @wp.func(inline=False)
    def advance_scene(team: Team, s: Scene, queue: Queue, k: int):
        """Advance a scene until its steps are done, it waits for the host, or its time slice is over."""
        begun = seconds()
        going_on = int(1)
        while going_on != 0:
            solve(team, s)
            if team.rank == 0:
                if s.control.phase == Phase.ACCEPTED:
                    queue.left[k] = queue.left[k] - 1
                queue.outcome[k] = s.step.outcome
                if s.statistics.unconverged >= queue.most_unconverged[0]:
                    queue.outcome[k] = PAUSED
                spent = seconds() - begun
                going_on = 1 if has_work(queue, k) and queue.cancel[0] == 0 and spent < TIME_SLICE else 0
                if going_on == 0:
                    queue.seconds[k] = queue.seconds[k] + spent
                team.going_on[0] = going_on
            barrier(team)
            going_on = team.going_on[0]
            barrier(team)  # all have read it before it is written again

    @wp.kernel(module=module)
    def advance(records: wp.array(dtype=SceneRecord), queue: Queue, team: TeamRecord):
        """Advance scenes until none is free."""
        k = int(0)
        while k >= 0:
            if team.rank == 0:
                team.scene[0] = take(queue)
            barrier(team)
            k = team.scene[0]
            if k >= 0:
                advance_scene(team, records[k], queue, k)
                if team.rank == 0:
                    give_back(queue.taken, k)
            barrier(team)  # the same of `scene`

    return advance
