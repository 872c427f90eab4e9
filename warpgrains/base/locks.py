"""Locks on outputs: if two processes write the same file, the second is refused.

The lock on ``run.npz`` is an exclusive flock(2) on the empty file ``.run.npz.lock`` next to it. The operating
system releases it when the process ends, even if it is killed; a leftover file locks nothing. The lock
belongs to one open file description, so it also excludes other threads of the same process, and a forked
child does not hold it.

Between machines that share a file system, the locks are those of the file system. On NFS, Linux maps flock to
a lock on the server, which survives a crashed machine for the server's grace period. If there are no locks
(some Lustre mounts), a warning says so and the work continues. The locks are advisory: other programs can
still delete or replace the files.
"""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from fcntl import LOCK_EX, LOCK_NB, LOCK_UN, flock, lockf
from functools import partial
from pathlib import Path
from typing import Self
from warnings import warn
from weakref import WeakSet

from warpgrains.base.errors import LockedError, OutputError
from warpgrains.base.files import resolve_link

_WITHOUT_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP)
_LONGEST_NAME = 300  # bytes of the description of a lock's owner


class Lock:
    """Lock on a file: the exclusive right to write to `path`.

    It ends with `release`, at the end of a ``with`` block, or with the process.
    """

    def __init__(self, path: Path) -> None:
        path = resolve_link(path)
        self._file = path.with_name(f".{path.name}.lock")
        self._descriptor: int | None = None
        try:
            self._descriptor = _acquire(self._file, path)
        except OSError as error:
            raise LockedError(f"'{path}' cannot be locked: {error.strerror}") from error
        _held.add(self)

    def release(self) -> None:
        """Release the lock and remove its file."""
        if self._descriptor is None:
            return
        with suppress(OSError):
            self._file.unlink()
        self.forget()

    def forget(self) -> None:
        """Close the lock file, which stays. In a forked child, this leaves the lock to the parent process."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def __del__(self) -> None:
        self.release()


def lock_own(path: Path, is_own: Callable[[Path], bool], kind: str) -> Lock:
    """Return the lock on a file, which must be absent or of the program's kind; OutputError otherwise.

    `is_own` returns whether an existing file is of this kind, and `kind` names it in messages.
    """
    with ExitStack() as held:
        lock = held.enter_context(Lock(path))
        if path.exists() and not (path.is_file() and is_own(path)):
            raise OutputError(f"refusing to overwrite '{path}': not a {kind}")
        held.pop_all()
        return lock


class RunLocks:
    """Locks between processes that share a sweep: run k is locked by byte k of one file (fcntl).

    The locks belong to the process, so they do not exclude its own threads. The file stays empty and is kept.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)

    def acquire(self, numbers: Iterable[int]) -> list[int]:
        """Lock runs, except those that another process holds; return the numbers of the locked runs."""
        lock = partial(lockf, self._descriptor, LOCK_EX | LOCK_NB, 1)
        return [number for number in numbers if _is_locked(partial(lock, number), self._path)]

    def release(self, numbers: Iterable[int]) -> None:
        """Unlock runs, given by their numbers."""
        for number in numbers:
            lockf(self._descriptor, LOCK_UN, 1, number)

    def close(self) -> None:
        """Unlock all runs and close the file."""
        os.close(self._descriptor)


_held: WeakSet[Lock] = WeakSet()


def _forget_all() -> None:
    for lock in list(_held):
        lock.forget()


os.register_at_fork(after_in_child=_forget_all)


def _acquire(file: Path, path: Path) -> int:
    """Return a descriptor of the lock file `file`, locked; LockedError if another process writes `path`.

    If another process deletes the lock file before it is locked, try again.
    """
    while True:
        descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o666)
        with ExitStack() as closing:
            closing.callback(os.close, descriptor)
            if not _is_locked(partial(flock, descriptor, LOCK_EX | LOCK_NB), path):
                holder = os.pread(descriptor, _LONGEST_NAME, 0).decode(errors="replace").strip()
                raise LockedError(f"'{path}' is being written by {holder or 'another process'}")
            if _is_under(file, descriptor):
                os.ftruncate(descriptor, 0)
                os.write(descriptor, f"process {os.getpid()} on {socket.gethostname()}".encode())
                closing.pop_all()
                return descriptor


def _is_locked(lock: Callable[[], None], path: Path) -> bool:
    """Acquire a lock by calling `lock`; return False if another process holds it, else True.

    If the file system has no locks, return True with a warning that names `path`.
    """
    try:
        lock()
    except (BlockingIOError, PermissionError):
        return False
    except OSError as error:
        if error.errno not in _WITHOUT_LOCKS:
            raise
        warn(
            f"the file system of '{path}' does not support locks: make sure that only one process writes it",
            stacklevel=4,
        )
    return True


def _is_under(file: Path, descriptor: int) -> bool:
    """Return whether an open file still has its name. stat could answer from a cache; opening does not."""
    try:
        again = os.open(file, os.O_RDONLY)
    except FileNotFoundError:
        return False
    try:
        return os.path.samestat(os.fstat(again), os.fstat(descriptor))
    finally:
        os.close(again)
