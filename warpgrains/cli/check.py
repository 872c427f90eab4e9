"""The command `check`. A damaged file can crash USD, hang or fill the memory, so a child process reads it."""

import json
import resource
import signal
import subprocess
import sys
from argparse import Namespace
from pathlib import Path

from warpgrains.base.errors import InputError

SECONDS, BYTES = 120.0, 8 * 2**30
"""Limits of time and memory of the child process; each byte of the file adds 1e-6 s and 32 bytes."""


def check(arguments: Namespace) -> bool:
    """Print one line per problem of each recording, or its size if it has none.

    Return whether a recording has problems.
    """
    has_problems = False
    for path in arguments.file:
        try:
            lines = _report_of_child(path)
        except InputError as error:
            if len(arguments.file) == 1:
                raise
            lines = [str(error)]
        print("\n".join(f"{path}: {line}" for line in lines), flush=True)
        has_problems |= not lines[0].startswith("OK: ")
    return has_problems


def _report_of_child(path: str) -> list[str]:
    """Return the result of `report_on_recording`, run in a child process; InputError if that fails."""
    size = Path(path).stat().st_size if Path(path).is_file() else 0
    command = [sys.executable, "-m", "warpgrains.cli.check", path, str(BYTES + 32 * size)]
    seconds = SECONDS + 1e-6 * size
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=seconds)
    except subprocess.TimeoutExpired:
        raise InputError(f"recording '{path}' is damaged: it is not read within {seconds:.0f} s") from None
    if done.returncode < 0:
        how = f"crashes ({signal.Signals(-done.returncode).name})"
        raise InputError(f"recording '{path}' is damaged: its reader {how}")
    if done.returncode:
        reason = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        raise InputError(f"recording '{path}' cannot be read: {reason or 'its reader fails'}")
    answer = json.loads(done.stdout)
    if isinstance(answer, str):
        raise InputError(answer)
    return list(answer)


def _report(path: str, most: int) -> list[str] | str:
    """Return the result of `report_on_recording`, or its error message.

    The process may use at most `most` bytes of memory.
    """
    from warpgrains.usd.check import report_on_recording

    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (most if hard < 0 else min(most, hard), hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        return report_on_recording(path)
    except InputError as error:
        return str(error)


if __name__ == "__main__":
    print(json.dumps(_report(sys.argv[1], int(sys.argv[2]))))
