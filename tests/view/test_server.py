"""Who may connect to the page, and what becomes of messages that are none: a raw client of its WebSocket."""

import signal
import socket
import subprocess
import sys
from contextlib import suppress

import msgspec
import pytest
import viser
import zstandard
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from warpgrains import Scene, Simulation


def opened(port, host="127.0.0.1:{port}", **options):
    """Connect as a page does that was opened under a name; the connection goes to this machine."""
    host = host.format(port=port)
    own = {"origin": f"http://{host}", "subprotocols": [f"viser-v{viser.__version__}"], "max_size": None}
    tcp = socket.create_connection(("127.0.0.1", port))
    return connect(f"ws://{host}", sock=tcp, open_timeout=60, **own | options)


def encoded(kind, **fields):
    return msgspec.msgpack.encode({"type": kind, **fields})


def sliders(page, expected=None):
    """Return the identifiers of all that takes a value in the page; read until they are those expected."""
    found = set()
    with suppress(TimeoutError):
        while found != expected:
            raw = page.recv(timeout=1.0 if expected is None else 60.0)
            size = int.from_bytes(raw[8:16], "little")
            inner = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(raw[16 : 16 + size]))
            found |= {one["uuid"] for one in inner["messages"] if "uuid" in one}
    return found


@pytest.fixture(scope="module")
def port():
    page = Simulation(Scene.load("annulus")).view(port=8330)
    yield int(page.url.rpartition(":")[2])
    page.close()


@pytest.mark.parametrize("host", ["127.0.0.1:{port}", "localhost:{port}", "localhost:9000"])
def test_the_page_itself_connects(port, host):
    """Also through a forwarded port."""
    with opened(port, host) as page:
        assert len(page.recv(timeout=60)) > 100


@pytest.mark.parametrize(
    ("host", "origin"),
    [
        ("127.0.0.1:{port}", "http://evil.example"),
        ("127.0.0.1:{port}", "http://127.0.0.1:9999"),  # another page of this machine
        ("127.0.0.1:{port}", "http://127.0.0.1"),
        ("127.0.0.1:{port}", "null"),  # a file, or a frame without an origin
        ("127.0.0.1:{port}", None),
        ("127.0.0.1.evil.example:{port}", "http://127.0.0.1.evil.example:{port}"),  # made to point here
    ],
)
def test_other_origins_are_refused(port, host, origin):
    with pytest.raises(InvalidStatus) as refusal:
        opened(port, host, origin=origin and origin.format(port=port))
    assert refusal.value.response.status_code == 403
    assert b"only the page that this server serves" in refusal.value.response.body


def test_a_page_opens_no_tunnel(port, monkeypatch):
    """Viser's would make the page public, on a server of its own."""
    opened_to = []
    monkeypatch.setattr("viser._viser.ViserTunnel", lambda *given: opened_to.append(given))
    with opened(port) as page:
        page.send(encoded("ShareUrlRequest"))
        sliders(page)
    assert not opened_to


NO_REQUESTS = (b"hello\r\n\r\n", b"\x16\x03\x01" + bytes(64), b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n")
NO_MESSAGES = (
    *("text", b"", b"\xc1\xff", msgspec.msgpack.encode(7), msgspec.msgpack.encode({})),
    *(
        encoded("NoMessage"),
        encoded("GuiUpdateMessage"),
        encoded("GuiUpdateMessage", uuid="none", updates={}),
    ),
)


def test_malformed_messages_and_an_interrupt_print_no_traceback():
    command = [sys.executable, "-m", "warpgrains", "view", "annulus", "--port", "8340"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    port = int(process.stdout.readline().split()[0].rpartition(":")[2])
    for garbage in NO_REQUESTS:
        with socket.create_connection(("127.0.0.1", port), timeout=60) as tcp:
            tcp.sendall(garbage)
            tcp.shutdown(socket.SHUT_WR)
            while tcp.recv(1000):
                pass
    for message in NO_MESSAGES:
        with opened(port) as page, suppress(ConnectionClosed):
            page.send(message)
    with opened(port) as page:
        known = sliders(page)
        assert len(known) > 10
        for uuid in known:
            for updates in (*({"value": odd} for odd in ("x", float("nan"), 1e300, None)), {"nothing": 1}):
                page.send(encoded("GuiUpdateMessage", uuid=uuid, updates=updates))
    with opened(port) as page:  # it goes on
        assert sliders(page, known) == known
    process.send_signal(signal.SIGINT)
    printed, complaint = process.communicate(timeout=100)
    assert (process.returncode, printed, complaint) == (0, "", "")
