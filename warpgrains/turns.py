"""Mutual exclusion of Python threads: for building kernels, and for advancing an object."""

import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from threading import RLock
from typing import Self

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
        self._what, self._lock, self._is_advancing, self._is_observed = what, RLock(), False, False
        self._advancing = _Advancing(self)

    def exclusive(self) -> Self:
        """Return the context that excludes other threads.

        Entering it raises SimulationError if another thread is in such a context.
        """
        return self

    def changing(self) -> Self:
        """Return the same context, for what advances or changes the object: not while it is observed."""
        if self._is_observed:
            self._refuse("the run that calls this observer or end criterion")
        return self

    @contextmanager
    def observed(self) -> Iterator[None]:
        """Let callbacks in the block read the object, but refuse to let them advance or change it."""
        self._is_observed = True
        try:
            yield
        finally:
            self._is_observed = False

    def advancing(self) -> AbstractContextManager[None]:
        """Return the context that excludes other threads and also callbacks, as `exclusive` does."""
        return self._advancing

    def __enter__(self) -> Self:
        if not self._lock.acquire(blocking=False):
            self._refuse("another thread")
        if self._is_advancing:
            self._lock.release()
            self._refuse("the call that runs this callback")
        return self

    def __exit__(self, *_: object) -> None:
        self._lock.release()

    def _refuse(self, by: str) -> None:
        raise SimulationError(
            f"this {self._what} is being advanced by {by}: wait until it has ended,"
            f" or use one {self._what} per thread"
        )


class _Advancing(AbstractContextManager[None]):
    """The context `ExclusiveUse.advancing`."""

    def __init__(self, use: ExclusiveUse) -> None:
        self._use = use

    def __enter__(self) -> None:
        self._use.__enter__()
        self._use._is_advancing = True

    def __exit__(self, *_: object) -> None:
        self._use._is_advancing = False
        self._use.__exit__()
