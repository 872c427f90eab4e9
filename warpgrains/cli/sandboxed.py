"""Functions that read untrusted USD files, executed in a subprocess with limits on time and memory.

USD follows references, opens the files that they name, and descends as deep as a file is nested. A malicious
file can hang, fill the memory or crash its reader; here it does so in the subprocess only.

    python -m warpgrains.cli.sandboxed FUNCTION '{"path": ...}'
"""

import errno
import json
import os
import resource
import signal
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from warpgrains.errors import InputError

SECONDS = 120.0
SECONDS_A_BYTE = 1e-6
SECONDS_A_FRAME = 0.25
BYTES = 8 * 2**30
BYTES_A_BYTE = 32
"""Limits of a reader, and their increase per byte of the file, and per frame that it draws."""
BYTES_A_FRAME = 300  # in a file, of few grains

_REMARKS = 65536  # bytes of the subprocess's standard error that are shown
_BAD_INPUT, _NOT_WRITTEN = 2, 3


def run_sandboxed(function: str, path: str, drawn: int | None = 0, **arguments: Any) -> Any:
    """Call a function, such as "usd.check.report_on_recording", with a recording, in a subprocess.

    It draws `drawn` frames, or all with None.

    Raises
    ------
    InputError
        The function raised it, or the subprocess crashed or reached a limit.
    OSError
        An output of the function cannot be written.
    """
    size = Path(path).stat().st_size if Path(path).is_file() else 0
    given = json.dumps({"path": path, **arguments})
    most = str(BYTES + BYTES_A_BYTE * size)
    command = [sys.executable, "-m", "warpgrains.cli.sandboxed", function, most, given]
    frames = size // BYTES_A_FRAME if drawn is None else drawn
    seconds = SECONDS + SECONDS_A_BYTE * size + SECONDS_A_FRAME * frames
    with TemporaryFile() as remarks:
        try:
            done = subprocess.run(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=remarks, timeout=seconds
            )
        except subprocess.TimeoutExpired:
            late = f"could not be read, or drawn, within {seconds:.0f} s"
            raise InputError(f"recording '{path}' {late}") from None
        if done.returncode == _BAD_INPUT:
            raise InputError(json.loads(done.stdout))
        if done.returncode == _NOT_WRITTEN:
            raise OSError(json.loads(done.stdout))
        if done.returncode != 0:
            raise InputError(f"recording '{path}' cannot be read: its reader {_end(done.returncode)}")
        remarks.seek(0)
        sys.stderr.write(remarks.read(_REMARKS).decode(errors="replace"))
    return json.loads(done.stdout)


def _end(code: int) -> str:
    return f"crashed ({signal.Signals(-code).name})" if code < 0 else "ran out of memory, or failed"


def _limit_memory(most: int) -> None:
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    most = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(resource.RLIMIT_AS, (most, hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _main(function: str, most: str, arguments: str) -> int:
    """Call the function, and print its result or its error as JSON."""
    result = os.dup(1)
    os.dup2(2, 1)
    _limit_memory(int(most))
    module, _, name = function.rpartition(".")
    given, code = json.loads(arguments), 0
    path = given.pop("path")
    try:
        from warpgrains.usd.reader import refusing_untrusted_content

        with refusing_untrusted_content(path):
            answer = getattr(import_module(f"warpgrains.{module}"), name)(path, **given)
    except InputError as error:
        answer, code = str(error), _BAD_INPUT
    except (MemoryError, OSError) as error:
        answer, code = str(error), _NOT_WRITTEN
        if isinstance(error, MemoryError) or error.errno == errno.ENOMEM:
            answer, code = f"recording '{path}' takes more memory than its size allows", _BAD_INPUT
    os.write(result, json.dumps(answer).encode())
    return code


if __name__ == "__main__":
    sys.exit(_main(*sys.argv[1:]))
