"""OS threads that run tasks while the calling thread polls their progress."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from queue import Empty, SimpleQueue

from warpgrains.base.checks import MOST_THREADS

GLANCE = 0.1  # seconds between two polls
GRACE = 0.5  # seconds that tasks have to end after an interrupt, before they are abandoned


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Tasks:
    """Tasks that are executed at most once each, even if an interrupt occurs while threads start.

    The thread that waits holds no Python lock, because an interrupt could leave the lock locked.
    """

    def __init__(self, tasks: Sequence[Callable[[], None]]) -> None:
        self._waiting, self._count = dict(enumerate(tasks)), len(tasks)
        self._failures: dict[int, BaseException | None] = {}
        self._wake_ups: SimpleQueue[None] = SimpleQueue()

    def do(self, k: int) -> None:
        """Execute task k, unless a thread has begun it before or it was dropped."""
        failure, task = None, self._waiting.pop(k, None)
        if task is None:
            return
        try:
            task()
        except BaseException as error:
            failure = error
            raise
        finally:
            self._failures[k] = failure
            self._wake_ups.put(None)

    def drop(self) -> None:
        """Drop the tasks that no thread has begun."""
        for k in range(self._count):
            if self._waiting.pop(k, None) is not None:
                self._failures[k] = None

    def __len__(self) -> int:
        return self._count

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until all tasks are done; return False if no task ends within `timeout` seconds."""
        while len(self._failures) < self._count:
            try:
                self._wake_ups.get(timeout=timeout)
            except Empty:
                return False
        return True

    def require_success(self) -> None:
        """Raise the exception of the first task that has failed, if there is one."""
        for _, failure in sorted(self._failures.items()):
            if failure is not None:
                raise failure


class _Workers:
    """A pool that keeps its threads for later tasks, with at most MOST_THREADS threads."""

    def __init__(self) -> None:
        self.renew()
        os.register_at_fork(after_in_child=self.renew)  # a child process has no threads of the pool

    def renew(self) -> None:
        """Replace the pool by an empty one, whose threads start with its first tasks."""
        self._executor = ThreadPoolExecutor(MOST_THREADS, "warpgrains")

    def submit(self, tasks: _Tasks, first: int = 0) -> None:
        """Submit tasks first, first + 1, ... to the pool."""
        for k in range(first, len(tasks)):
            self._executor.submit(tasks.do, k)


_WORKERS = _Workers()


def run_threads(
    tasks: Sequence[Callable[[], None]],
    poll: Callable[[], None] | None = None,
    cancel: Callable[[bool], None] | None = None,
) -> None:
    """Execute each task on a separate thread.

    `poll` is called every `GLANCE` seconds and at the end. Without `poll`, tasks must be short and share
    their work: the calling thread does the first task, and then drops the tasks that no thread has begun. If
    the calling thread is interrupted, cancel(False) asks the tasks to end soon. If they have not ended after
    `GRACE` seconds, cancel(True) asks them to abandon their work. The function always waits for all tasks.
    """
    if len(tasks) == 1 and poll is None:
        return tasks[0]()
    all_tasks = _Tasks(tasks)
    try:
        _WORKERS.submit(all_tasks, int(poll is None))
        if poll is None:
            all_tasks.do(0)
            all_tasks.drop()
        while not all_tasks.wait(GLANCE):
            if poll is not None:
                poll()
    except BaseException:
        if cancel is not None:
            cancel(False)
        _WORKERS.submit(all_tasks)  # a team in which a thread is missing would wait forever
        if cancel is not None and not all_tasks.wait(GRACE):
            cancel(True)
        all_tasks.wait()
        raise
    all_tasks.require_success()
    if poll is not None:
        poll()
