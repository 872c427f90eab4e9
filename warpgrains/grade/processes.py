"""Processes that run at once and end together."""

import os
import signal
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from threading import Lock
from typing import Any


class StoppedError(Exception):
    """The processes have been stopped: no further one starts."""


class Processes:
    """Processes in sessions of their own; `stop` ends all of them, also those that they started."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._running: set[subprocess.Popen[bytes]] = set()
        self._is_stopped = False

    def start(self, command: Sequence[str], **options: Any) -> subprocess.Popen[bytes]:
        """Start a process, with the options of `subprocess.Popen`; raise StoppedError after `stop`."""
        with self._lock:
            if self._is_stopped:
                raise StoppedError
            process = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True, **options)
            self._running.add(process)
        return process

    def end(self, process: subprocess.Popen[bytes]) -> None:
        """End a process and its children, and wait for it."""
        _kill(process)
        process.wait()
        with self._lock:
            self._running.discard(process)

    def stop(self) -> None:
        """End all processes, and let none start from now on."""
        with self._lock:
            self._is_stopped = True
            for process in self._running:
                _kill(process)


def _kill(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
