"""What commands print: standard output is for results only, whatever libraries print, from C as well."""

import ctypes
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from tempfile import TemporaryFile

NO_DRIVER = "Could not find or load the NVIDIA CUDA driver"

STDOUT, STDERR = 1, 2


def in_columns(rows: Mapping[str, object]) -> str:
    """Return names and values, a line each, as commands print them."""
    return "\n".join(f"{name:<17} {value}" for name, value in rows.items())


@contextmanager
def stdout_kept_clean() -> Iterator[None]:
    """Send to standard error what anyone prints on standard output meanwhile."""
    with _redirected(STDOUT, STDERR):
        yield


def start_warp() -> None:
    """Initialise Warp without its banner, and without its remark that this machine has no GPU."""
    import warp

    warp.config.log_level = warp.LOG_WARNING
    warp.config.use_precompiled_headers = False  # they cost more than they save where one kernel is compiled
    with TemporaryFile() as remarks:
        with _redirected(STDERR, remarks.fileno()):
            warp.init()
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
