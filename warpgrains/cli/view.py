"""`warpgrains view`: serve a page that plays a scene or a recording."""

import sys
from argparse import Namespace
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from warpgrains.console import start_warp
from warpgrains.drawing.kinds import RECORDINGS
from warpgrains.errors import InputError, missing_extra
from warpgrains.grade.grader import Grader
from warpgrains.grade.sandbox import Processes
from warpgrains.reference.reference import MOST_GRAINS
from warpgrains.scene import checks
from warpgrains.scene.scene import Scene
from warpgrains.usd.reader import RecordingReader
from warpgrains.view.homework import Homework
from warpgrains.view.players import Live, Player, Recorded

if TYPE_CHECKING:
    from warpgrains.view.page import Page


def view(arguments: Namespace) -> bool:
    """Serve the page until Ctrl-C."""
    try:
        import_module("viser")
    except ModuleNotFoundError as error:
        raise missing_extra("view", error, "view") from error
    from warpgrains.view.page import Page

    port = checks.whole_number("--port", arguments.port, most=65535)
    is_recorded = Path(arguments.what).suffix in RECORDINGS
    if arguments.homework is not None:
        if is_recorded:
            raise InputError("--homework needs a scene, not a recording")
        return _homework(arguments, lambda player: _serve(Page, player, port))
    player: Player = _recorded(arguments) if is_recorded else _live(arguments)
    return _serve(Page, player, port)


def _serve(page: type["Page"], player: Player, port: int) -> bool:
    with suppress(KeyboardInterrupt):
        page(player, port).run(_announce)
    return False


def _homework(arguments: Namespace, serve: Callable[[Player], bool]) -> bool:
    scene = Scene.load(arguments.what, arguments.overrides or [])
    is_the_texts = scene.scheme == "text" and scene.wall == "tangent" and scene.radius_in > 0.0
    if not is_the_texts or scene.gravity_rate or scene.n > MOST_GRAINS:
        needs = "scheme text, wall tangent, an inner wall, constant gravity"
        raise InputError(f"--homework needs {needs} and at most {MOST_GRAINS} grains")
    processes = Processes()
    with TemporaryDirectory() as folder:
        grader = Grader(Path(folder), processes=processes)
        for warning in grader.unprotected():
            print(f"warpgrains: warning: {warning}", file=sys.stderr)
        try:
            player = Homework(
                scene, lambda: grader.run(Path(arguments.homework)), f"{scene.name}, {arguments.homework}"
            )
            return serve(player)
        finally:
            processes.stop()


def _announce(url: str) -> None:
    print(f"{url} (R run, S stop, N one step, 0 restart; Ctrl-C here ends it)", flush=True)


def _recorded(arguments: Namespace) -> Recorded:
    if arguments.overrides:
        raise InputError("--set has no effect on a recording")
    return Recorded(RecordingReader(arguments.what), Path(arguments.what).name)


def _live(arguments: Namespace) -> Live:
    scene = Scene.load(arguments.what, arguments.overrides or [])
    start_warp()
    from warpgrains.simulation.simulation import Simulation

    simulation = Simulation(scene)
    simulation.compile()
    return Live(simulation)
