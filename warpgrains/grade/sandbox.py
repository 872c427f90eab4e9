"""The sandbox: a process (sandbox.c) that executes a homework and answers one call after the other.

The child returns numbers only, and the parent judges them. The sandbox contains no expected result except
those of the reference function that it calls. It is limited by `Limits`, to a megabyte of output, and has no
access to files, processes and the network.
"""

import ctypes
import os
import select
import signal
import struct
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from math import inf
from pathlib import Path
from tempfile import TemporaryFile
from threading import Lock
from time import monotonic
from typing import Any, NamedTuple, Self

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.grade.words import Words

UPDATE, CONTACT = "femGrainsUpdate", "femGrainsContactIterate"
FIELDS = ("x", "y", "vx", "vy", "r", "m", "dvBoundary", "dvContacts")
"""Arrays of `femGrains` in the order of a state."""
MOST_CALLS = 1024
"""Largest number of calls of femGrainsContactIterate that an answer records."""

_HEADER = struct.Struct("=iiiid")
_CONFINED, _UPDATES, _ITERATES, _MAIN, _UNGUARDED = 1, 2, 4, 8, 16

_ANSWERED, _CALLED, _CRASHED, _OUTSIDE, _CHANGED, _TOO_LONG = range(6)
_FORBIDDEN = (
    "opens or changes a file",
    "starts a process or a thread",
    "opens a network connection",
    "uses more memory than allowed",
    "aborts (a failed assert, or memory freed twice or written beyond its end)",
    "reads the keyboard or asks for a terminal (getchar, scanf, isatty)",
    "waits (sleep, usleep)",
    "sends a signal (kill)",
)
_CRASHES = {
    "SIGSEGV": "crashes: reads or writes outside of its memory, or calls itself without end (SIGSEGV)",
    "SIGFPE": "crashes: divides a whole number by zero (SIGFPE)",
}
_EXITS = {
    "SIGXFSZ": "prints more than a megabyte",
    "SIGXCPU": "computes for too long",
    "SIGKILL": "computes for too long",
    "SIGSYS": "makes a system call that is not allowed, such as starting a program",
}


class EndedError(Exception):
    """Failure of a homework to answer.

    `how` says the same to model.c: an index beyond `dvContacts`, -3 - k for an index k beyond another array,
    -2 for an endless loop, and otherwise -1.
    """

    def __init__(self, english: str, how: int = -1, **values: object):
        self.words = Words(english, **values)
        self.how = how
        super().__init__(self.words)


class StoppedError(Exception):
    """The processes have been stopped, so that none can start any more."""


class Processes:
    """Processes in separate sessions; `stop` ends all of them with their children."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._running: set[subprocess.Popen[bytes]] = set()
        self._is_stopped = False

    def start(self, command: Sequence[str], **options: Any) -> subprocess.Popen[bytes]:
        """Start a process with options of `subprocess.Popen`. Raises StoppedError after `stop`."""
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
        """End all processes, and prevent new ones."""
        with self._lock:
            self._is_stopped = True
            for process in self._running:
                _kill(process)


def _kill(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


class Limits(NamedTuple):
    """Limits of a homework: memory [MB], and time [s]."""

    megabytes: int = 512
    seconds: float = 2.0
    """CPU time of one call; the reference needs less than 1 % of it."""
    patience: float = 60.0
    """Wall time of one call, also on a busy machine."""
    total: float = 300.0
    """Wall time of a homework."""


DEFAULT = Limits()


class Request(ctypes.Structure):
    """Numbers of a call, as sandbox.c and model.c read them."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("n", "iter")),
        *((name, ctypes.c_double) for name in ("dt", "tol", "iterMax", "radiusIn", "radiusOut")),
        ("gravity", ctypes.c_double * 2),
        ("gamma", ctypes.c_double),
    )


class Call(NamedTuple):
    """Arguments of a call, and the struct before it.

    `iteration` is the argument of femGrainsContactIterate. It is negative for calls of femGrainsUpdate, and
    only these have a tolerance and a limit of iterations. `state` holds the arrays of `FIELDS`, shape (7 n +
    n (n - 1) / 2,).
    """

    n: int
    iteration: int
    dt: float
    tolerance: float
    max_iterations: float
    radius_in: float
    radius_out: float
    gravity: tuple[float, float]
    drag: float
    state: FloatArray

    def request(self) -> Request:
        """Return all but the state."""
        *numbers, (x, y), drag, _ = self
        return Request(*numbers, (x, y), drag)


@dataclass(frozen=True, eq=False)
class Answer:
    """Result of a call."""

    zeta: float
    """Return value of femGrainsContactIterate [m/s]."""
    calls: int
    """Number of calls of femGrainsContactIterate by femGrainsUpdate."""
    state: FloatArray
    """Arrays of the struct after the call."""
    before: FloatArray
    """x, y, vx, vy before the first of these calls, shape (4 n,)."""
    record: FloatArray
    """iter, dt and zeta of the recorded calls, shape (calls or fewer, 3)."""

    def __eq__(self, other: object) -> bool:
        """Return whether all bits are equal."""
        return isinstance(other, Answer) and self.bytes == other.bytes

    __hash__ = object.__hash__

    @cached_property
    def bytes(self) -> bytes:
        """All numbers as bytes."""
        numbers = np.array([self.zeta, self.calls])
        return b"".join(part.tobytes() for part in (numbers, self.state, self.before, self.record))


class Child:
    """Sandboxed process with femGrainsUpdate of one library and femGrainsContactIterate of another.

    Parameters
    ----------
    program : Path
        The program from `compile_child`.
    libraries : mapping
        The libraries that define `UPDATE` and `CONTACT`.
    processes : Processes
        Group of processes that it joins.
    limits : Limits
    until : float
        Time of `time.monotonic` before which it must have answered its last call.

    Attributes
    ----------
    updates, iterates : bool
        Whether the libraries define their functions.
    has_main, is_unguarded : bool
        Whether a library defines `main`, or the function that its macro should exclude.
    confined : bool
        Whether this system can restrict it to computing.

    Raises
    ------
    EndedError
        It ends while it loads the libraries.
    """

    def __init__(
        self,
        program: Path,
        libraries: Mapping[str, Path],
        processes: Processes,
        limits: Limits = DEFAULT,
        until: float = inf,
    ):
        self._processes, self._limits, self._until = processes, limits, until
        self._printed = TemporaryFile()  # noqa: SIM115  # closed by close
        there, self._ask = os.pipe()
        self._answer, here = os.pipe()
        words = (there, here, libraries[UPDATE], libraries[CONTACT], limits.megabytes * 2**20, limits.seconds)
        try:
            self._process = processes.start(
                [str(program), *map(str, words)],
                pass_fds=(there, here),
                stdout=self._printed,
                stderr=self._printed,
                cwd=program.parent,
                env={},
            )
        except BaseException:
            self._close_files()
            raise
        finally:
            os.close(there)
            os.close(here)
        os.set_blocking(self._ask, False)  # the process may not read its input
        self._start_call()
        try:
            has, _, _ = self._receive_header()
        except EndedError as error:
            self.close()
            raise EndedError("{does} (when it is loaded, before any call)", does=error.words) from None
        except BaseException:
            self.close()
            raise
        self.confined, self.updates, self.iterates, self.has_main, self.is_unguarded = (
            bool(has & bit) for bit in (_CONFINED, _UPDATES, _ITERATES, _MAIN, _UNGUARDED)
        )

    def ask(self, call: Call) -> Answer:
        """Return the result of a call.

        Raises
        ------
        EndedError
            The process ends, or violates the protocol, instead of answering.
        """
        self._start_call()
        self._send(bytes(call.request()) + call.state.tobytes())
        _, calls, zeta = self._receive_header()
        state, before = self._receive_numbers(len(call.state)), self._receive_numbers(4 * call.n)
        record = self._receive_numbers(3 * min(max(calls, 0), MOST_CALLS)).reshape(-1, 3)
        return Answer(zeta, calls, state, before, record)

    @property
    def printed(self) -> str:
        """The beginning of its output."""
        self._printed.seek(0)
        return self._printed.read(2000).decode(errors="replace")

    def _receive_header(self) -> tuple[int, int, float]:
        """Return `what`, `calls` and `zeta` of an answer (sandbox.c). Raises EndedError if it is none."""
        kind, what, where, calls, zeta = _HEADER.unpack(self._receive(_HEADER.size))
        if kind == _CALLED:
            known = 0 <= what < len(_FORBIDDEN)
            raise EndedError(
                _FORBIDDEN[what] if known else "makes system call {where}, which is not allowed", where=where
            )
        if kind == _CRASHED:
            raise _crash(what)
        if kind == _OUTSIDE:
            name = FIELDS[what] if 0 <= what < len(FIELDS) else "an array"
            said = "reads or writes {name}[{where}], which is outside of the array"
            how = -1 if where < 0 else where if name == FIELDS[-1] else -3 - where
            raise EndedError(said, how, name=name, where=where)
        if kind == _CHANGED:
            raise EndedError("changes n, radiusIn, radiusOut, gravity, gamma or a pointer of the struct")
        if kind == _TOO_LONG:
            raise EndedError(
                "does not end within {seconds} s: an endless loop", -2, seconds=f"{self._limits.seconds:g}"
            )
        if kind != _ANSWERED:
            raise EndedError("sends an invalid answer")
        return what, calls, zeta

    def _receive_numbers(self, count: int) -> FloatArray:
        return np.frombuffer(self._receive(8 * count), np.float64)

    def _start_call(self) -> None:
        """Start to measure the wall time of a call."""
        self._call_until = min(self._until, monotonic() + self._limits.patience)

    def _send(self, request: bytes) -> None:
        rest = memoryview(request)
        while rest:
            self._wait_for(self._ask, select.POLLOUT)
            try:
                rest = rest[os.write(self._ask, rest) :]
            except BrokenPipeError:
                raise self._reason() from None

    def _receive(self, length: int) -> bytes:
        received = bytearray()
        while len(received) < length:
            self._wait_for(self._answer, select.POLLIN)
            part = os.read(self._answer, length - len(received))
            if not part:
                raise self._reason()
            received += part
        return bytes(received)

    def _wait_for(self, pipe: int, event: int) -> None:
        """Wait until a pipe can be read or written."""
        ready = select.poll()
        ready.register(pipe, event)
        if not ready.poll(1e3 * self._left()):
            if self._call_until == self._until:
                limit = f"{self._limits.total:g}"
                raise EndedError(
                    "takes more than {seconds} s to compile and run in all scenes", seconds=limit
                )
            raise EndedError("does not answer within {seconds} s", seconds=f"{self._limits.patience:g}")

    def _left(self) -> float:
        """Return the remaining wall time of the call [s]."""
        return max(0.0, self._call_until - monotonic())

    def _reason(self) -> EndedError:
        """Return the reason why the process ended without an answer."""
        try:
            code = self._process.wait(self._left())
        except subprocess.TimeoutExpired:
            return EndedError("closes files that it did not open")
        if code >= 0:
            return EndedError("ends the program: exit({code})", code=code)
        name = _name(-code)
        return EndedError(_EXITS[name]) if name in _EXITS else _crash(-code)

    def close(self) -> None:
        """End the process."""
        self._processes.end(self._process)
        self._close_files()

    def _close_files(self) -> None:
        os.close(self._ask)
        os.close(self._answer)
        self._printed.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _crash(number: int) -> EndedError:
    name = _name(number)
    return EndedError(_CRASHES[name]) if name in _CRASHES else EndedError("crashes ({name})", name=name)


def _name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
