"""Output of commands, progress bars and signals.

Standard output is for results only. Whatever libraries print, also from C, goes to standard error.
"""

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from math import inf
from time import monotonic
from typing import Any, NoReturn, Protocol

from warpgrains.base import checks

BETWEEN_LINES = 30.0  # seconds between two lines, without a terminal
INTERRUPTED = 130
"""Exit code of a command that Ctrl-C ended."""

STDIN, STDOUT, STDERR = 0, 1, 2
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def in_columns(rows: Mapping[str, object]) -> str:
    """Return names and values as text, one line each."""
    return "\n".join(f"{name:<17} {value}" for name, value in rows.items())


def printable(text: str) -> str:
    """Escape characters that could control a terminal, and bytes that are not UTF-8, as Python does."""
    return "".join(
        letter if letter.isprintable() or letter in "\n\t" else _escaped(letter) for letter in text
    )


def _escaped(letter: str) -> str:
    is_byte = "\udc80" <= letter <= "\udcff"  # see PEP 383
    return f"\\x{ord(letter) - 0xDC00:02x}" if is_byte else letter.encode("unicode_escape").decode()


def open_standard_streams() -> None:
    """Open standard streams that are closed, so that no file opened later gets their descriptors."""
    for number, name, mode in ((STDIN, "stdin", "r"), (STDOUT, "stdout", "w"), (STDERR, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, closefd=False))  # noqa: SIM115  # stays open until the process ends


class Progress(Protocol):
    """Interface of progress bars."""

    def update(self, n: float = 1) -> Any:
        """Add n units of progress."""

    def set_postfix_str(self, s: str) -> None:
        """Set the text after the bar."""


class ProgressLines:
    """Progress as a plain line on standard error at intervals, for logs."""

    def __init__(self, total: int, initial: float, unit: str, between: float) -> None:
        self._total, self._done, self._begun_at, self._unit = total, float(initial), initial, unit
        self._between, self._doing = between, ""
        self._start = self._told = monotonic()

    def set_postfix_str(self, s: str) -> None:
        """Set the text at the end of the line."""
        self._doing = f", {s}"

    def update(self, n: float = 1) -> None:
        """Add n units of progress."""
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
    """Yield a progress bar in a terminal or a notebook, and elsewhere one that prints a line every 30 s.

    `total` and `initial` are counts of `unit`. If not `shown`, nothing is printed. `options` are those of
    tqdm.
    """
    if not checks.boolean("progress", shown) or not (sys.stderr.isatty() or "ipykernel" in sys.modules):
        yield ProgressLines(total, initial, unit, BETWEEN_LINES if shown else inf)
        return
    from tqdm.auto import tqdm

    with tqdm(total=total, initial=initial, unit=unit, **options) as bar:
        yield bar


@contextmanager
def exit_on_interrupt() -> Iterator[None]:
    """End the process at once on Ctrl-C while libraries are imported.

    An import would turn the interrupt into another error.
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
def stop_on_signals(stop: Callable[[], None]) -> Iterator[None]:
    """Call `stop` on Ctrl-C, SIGTERM or SIGHUP. After such a signal, the process ends after the block.

    In other threads than the main one, do nothing.
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


def stdout_to_stderr() -> AbstractContextManager[None]:
    """Redirect standard output to standard error, also that of C libraries."""
    return redirected(STDOUT, STDERR)


@contextmanager
def redirected(stream: int, target: int) -> Iterator[None]:
    """Redirect the descriptor `stream`, a standard stream, to the file of `target` in a block.

    `target` is a descriptor, too. Output of C libraries is also redirected.
    """
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
    ctypes.CDLL(None).fflush(None)
