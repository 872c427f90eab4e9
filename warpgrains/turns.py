"""Turns of Python threads: one at a time builds kernels, one at a time drives an object."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock

from warpgrains.errors import SimulationError

BUILDING = RLock()
"""Held by the thread that starts Warp, or makes, compiles or loads kernels: Warp is not thread-safe there."""

# A child that is forked while another thread builds would find the lock held for ever.
os.register_at_fork(
    before=BUILDING.acquire, after_in_parent=BUILDING.release, after_in_child=BUILDING.release
)


class Driver:
    """Keeps an object from being driven twice at once.

    Parameters
    ----------
    what : str
        The object, as messages name it.
    """

    def __init__(self, what: str) -> None:
        self._what, self._lock, self._is_advancing = what, RLock(), False

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Exclude other threads meanwhile; raise SimulationError if another has done so."""
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
        """Exclude other threads and callbacks meanwhile, as `alone` does."""
        with self.alone():
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
