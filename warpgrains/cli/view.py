"""`warpgrains view`: serve a page that plays a scene or a recording."""

import sys
from argparse import Namespace
from contextlib import ExitStack, suppress
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from warpgrains.base import checks
from warpgrains.base.errors import InputError, requiring
from warpgrains.base.files import suffix_of
from warpgrains.base.warp_start import start_warp
from warpgrains.drawing.kinds import RECORDINGS
from warpgrains.grade.grader import Grader
from warpgrains.grade.sandbox import Processes
from warpgrains.reference.reference import MOST_GRAINS
from warpgrains.scene.fields import KEY_OF
from warpgrains.scene.scene import Scene
from warpgrains.scene.toml import toml_value
from warpgrains.usd.recording import Recording
from warpgrains.view.homework import Homework
from warpgrains.view.players import Live, Player, Replay


def view(arguments: Namespace) -> bool:
    """Serve the page until Ctrl-C."""
    with requiring("view", "view"):
        import_module("viser")
    from warpgrains.view.page import KEYS, Page

    port = checks.whole_number("--port", arguments.port, most=65535)
    is_recorded = suffix_of(arguments.what) in RECORDINGS
    if is_recorded and arguments.homework is not None:
        raise InputError(f"--homework needs a scene: '{arguments.what}' is a recording")
    player: Player
    with ExitStack() as held:
        if arguments.homework is not None:
            player = _homework(arguments, held)
        else:
            player = _recorded(arguments) if is_recorded else _live(arguments)
        keys = ", ".join(f"{key} {name}" for key, name in KEYS.items())
        with suppress(KeyboardInterrupt):
            Page(player, port).run(lambda url: print(f"{url} ({keys}; Ctrl-C here ends it)", flush=True))
    return False


def _homework(arguments: Namespace, held: ExitStack) -> Homework:
    """Return the player of a homework, which runs it in other processes. They end when `held` is closed."""
    scene = Scene.load(arguments.what, arguments.overrides or [])
    _require_the_texts(scene)
    folder, processes = held.enter_context(TemporaryDirectory()), Processes()
    held.callback(processes.stop)
    grader = Grader(Path(folder), processes=processes)
    for warning in grader.unprotected():
        print(f"warpgrains: warning: {warning}", file=sys.stderr)
    return Homework(
        scene, lambda: grader.run(Path(arguments.homework)), f"{scene.name}, {arguments.homework}"
    )


def _require_the_texts(scene: Scene) -> None:
    """Raise InputError unless the program of the course text can compute the scene.

    It needs an annulus with an inner wall and no other walls, Euler's scheme, at most `MOST_GRAINS` grains,
    and neither friction nor restitution.
    """
    wanted: dict[str, Any] = {"scheme": "euler", "wall": "tangent", "gravity_rate": 0.0, "pressure": None}
    wanted |= dict.fromkeys(
        ("friction", "wall_friction", "restitution", "wall_restitution", "spin_drag"), 0.0
    )
    for name, value in wanted.items():
        if (own := getattr(scene, name)) not in (value, None):
            key = KEY_OF.get(name, "physics.gravity.angular_velocity")
            told = "none" if value is None else toml_value(value)
            raise InputError(f"{key} is {toml_value(own)}: --homework needs {told}")
    lacking = {
        "the scene has no inner wall": scene.radius_in == 0.0,
        f"the scene has {len(scene.written_walls)} [[walls]]": bool(scene.written_walls),
        f"the scene has {scene.n} grains": scene.n > MOST_GRAINS,
    }
    for what, is_lacking in lacking.items():
        if is_lacking:
            told = f"an annulus with an inner wall, no other walls and at most {MOST_GRAINS} grains"
            raise InputError(f"{what}: --homework needs {told}, such as the scene annulus")


def _recorded(arguments: Namespace) -> Replay:
    if arguments.overrides:
        raise InputError(f"--set has no effect on a recording, '{arguments.what}': give its scene")
    return Replay(Recording(arguments.what))


def _live(arguments: Namespace) -> Live:
    scene = Scene.load(arguments.what, arguments.overrides or [])
    start_warp()
    from warpgrains.simulation.simulation import Simulation

    simulation = Simulation(scene)
    simulation.compile()
    return Live(simulation)
