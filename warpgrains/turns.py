"""Mutual exclusion of Python threads: for building kernels, and for advancing an object."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock

from warpgrains.errors import SimulationError

BUILDING = RLock()
"""Lock for starting Warp and for creating, compiling and loading kernels, where Warp is not thread-safe."""

# In a child that is forked while another thread holds the lock, it would never be released.
os.register_at_fork(
    before=BUILDING.acquire, after_in_parent=BUILDING.release, after_in_child=BUILDING.release
)


class ExclusiveUse:
    """Guard against two threads that advance an object at once.

    Parameters
    ----------
    what : str
        Name of the object in messages.
    """

    def __init__(self, what: str) -> None:
        self._what, self._lock, self._is_advancing = what, RLock(), False

    @contextmanager
    def exclusive(self) -> Iterator[None]:
        """Exclude other threads during the block.

        Raises SimulationError if another thread is in such a block.
        """
        if not self._lock.acquire(blocking=False):
            self._refuse("another thread")
        try:
            if self._is_advancing:
                self._refuse("the call that runs this callback")
            yield
        finally:
            self._lock.release()

    @contextmanager
    def advancing(self) -> Iterator[None]:
        """Exclude other threads and also callbacks during the block, as `exclusive` does."""
        with self.exclusive():
            self._is_advancing = True
            try:
                yield
            finally:
                self._is_advancing = False

    def _refuse(self, by: str) -> None:
        raise SimulationError(
            f"this {self._what} is being advanced by {by}: wait until it has ended,"
            f" or use one {self._what} per thread"
        )
