"""Mutual exclusion of Python threads: for building kernels, and for advancing an object."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock

from warpgrains.base.errors import SimulationError

BUILDING = RLock()
"""Lock for starting Warp and for creating, compiling and loading kernels, where Warp is not thread-safe."""

NOTHING, READ, CHANGE = range(3)
"""Uses of an object, in ascending order. Each use includes the uses before it."""

# In a child that is forked while another thread holds the lock, it would never be released.
os.register_at_fork(
    before=BUILDING.acquire, after_in_parent=BUILDING.release, after_in_child=BUILDING.release
)


class ExclusiveUse:
    """Lock on an object that only one thread, with its callbacks, may use at a time.

    Messages call the object `what`.
    """

    def __init__(self, what: str) -> None:
        self._what, self._lock, self._allowed = what, RLock(), CHANGE

    @contextmanager
    def held(self, use: int = CHANGE, allowed: int = CHANGE) -> Iterator[None]:
        """Exclude other threads while this thread uses the object: `use` is `READ` or `CHANGE`.

        Callbacks within the block may use the object for `allowed` at most. If another thread uses the
        object, or a callback needs more, raise SimulationError at once rather than wait.
        """
        if not self._lock.acquire(blocking=False):
            raise self._refusal()
        before = self._allowed
        try:
            if use > before:
                raise self._refusal()
            self._allowed = min(before, allowed)
            yield
        finally:
            self._allowed = before
            self._lock.release()

    def _refusal(self) -> SimulationError:
        return SimulationError(
            f"this {self._what} is being advanced, by another thread or by the call that runs this callback:"
            f" wait until it has ended, or use one {self._what} per thread"
        )
