"""What commands print: standard output is for results only, whatever libraries print, from C as well."""

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from tempfile import TemporaryFile
from typing import NoReturn

NO_DRIVER = "Could not find or load the NVIDIA CUDA driver"

STDOUT, STDERR = 1, 2


def in_columns(rows: Mapping[str, object]) -> str:
    """Return names and values, a line each, as commands print them."""
    return "\n".join(f"{name:<17} {value}" for name, value in rows.items())


def open_standard_streams() -> None:
    """Open what is closed of input, output and errors: else the next file to be opened would be it."""
    for number, name, mode in ((0, "stdin", "r"), (STDOUT, "stdout", "w"), (STDERR, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, closefd=False))  # noqa: SIM115  # as long as the process


@contextmanager
def interrupts_end_at_once(code: int) -> Iterator[None]:
    """Let Ctrl-C end the process: libraries that are being imported turn it into errors of their own."""

    def end(*_: object) -> NoReturn:
        os.write(STDERR, b"warpgrains: error: interrupted\n")
        os._exit(code)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def stdout_kept_clean() -> Iterator[None]:
    """Send to standard error what anyone prints on standard output meanwhile."""
    with _redirected(STDOUT, STDERR):
        yield


def start_warp() -> None:
    """Initialise Warp without its banner, and without its remark that this machine has no GPU."""
    import warp

    warp.config.log_level = warp.LOG_WARNING
    with TemporaryFile() as remarks:
        try:
            with _redirected(STDERR, remarks.fileno()):
                warp.init()
        except OSError as error:
            raise OSError(
                f"the cache of compiled kernels cannot be written ({error}):"
                " set WARP_CACHE_PATH to a folder that can"
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
