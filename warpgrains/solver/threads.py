"""OS threads for tasks, while the calling thread polls their progress."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor, wait
from threading import Condition

GLANCE = 0.1  # seconds between two polls


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Works:
    """Tasks that are executed exactly once, even if an interrupt occurs while threads start."""

    def __init__(self, works: Sequence[Callable[[], None]]) -> None:
        self._works, self._waiting = works, set(range(len(works)))
        self._ended, self._changed = 0, Condition()

    def submit(self, executor: Executor) -> list[Future[None]]:
        """Submit all tasks."""
        return [executor.submit(self._do, k) for k in range(len(self._works))]

    def _do(self, k: int) -> None:
        with self._changed:
            if k not in self._waiting:
                return
            self._waiting.remove(k)
        try:
            self._works[k]()
        finally:
            with self._changed:
                self._ended += 1
                self._changed.notify_all()

    def wait(self) -> None:
        """Wait until all tasks are done."""
        with self._changed:
            self._changed.wait_for(lambda: self._ended == len(self._works))


def side_by_side(
    works: Sequence[Callable[[], None]],
    glance: Callable[[], None] | None = None,
    halt: Callable[[], None] | None = None,
) -> None:
    """Execute each task on one thread; a single task without polling runs on the calling thread.

    Parameters
    ----------
    works : sequence of callable
    glance : callable, optional
        Called every `GLANCE` seconds and at the end.
    halt : callable, optional
        Called once if this thread is interrupted. It requests the tasks to end, and they are waited for.
    """
    if len(works) == 1 and glance is None:
        return works[0]()
    all_works = _Works(works)
    with ThreadPoolExecutor(len(works)) as executor:
        try:
            futures = all_works.submit(executor)
            while wait(futures, timeout=GLANCE).not_done:
                if glance is not None:
                    glance()
        except BaseException:
            if halt is not None:
                halt()
            all_works.submit(executor)  # a team with a missing thread would wait for ever
            all_works.wait()
            raise
    for future in futures:
        future.result()
    if glance is not None:
        glance()
