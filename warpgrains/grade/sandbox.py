"""The sandbox: a process (sandbox.c) that executes a homework and answers one call after the other.

The child returns numbers only, and the parent judges them. The child contains no expected result except those
of the reference function that it calls. `Limits` bound its time and memory. It can print 8 megabytes, and has
no access to files, other processes and the network.
"""

import ctypes
import os
import re
import signal
import socket
import struct
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from math import inf
from pathlib import Path
from tempfile import TemporaryFile
from threading import Lock
from time import monotonic
from typing import Any, NamedTuple, Self

import numpy as np

from warpgrains.base.arrays import FloatArray
from warpgrains.grade.words import Words

UPDATE, CONTACT = "femGrainsUpdate", "femGrainsContactIterate"
FIELDS = ("x", "y", "vx", "vy", "r", "m", "dvBoundary", "dvContacts")
"""Arrays of `femGrains` in the order of a state."""
_PROTOCOL = (Path(__file__).parent / "protocol.h").read_text()
_KINDS, _USES, _FEATURES = (words.split(", ") for words in re.findall(r"enum { (.*) };", _PROTOCOL))
_HEADER = struct.Struct("=iiiid")
RECORDED = int(_PROTOCOL.partition("RECORDED ")[2].split()[0])

_FORBIDDEN = {
    "FILES": "opens or changes a file",
    "PROCESSES": "starts a process or a thread",
    "NETWORK": "opens a network connection",
    "MEMORY": "uses more memory than allowed",
    "ABORT": "aborts (a failed assert, or memory freed twice or written beyond its end)",
    "TERMINAL": "reads the keyboard or asks for a terminal (getchar, scanf, isatty)",
    "WAITING": "waits (sleep, usleep)",
    "SIGNALS": "sends a signal (kill)",
}
_CRASHES = {
    "SIGSEGV": "crashes: reads or writes outside of its memory, or calls itself without end (SIGSEGV)",
    "SIGFPE": "crashes: divides a whole number by zero (SIGFPE)",
}
_EXITS = {
    "SIGXFSZ": "prints more than 8 megabytes",
    "SIGXCPU": "computes for too long",
    "SIGKILL": "computes for too long",
    "SIGSYS": "makes a system call that is not allowed, such as starting a program",
}


class EndedError(Exception):
    """Failure of a homework to answer.

    `how` is the kind of failure as a number, which model.c also uses: k >= 0 for index k beyond the end of
    `dvContacts`, -3 - k for index k beyond another array, -2 for an endless loop, -1 for any other failure.
    """

    def __init__(self, english: str, how: int = -1, **values: object):
        self.words, self.how = Words(english, **values), how
        super().__init__(self.words)


class StoppedError(Exception):
    """Attempt to start a process after `Processes.stop`."""


class Processes:
    """Collection of running processes, each in its own session, so that it can be ended with its children."""

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
    """CPU time of one call [s]; the reference needs less than 1 % of it."""
    patience: float = 60.0
    """Wall time of one call [s], which suffices also on a busy machine."""
    total: float = 300.0
    """Wall time of a homework [s]."""


DEFAULT = Limits()


class Request(ctypes.Structure):
    """Parameters of a call as the child receives them (protocol.h)."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("n", "iter", "times")),
        *((name, ctypes.c_double) for name in ("dt", "tol", "iterMax", "radiusIn", "radiusOut")),
        ("gravity", ctypes.c_double * 2),
        ("gamma", ctypes.c_double),
    )


class Call(NamedTuple):
    """Arguments of a call of one of the two functions, and the content of the struct before the call."""

    n: int
    iteration: int
    """Argument `iter` of femGrainsContactIterate; negative for a call of femGrainsUpdate."""
    dt: float
    tolerance: float
    max_iterations: float
    radius_in: float
    radius_out: float
    gravity: tuple[float, float]
    drag: float
    state: FloatArray
    """Arrays of `FIELDS`, shape (7 n + n (n - 1) / 2,)."""
    times: int = 1
    """Number of repetitions of the call, all from this state. The answer is that of the last one."""

    def request(self) -> Request:
        """Return the call without its state, as the sandboxed process receives it."""
        n, iteration, *numbers, (x, y), drag, _, times = self
        return Request(n, iteration, times, *numbers, (x, y), drag)


@dataclass(frozen=True, eq=False)
class Answer:
    """Result of a call."""

    zeta: float
    """Return value of femGrainsContactIterate [m/s]."""
    calls: int
    """Number of calls of femGrainsContactIterate that femGrainsUpdate did."""
    state: FloatArray
    """Arrays of the struct after the call, as in `Call.state`."""
    before: FloatArray
    """Arrays x, y, vx, vy when femGrainsUpdate first calls femGrainsContactIterate, shape (4 n,)."""
    record: FloatArray
    """iter, dt and zeta of the first 1024 calls that `calls` counts, shape (k, 3)."""

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
    """Sandboxed process that loads a library for each of the two functions, and answers calls.

    `program` is the compiled sandbox.c, and `libraries` holds the libraries by function. All calls must be
    answered before `until`, a time of `time.monotonic` [s]. Raises EndedError if the process ends while it
    loads the libraries.
    """

    def __init__(
        self,
        program: Path,
        libraries: Mapping[str, Path],
        processes: Processes,
        limits: Limits = DEFAULT,
        *,
        until: float = inf,
    ):
        self._processes, self._limits, self._until = processes, limits, until
        self._channel, there = socket.socketpair()
        self._printed = TemporaryFile()  # noqa: SIM115  # closed by close
        own = there.fileno(), libraries[UPDATE], libraries[CONTACT], limits.megabytes * 2**20, limits.seconds
        try:
            self._process = processes.start(
                [str(program), *map(str, own)],
                pass_fds=(there.fileno(),),
                stdout=self._printed,
                stderr=self._printed,
                cwd=program.parent,
                env={},
            )
        except BaseException:
            self._close_files()
            raise
        finally:
            there.close()
        self._start_call()
        try:
            what, _, _ = self._receive_header()
        except BaseException as error:
            self.close()
            if isinstance(error, EndedError):
                said = "{does} (when it is loaded, before any call)"
                raise EndedError(said, does=error.words) from None
            raise
        has = {name: bool(what >> bit & 1) for bit, name in enumerate(_FEATURES)}
        self.confined, self.updates, self.iterates = has["CONFINED"], has["UPDATES"], has["ITERATES"]
        self.has_main, self.is_unguarded = has["MAIN"], has["UNGUARDED"]

    def ask(self, call: Call) -> Answer:
        """Return the result of a call. Raises EndedError if the homework does not answer."""
        self._start_call()
        with self._limited():
            self._channel.sendall(bytes(call.request()) + call.state.tobytes())
        _, calls, zeta = self._receive_header()
        state, before = self._receive_numbers(len(call.state)), self._receive_numbers(4 * call.n)
        record = self._receive_numbers(3 * min(max(calls, 0), RECORDED)).reshape(-1, 3)
        return Answer(zeta, calls, state, before, record)

    @property
    def printed(self) -> str:
        """The first 2000 bytes that the process has printed, as text."""
        self._printed.seek(0)
        return self._printed.read(2000).decode(errors="replace")

    def _receive_header(self) -> tuple[int, int, float]:
        """Return the fields `what`, `calls` and `zeta` of the head of an answer (protocol.h).

        Raises EndedError if the message reports a failure.
        """
        number, what, where, calls, zeta = _HEADER.unpack(self._receive(_HEADER.size))
        match _KINDS[number] if 0 <= number < len(_KINDS) else "":
            case "ANSWERED":
                return what, calls, zeta
            case "CALLED":
                use = _USES[what] if 0 <= what < len(_USES) else ""
                other = "makes system call {where}, which is not allowed"
                raise EndedError(_FORBIDDEN.get(use, other), where=where)
            case "CRASHED":
                raise _crash(what)
            case "OUTSIDE":
                name = FIELDS[what] if 0 <= what < len(FIELDS) else "an array"
                said = "reads or writes {name}[{where}], which is outside of the array"
                how = -1 if where < 0 else where if name == FIELDS[-1] else -3 - where
                raise EndedError(said, how, name=name, where=where)
            case "CHANGED":
                raise EndedError("changes n, radiusIn, radiusOut, gravity, gamma or a pointer of the struct")
            case "TOO_LONG":
                said, seconds = "does not end within {seconds} s: an endless loop", self._limits.seconds
                raise EndedError(said, -2, seconds=f"{seconds:g}")
        raise EndedError("sends an invalid answer")

    def _receive_numbers(self, count: int) -> FloatArray:
        return np.frombuffer(self._receive(8 * count), np.float64)

    def _start_call(self) -> None:
        """Start to measure the wall time of a call, which `_limited` limits."""
        self._call_until = min(self._until, monotonic() + self._limits.patience)

    def _receive(self, length: int) -> bytes:
        received = bytearray()
        while len(received) < length:
            with self._limited():
                part = self._channel.recv(length - len(received))
            if not part:
                raise self._reason()
            received += part
        return bytes(received)

    @contextmanager
    def _limited(self) -> Iterator[None]:
        """Limit the wall time of a transfer over the channel, which is the ``with`` block.

        Raises EndedError if the transfer takes longer or fails.
        """
        self._channel.settimeout(max(1e-3, self._call_until - monotonic()))  # 0 would not wait at all
        try:
            yield
        except TimeoutError:
            if self._call_until == self._until:
                limit = f"{self._limits.total:g}"
                raise EndedError(
                    "takes more than {seconds} s to compile and run in all scenes", seconds=limit
                ) from None
            limit = f"{self._limits.patience:g}"
            raise EndedError("does not answer within {seconds} s", seconds=limit) from None
        except ConnectionError:
            raise self._reason() from None

    def _reason(self) -> EndedError:
        """Return the reason why the process ended without an answer."""
        try:
            code = self._process.wait(max(0.0, self._call_until - monotonic()))
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
        self._channel.close()
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
