"""`warpgrains view`: a page that plays a scene or a recording."""

from argparse import Namespace
from contextlib import suppress
from importlib import import_module
from pathlib import Path

from warpgrains.console import start_warp
from warpgrains.errors import SceneError, missing_extra
from warpgrains.scene import checks
from warpgrains.scene.scene import Scene
from warpgrains.usd.output import SUFFIXES
from warpgrains.usd.reader import RecordingReader
from warpgrains.view.players import Live, Player, Recorded


def view(arguments: Namespace) -> bool:
    """Serve the page until Ctrl-C."""
    try:
        import_module("viser")
    except ModuleNotFoundError as error:
        raise missing_extra("view", error, "view") from error
    from warpgrains.view.page import Page

    port = checks.whole_number("--port", arguments.port, most=65535)
    player: Player = _recorded(arguments) if Path(arguments.what).suffix in SUFFIXES else _live(arguments)
    with suppress(KeyboardInterrupt):
        Page(player, port).run(_announce)
    return False


def _announce(url: str) -> None:
    print(f"{url} (R run, S stop, N one step, 0 restart; Ctrl-C here ends it)", flush=True)


def _recorded(arguments: Namespace) -> Recorded:
    if arguments.overrides:
        raise SceneError("--set has no effect on a recording")
    return Recorded(RecordingReader(arguments.what), Path(arguments.what).name)


def _live(arguments: Namespace) -> Live:
    scene = Scene.load(arguments.what, arguments.overrides or [])
    start_warp()
    from warpgrains.simulation.simulation import Simulation

    simulation = Simulation(scene)
    simulation.compile()
    return Live(simulation)
