"""OS threads for tasks, while the calling thread polls their progress."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from threading import Condition

from warpgrains.scene.checks import MOST_THREADS

GLANCE = 0.1  # seconds between two polls
GRACE = 0.5  # seconds that tasks have to end after an interrupt, before they are abandoned


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Tasks:
    """Tasks that are executed exactly once, even if an interrupt occurs while threads start."""

    def __init__(self, tasks: Sequence[Callable[[], None]]) -> None:
        self._tasks, self._waiting = tasks, set(range(len(tasks)))
        self._ended, self._changed = 0, Condition()

    def do(self, k: int) -> None:
        """Execute task k, unless it was begun before."""
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

    def __len__(self) -> int:
        return len(self._tasks)

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until all tasks are done, for some seconds at most; return True if they are."""
        with self._changed:
            return self._changed.wait_for(lambda: self._ended == len(self._tasks), timeout)


class _Workers:
    """Threads that are kept for later tasks, one for each task that runs at the same time."""

    def __init__(self) -> None:
        self.renew()
        os.register_at_fork(after_in_child=self.renew)  # a child has none of them

    def renew(self) -> None:
        """Begin without threads."""
        self._executor = ThreadPoolExecutor(MOST_THREADS, "warpgrains")

    def submit(self, tasks: _Tasks, first: int = 0) -> list[Future[None]]:
        """Submit the tasks from number `first` on."""
        return [self._executor.submit(tasks.do, k) for k in range(first, len(tasks))]


_WORKERS = _Workers()


def run_threads(
    tasks: Sequence[Callable[[], None]],
    poll: Callable[[], None] | None = None,
    cancel: Callable[[bool], None] | None = None,
) -> None:
    """Execute each task on a separate thread.

    `poll` is called every `GLANCE` seconds and at the end. Without it, tasks are short and share their work:
    this thread does the first, and drops those that no thread has begun when it is done. If this thread is
    interrupted, `cancel` is called: with False, so that the tasks end soon, and with True if they have not
    ended after `GRACE` seconds, so that they abandon their work. They are waited for.
    """
    if len(tasks) == 1 and poll is None:
        return tasks[0]()
    all_tasks = _Tasks(tasks)
    try:
        futures = _WORKERS.submit(all_tasks, int(poll is None))
        if poll is None:
            all_tasks.do(0)
            futures = [future for future in futures if not future.cancel()]
        while wait(futures, timeout=GLANCE).not_done:
            if poll is not None:
                poll()
    except BaseException:
        if cancel is not None:
            cancel(False)
        _WORKERS.submit(all_tasks)  # a team with a missing thread would wait for ever
        if cancel is not None and not all_tasks.wait(GRACE):
            cancel(True)
        all_tasks.wait()
        raise
    for future in futures:
        future.result()
    if poll is not None:
        poll()
