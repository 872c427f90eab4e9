"""The process in which a homework runs (child.c), asked for one call after the other.

What it answers are numbers only, which this process judges: it knows of no expected result but those of the
function that it is to call. Its limits: `Limits`, a megabyte of output, no file, no process, no network.
"""

import os
import select
import signal
import struct
import subprocess
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryFile
from typing import NamedTuple, Self

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.grade.ended import EndedError, raise_if_ended, reason_of_exit

_HEADER = struct.Struct("=iiiid")
_REQUEST = struct.Struct("=ii8d")
_CONFINED, _UPDATES, _ITERATES = 1, 2, 4
_MOST_CALLS = 1024
_PATIENCE = 60.0  # seconds of the clock, on however busy a machine


class Limits(NamedTuple):
    """What a homework may use."""

    megabytes: int = 512
    seconds: float = 2.0
    """Of computing, for one call; the reference needs less than a hundredth of it."""


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
    limits : Limits

    Attributes
    ----------
    updates, iterates : bool
        Whether the libraries define their functions.
    confined : bool
        Whether this system can keep it from all but computing.

    Raises
    ------
    EndedError
        It ends while it is loaded.
    """

    def __init__(self, program: Path, update: Function, contact: Function, limits: Limits = DEFAULT):
        self._printed = TemporaryFile()  # noqa: SIM115  # closed by close
        there, self._ask = os.pipe()
        self._answer, here = os.pipe()
        words = [str(there), str(here), str(update.library), str(contact.library)]
        words += [update.name, contact.name, str(limits.megabytes * 2**20), str(limits.seconds)]
        self._process = subprocess.Popen(
            [str(program), *words],
            pass_fds=(there, here),
            stdin=subprocess.DEVNULL,
            stdout=self._printed,
            stderr=self._printed,
            cwd=program.parent,
            env={},
            start_new_session=True,
        )
        os.close(there)
        os.close(here)
        self._limits = limits
        try:
            _, has, *_ = self._hear_header()
        except BaseException:
            self.close()
            raise
        self.confined, self.updates, self.iterates = (
            bool(has & bit) for bit in (_CONFINED, _UPDATES, _ITERATES)
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
        try:
            os.write(self._ask, head + call.state.tobytes())
        except BrokenPipeError:
            raise EndedError(self._reason()) from None
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

    def _hear(self, length: int) -> bytes:
        heard = bytearray()
        ready = select.poll()
        ready.register(self._answer, select.POLLIN)
        while len(heard) < length:
            if not ready.poll(1e3 * _PATIENCE):
                raise EndedError(f"does not answer within {_PATIENCE:g} s")
            part = os.read(self._answer, length - len(heard))
            if not part:
                raise EndedError(self._reason())
            heard += part
        return bytes(heard)

    def _reason(self) -> str:
        """Say why it has ended without a word."""
        try:
            code = self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            return "closes what is not its own"
        return reason_of_exit(code)

    def close(self) -> None:
        """End it."""
        os.close(self._ask)
        os.close(self._answer)
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._printed.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
