"""OS threads for tasks, while the calling thread polls their progress."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor, wait
from threading import Condition

GLANCE = 0.1  # seconds between two polls


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Tasks:
    """Tasks that are executed exactly once, even if an interrupt occurs while threads start."""

    def __init__(self, tasks: Sequence[Callable[[], None]]) -> None:
        self._tasks, self._waiting = tasks, set(range(len(tasks)))
        self._ended, self._changed = 0, Condition()

    def submit(self, executor: Executor) -> list[Future[None]]:
        """Submit all tasks."""
        return [executor.submit(self._do, k) for k in range(len(self._tasks))]

    def _do(self, k: int) -> None:
        with self._changed:
            if k not in self._waiting:
                return
            self._waiting.remove(k)
        try:
            self._tasks[k]()
        finally:
            with self._changed:
                self._ended += 1
                self._changed.notify_all()

    def wait(self) -> None:
        """Wait until all tasks are done."""
        with self._changed:
            self._changed.wait_for(lambda: self._ended == len(self._tasks))


def run_threads(
    tasks: Sequence[Callable[[], None]],
    poll: Callable[[], None] | None = None,
    cancel: Callable[[], None] | None = None,
) -> None:
    """Execute each task on one thread; a single task without polling runs on the calling thread.

    Parameters
    ----------
    tasks : sequence of callable
    poll : callable, optional
        Called every `GLANCE` seconds and at the end.
    cancel : callable, optional
        Called once if this thread is interrupted. It requests the tasks to end, and they are waited for.
    """
    if len(tasks) == 1 and poll is None:
        return tasks[0]()
    all_tasks = _Tasks(tasks)
    with ThreadPoolExecutor(len(tasks)) as executor:
        try:
            futures = all_tasks.submit(executor)
            while wait(futures, timeout=GLANCE).not_done:
                if poll is not None:
                    poll()
        except BaseException:
            if cancel is not None:
                cancel()
            all_tasks.submit(executor)  # a team with a missing thread would wait for ever
            all_tasks.wait()
            raise
    for future in futures:
        future.result()
    if poll is not None:
        poll()
