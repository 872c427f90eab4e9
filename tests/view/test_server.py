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

VERSION = f"viser-v{viser.__version__}"


def opened(port, host="127.0.0.1", **options):
    """Connect as a page does that was opened under a host name; the connection goes to this machine."""
    own = {"origin": f"http://{host}:{port}", "subprotocols": [VERSION], "open_timeout": 60, "max_size": None}
    tcp = socket.create_connection(("127.0.0.1", port))
    return connect(f"ws://{host}:{port}", sock=tcp, **own | options)


@pytest.fixture(scope="module")
def port():
    page = Simulation(Scene.load("annulus")).view(port=8330)
    yield int(page.url.rpartition(":")[2])
    page.close()


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_the_page_itself_connects(port, host):
    with opened(port, host) as page:
        assert len(page.recv(timeout=60)) > 100


def test_the_page_connects_through_a_forwarded_port(port):
    tcp = socket.create_connection(("127.0.0.1", port))
    own = {"origin": "http://localhost:9000", "subprotocols": [VERSION], "max_size": None}
    with connect("ws://localhost:9000", sock=tcp, **own) as page:
        assert len(page.recv(timeout=60)) > 100


@pytest.mark.parametrize(
    ("host", "origin"),
    [
        ("127.0.0.1", "http://evil.example"),
        ("127.0.0.1", "http://127.0.0.1:9999"),  # another page of this machine
        ("127.0.0.1", "http://127.0.0.1"),
        ("127.0.0.1", "null"),  # a file, or a frame without an origin
        ("127.0.0.1", None),
        ("evil.example", "http://evil.example:{port}"),  # a name that was made to point here
        ("127.0.0.1.evil.example", "http://127.0.0.1.evil.example:{port}"),
    ],
)
def test_other_origins_are_refused(port, host, origin):
    with pytest.raises(InvalidStatus) as refusal:
        opened(port, host, origin=origin and origin.format(port=port))
    assert refusal.value.response.status_code == 403
    assert b"only the page that this server serves" in refusal.value.response.body


UPDATE = {"type": "GuiUpdateMessage", "uuid": "none", "updates": {}}
MESSAGES = [
    "text",
    b"",
    b"\xc1\xff",
    *map(msgspec.msgpack.encode, [7, {}, {"type": "NoMessage"}, {"type": "GuiUpdateMessage"}, UPDATE]),
]


def sliders(page):
    """Return the identifiers of all that takes a value in the page."""
    found = set()
    for _ in range(40):
        try:
            raw = page.recv(timeout=2.0)
        except TimeoutError:
            break
        size = int.from_bytes(raw[8:16], "little")
        inner = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(raw[16 : 16 + size]))
        found |= {one["uuid"] for one in inner["messages"] if "uuid" in one}
    return found


def test_a_page_opens_no_tunnel(port, monkeypatch):
    """Viser's would make the page public, on a server of its own."""
    opened_to = []
    monkeypatch.setattr("viser._viser.ViserTunnel", lambda *given: opened_to.append(given))
    with opened(port) as page:
        page.send(msgspec.msgpack.encode({"type": "ShareUrlRequest"}))
        sliders(page)
    assert not opened_to


def test_malformed_messages_and_an_interrupt_print_no_traceback():
    command = [sys.executable, "-m", "warpgrains", "view", "annulus", "--port", "8340"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    port = int(process.stdout.readline().split()[0].rpartition(":")[2])
    twice = b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n"
    for garbage in (b"hello\r\n\r\n", b"\x16\x03\x01" + bytes(64), twice):
        with socket.create_connection(("127.0.0.1", port)) as tcp:
            tcp.sendall(garbage)
            tcp.settimeout(1.0)
            with suppress(TimeoutError):
                tcp.recv(1000)
    for message in MESSAGES:
        with opened(port) as page:
            page.send(message)
            with suppress(ConnectionClosed, TimeoutError):
                while True:
                    page.recv(timeout=0.3)
    with opened(port) as page:
        known = sliders(page)
        assert len(known) > 10
        for uuid in known:
            for updates in (*({"value": odd} for odd in ("x", float("nan"), 1e300, None)), {"nothing": 1}):
                page.send(msgspec.msgpack.encode({**UPDATE, "uuid": uuid, "updates": updates}))
    with opened(port) as page:  # it goes on
        assert sliders(page) == known
    process.send_signal(signal.SIGINT)
    printed, complaint = process.communicate(timeout=100)
    assert (process.returncode, printed, complaint) == (0, "", "")
