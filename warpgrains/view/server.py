"""A viser server that only its own page can use: other web pages in the browser cannot connect to it."""

from __future__ import annotations

import asyncio
import logging
from contextlib import redirect_stdout
from functools import partial
from http import HTTPStatus
from io import StringIO
from threading import Lock
from typing import Any
from urllib.parse import urlsplit

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

HOST = "127.0.0.1"
OWN_NAMES = (HOST, "localhost", "::1")
"""Host names that the address of the page may have. Any port is allowed, because a tunnel may change it."""
REFUSAL = "only the page that this server serves may connect to it\n"
MALFORMED = 1007  # RFC 6455, 7.4.1: data that is not consistent with the type of the message

_one_at_a_time = Lock()
_silent = logging.Logger("warpgrains.view")  # no handler: viser's has one that prints tracebacks
_silent.addHandler(logging.NullHandler())


def serve_page(port: int, label: str) -> viser.ViserServer:
    """Return a server at a port of this machine, or at the next free port.

    Browsers let any web page connect to any WebSocket, and send the origin of the page in the header
    ``Origin``. Connections from other origins are refused. A malformed message closes its connection.
    """
    with _one_at_a_time, redirect_stdout(StringIO()):  # suppresses its banner
        serve = websockets.asyncio.server.serve
        # viser passes no options to websockets, nor any request to its callbacks
        websockets.asyncio.server.serve = partial(_serve_guarded, serve)  # type: ignore[assignment,misc]
        try:
            return _LocalServer(HOST, port, label=label, verbose=False)
        finally:
            websockets.asyncio.server.serve = serve  # type: ignore[misc]


class _LocalServer(viser.ViserServer):
    """A server that ignores requests of a page to be shared through a public address."""

    def request_share_url(self, verbose: bool = True) -> None:
        return None


def is_own_origin(request: Request) -> bool:
    """Return whether a request comes from the served page: its origin and its host are this machine."""
    hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
    if len(hosts) != 1 or len(origins) != 1:
        return False
    return origins[0] == f"http://{hosts[0]}" and urlsplit(origins[0]).hostname in OWN_NAMES


def _serve_guarded(serve: Any, handler: Any, *where: Any, process_request: Any, **options: Any) -> Any:
    """Call `serve`, the function of websockets, with guarded versions of viser's callbacks.

    The guarded `process_request` refuses connections of other origins. The guarded `handler` prints no
    traceback for malformed messages.
    """

    def answer(connection: ServerConnection, request: Request) -> Response | None:
        if "Upgrade" in request.headers and not is_own_origin(request):
            return connection.respond(HTTPStatus.FORBIDDEN, REFUSAL)
        return process_request(connection, request)

    async def handle(connection: ServerConnection) -> None:
        asyncio.get_running_loop().set_exception_handler(lambda loop, context: None)
        try:
            await handler(connection)
        except Exception:  # an untrusted message can make viser raise any exception
            await connection.close(MALFORMED, "not a message of the page")

    return serve(handle, *where, process_request=answer, logger=_silent, **options)
