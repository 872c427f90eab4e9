"""What commands print: standard output is for results only, whatever libraries print, from C as well."""

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from math import inf
from tempfile import TemporaryFile
from time import monotonic
from typing import Any, NoReturn, Protocol

from warpgrains.turns import BUILDING

BETWEEN_LINES = 30.0  # seconds, where no terminal can show a bar
INTERRUPTED = 130
"""Exit code of a command that Ctrl-C has ended."""
NO_DRIVER = "Could not find or load the NVIDIA CUDA driver"

STDIN, STDOUT, STDERR = 0, 1, 2
_ENDING = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


def in_columns(rows: Mapping[str, object]) -> str:
    """Return names and values, a line each, as commands print them."""
    return "\n".join(f"{name:<17} {value}" for name, value in rows.items())


def open_standard_streams() -> None:
    """Open what is closed of input, output and errors: else the next file to be opened would be it."""
    for number, name, mode in ((STDIN, "stdin", "r"), (STDOUT, "stdout", "w"), (STDERR, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, closefd=False))  # noqa: SIM115  # as long as the process


class Progress(Protocol):
    """Hears how far something is."""

    def update(self, n: float = 1) -> Any:
        """Hear that so much more is done."""

    def set_postfix_str(self, s: str) -> None:
        """Hear what is being done."""


class ProgressLines:
    """A plain line on standard error now and then: what logs can hold."""

    def __init__(self, total: int, initial: float, unit: str, between: float) -> None:
        self._total, self._done, self._begun_at, self._unit = total, float(initial), initial, unit
        self._between, self._doing = between, ""
        self._start = self._told = monotonic()

    def set_postfix_str(self, s: str) -> None:
        """Hear what is being done."""
        self._doing = f", {s}"

    def update(self, n: float = 1) -> None:
        """Hear that so much more is done."""
        self._done += n
        now = monotonic()
        if now - self._told < self._between or self._done <= self._begun_at:
            return
        self._told, gone = now, now - self._start
        left = gone * (self._total - self._done) / (self._done - self._begun_at)
        line = (
            f"{self._done:.0f} of {self._total} {self._unit}s, {gone:.0f} s, {left:.0f} s left{self._doing}"
        )
        print(line, file=sys.stderr, flush=True)


@contextmanager
def progress_bar(
    total: int, initial: float = 0, shown: bool = True, unit: str = "step", **options: Any
) -> Iterator[Progress]:
    """Give something that tells of progress: a bar in a terminal or a notebook, else a line every 30 s."""
    if not shown or not (sys.stderr.isatty() or "ipykernel" in sys.modules):
        yield ProgressLines(total, initial, unit, BETWEEN_LINES if shown else inf)
        return
    from tqdm.auto import tqdm

    with tqdm(total=total, initial=initial, unit=unit, **options) as bar:
        yield bar


@contextmanager
def interrupts_end_at_once() -> Iterator[None]:
    """Let Ctrl-C end the process while libraries are imported, which turn it into errors of their own.

    Afterwards it does what it did before, even if one of them has set a handler.
    """

    def end(*_: object) -> NoReturn:
        os.write(STDERR, b"warpgrains: error: interrupted\n")
        os._exit(INTERRUPTED)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def stopping_on_signals(stop: Callable[[], None]) -> Iterator[None]:
    """Call `stop` on Ctrl-C, SIGTERM and SIGHUP; what is in the block then ends, and so does the command.

    No signal interrupts the block itself, so that its contexts clean up, also if a signal comes as they do.
    """
    received: list[int] = []

    def on_signal(number: int, _frame: object) -> None:
        received.append(number)
        stop()

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in _ENDING}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, on_signal)
    try:
        yield
    except Exception:
        if not received:
            raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if signal.SIGINT in received:
        raise KeyboardInterrupt
    if received:
        sys.exit(128 + received[0])


@contextmanager
def stdout_kept_clean() -> Iterator[None]:
    """Send to standard error what anyone prints on standard output meanwhile."""
    with _redirected(STDOUT, STDERR):
        yield


def start_warp() -> None:
    """Initialise Warp without its banner, and without its remark that this machine has no GPU.

    It also says no more which modules it loads, unless its `log_level` has been set.
    """
    with BUILDING:
        _start_warp()


@cache
def _start_warp() -> None:
    import warp

    if warp.config.log_level == warp.LOG_INFO:
        warp.config.log_level = warp.LOG_WARNING
    warp.config.use_precompiled_headers = False  # they cost more than they save where one kernel is compiled
    with TemporaryFile() as remarks:
        try:
            with _redirected(STDERR, remarks.fileno()):
                warp.init()
        except OSError as error:
            raise OSError(
                f"the cache of compiled kernels cannot be written ({error}):"
                " set WARP_CACHE_PATH to a writable folder"
            ) from error
        remarks.seek(0)
        for remark in remarks.read().decode(errors="replace").splitlines():
            if NO_DRIVER not in remark:
                print(remark, file=sys.stderr)


@contextmanager
def _redirected(stream: int, target: int) -> Iterator[None]:
    _flush()
    kept = os.dup(stream)
    os.dup2(target, stream)
    try:
        yield
    finally:
        _flush()
        os.dup2(kept, stream)
        os.close(kept)


def _flush() -> None:
    sys.stdout.flush()
    sys.stderr.flush()
    ctypes.CDLL("ucrtbase" if os.name == "nt" else None).fflush(None)
