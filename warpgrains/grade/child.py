"""The process in which a homework runs (child.c), asked for one call after the other.

What it answers are numbers only, which this process judges: it knows of no expected result but those of the
function that it is to call. Its limits: `Limits`, a megabyte of output, no file, no process, no network.
"""

import os
import select
import struct
import subprocess
from dataclasses import dataclass
from functools import cached_property
from math import inf
from pathlib import Path
from tempfile import TemporaryFile
from time import monotonic
from typing import NamedTuple, Self

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.grade.ended import EndedError, raise_if_ended, reason_of_exit
from warpgrains.grade.processes import Processes

_HEADER = struct.Struct("=iiiid")
_REQUEST = struct.Struct("=ii8d")
_CONFINED, _UPDATES, _ITERATES, _MAIN, _UNGUARDED = 1, 2, 4, 8, 16
_MOST_CALLS = 1024


class Limits(NamedTuple):
    """What a homework may use."""

    megabytes: int = 512
    seconds: float = 2.0
    """CPU time of one call; the reference needs less than a hundredth of it."""
    patience: float = 60.0
    """Wall time of one call [s], on however busy a machine."""
    in_all: float = 300.0
    """Wall time of a homework [s]."""


DEFAULT = Limits()


class Function(NamedTuple):
    """A function of a library."""

    library: Path
    name: str


class Call(NamedTuple):
    """Arguments of a call, and the struct before it.

    `iteration` is that of femGrainsContactIterate; it is below 0 for femGrainsUpdate, which alone has a
    tolerance and a limit of iterations. `state` holds the arrays of `FIELDS`, shape (7 n + n (n - 1) / 2,).
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


@dataclass(frozen=True, eq=False)
class Answer:
    """What a call did.

    Attributes
    ----------
    zeta : float
        Returned by femGrainsContactIterate [m/s].
    calls : int
        Of femGrainsContactIterate by femGrainsUpdate.
    state : ndarray
        The struct's arrays after it.
    before : ndarray
        x, y, vx, vy as the first of these calls found them, shape (4 n,).
    record : ndarray
        iter, dt and zeta of these calls, shape (calls or fewer, 3).
    """

    zeta: float
    calls: int
    state: FloatArray
    before: FloatArray
    record: FloatArray

    def __eq__(self, other: object) -> bool:
        """Whether all bits are the same."""
        return isinstance(other, Answer) and self._bytes == other._bytes

    __hash__ = object.__hash__

    @cached_property
    def _bytes(self) -> bytes:
        numbers = np.array([self.zeta, self.calls])
        return b"".join(part.tobytes() for part in (numbers, self.state, self.before, self.record))


class Child:
    """A process with femGrainsUpdate of one library and femGrainsContactIterate of another.

    Parameters
    ----------
    program : Path
        Of `compile_child`.
    update, contact : Function
    processes : Processes
        Where it is counted.
    limits : Limits
    until : float
        When it must have answered its last call, by `time.monotonic`.

    Attributes
    ----------
    updates, iterates : bool
        Whether the libraries define their functions.
    has_main, is_unguarded : bool
        Whether one defines `main`, or also the function that its marker leaves out.
    confined : bool
        Whether this system can keep it from all but computing.

    Raises
    ------
    EndedError
        It ends while it is loaded.
    """

    def __init__(
        self,
        program: Path,
        update: Function,
        contact: Function,
        processes: Processes,
        limits: Limits = DEFAULT,
        until: float = inf,
    ):
        self._processes, self._limits, self._until = processes, limits, until
        self._printed = TemporaryFile()  # noqa: SIM115  # closed by close
        there, self._ask = os.pipe()
        self._answer, here = os.pipe()
        words = [str(there), str(here), str(update.library), str(contact.library)]
        words += [update.name, contact.name, str(limits.megabytes * 2**20), str(limits.seconds)]
        try:
            self._process = processes.start(
                [str(program), *words],
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
        os.set_blocking(self._ask, False)  # it may not read
        self._start_call()
        try:
            _, has, *_ = self._hear_header()
        except BaseException:
            self.close()
            raise
        self.confined, self.updates, self.iterates, self.has_main, self.is_unguarded = (
            bool(has & bit) for bit in (_CONFINED, _UPDATES, _ITERATES, _MAIN, _UNGUARDED)
        )

    def ask(self, call: Call) -> Answer:
        """Have a call done.

        Raises
        ------
        EndedError
            It does something else.
        """
        numbers = (call.dt, call.tolerance, call.max_iterations, call.radius_in, call.radius_out)
        head = _REQUEST.pack(call.n, call.iteration, *numbers, *call.gravity, call.drag)
        self._start_call()
        self._send(head + call.state.tobytes())
        _, _, _, calls, zeta = self._hear_header()
        state = self._hear_numbers(len(call.state))
        before = self._hear_numbers(4 * call.n)
        record = self._hear_numbers(3 * min(max(calls, 0), _MOST_CALLS)).reshape(-1, 3)
        return Answer(zeta, calls, state, before, record)

    @property
    def printed(self) -> str:
        """The beginning of what it printed."""
        self._printed.seek(0)
        return self._printed.read(2000).decode(errors="replace")

    def _hear_header(self) -> tuple[int, int, int, int, float]:
        header: tuple[int, int, int, int, float] = _HEADER.unpack(self._hear(_HEADER.size))
        raise_if_ended(header[0], header[1], header[2], self._limits.seconds)
        return header

    def _hear_numbers(self, count: int) -> FloatArray:
        return np.frombuffer(self._hear(8 * count), np.float64)

    def _start_call(self) -> None:
        """Begin to measure the wall time of a call."""
        self._call_until = min(self._until, monotonic() + self._limits.patience)

    def _send(self, request: bytes) -> None:
        rest = memoryview(request)
        while rest:
            self._wait_for(self._ask, select.POLLOUT)
            try:
                rest = rest[os.write(self._ask, rest) :]
            except BrokenPipeError:
                raise EndedError(self._reason()) from None

    def _hear(self, length: int) -> bytes:
        heard = bytearray()
        while len(heard) < length:
            self._wait_for(self._answer, select.POLLIN)
            part = os.read(self._answer, length - len(heard))
            if not part:
                raise EndedError(self._reason())
            heard += part
        return bytes(heard)

    def _wait_for(self, pipe: int, event: int) -> None:
        """Wait until a pipe can be read or written."""
        ready = select.poll()
        ready.register(pipe, event)
        if not ready.poll(1e3 * self._left()):
            if self._call_until == self._until:
                raise EndedError(f"takes more than {self._limits.in_all:g} s, compiled and run in all scenes")
            raise EndedError(f"does not answer within {self._limits.patience:g} s")

    def _left(self) -> float:
        """Return the wall time that the call has left [s]."""
        return max(0.0, self._call_until - monotonic())

    def _reason(self) -> str:
        """Say why it has ended without a word."""
        try:
            code = self._process.wait(self._left())
        except subprocess.TimeoutExpired:
            return "closes what is not its own"
        return reason_of_exit(code)

    def close(self) -> None:
        """End it."""
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
