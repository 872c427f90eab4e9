"""`python -m warpgrains.cli.sandboxed` in forks of one process that has its libraries, to save time.

A fork calls what the command calls, under the same limits. Before it come the imports and USD's look for
plugins, by no thread that a fork would miss; nothing is taken down after.

    python forks.py SOCKET
"""

import json
import os
import select
import signal
import socket
import subprocess
import sys
import traceback
from importlib import import_module
from tempfile import TemporaryFile
from typing import Any, NoReturn, Self

from pxr import Usd, Work

from warpgrains.cli import sandboxed

COMMAND = [sys.executable, "-m", "warpgrains.cli.sandboxed"]


class ForkServer:
    """What `run` is given is done as `subprocess.run` does it; a context that ends with its process."""

    def __init__(self) -> None:
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            number = theirs.fileno()
            self._process = subprocess.Popen([sys.executable, __file__, str(number)], pass_fds=[number])

    def run(
        self, command: list[str], *, timeout: float, stderr: Any, **_: Any
    ) -> subprocess.CompletedProcess[bytes]:
        assert command[:3] == COMMAND
        with TemporaryFile() as output:
            request = json.dumps([command[3:], timeout]).encode()
            socket.send_fds(self._socket, [request], [output.fileno(), stderr.fileno()])
            code = json.loads(self._socket.recv(100))
            if code is None:
                raise subprocess.TimeoutExpired(command, timeout)
            output.seek(0)
            return subprocess.CompletedProcess(command, code, output.read())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
        assert self._process.wait(timeout=60) == 0


def serve(client: socket.socket) -> None:
    """Answer until nobody asks."""
    for library in ("warpgrains.usd.check", "warpgrains.analysis.plots"):
        import_module(library)
    Work.SetConcurrencyLimit(1)
    Usd.SchemaRegistry()
    while True:
        request, streams, _, _ = socket.recv_fds(client, 2**16, 2)
        if not request:
            return
        arguments, seconds = json.loads(request)
        child = os.fork()
        if child == 0:
            _do(arguments, streams)
        for stream in streams:
            os.close(stream)
        client.send(json.dumps(_end(child, seconds)).encode())


def _do(arguments: list[str], streams: list[int]) -> NoReturn:
    code = 1
    try:
        for stream, number in zip((os.open(os.devnull, os.O_RDONLY), *streams), range(3), strict=True):
            os.dup2(stream, number)
        Work.SetMaximumConcurrencyLimit()
        code = sandboxed._main(*arguments)
        sys.stderr.flush()
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


def _end(child: int, seconds: float) -> int | None:
    """Return the exit code of a process, or None if it had to be killed after its time."""
    watched = os.pidfd_open(child)
    has_ended = select.select([watched], [], [], seconds)[0]
    os.close(watched)
    if not has_ended:
        os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status) if has_ended else None


if __name__ == "__main__":
    serve(socket.socket(fileno=int(sys.argv[1])))
