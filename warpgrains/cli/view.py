"""`warpgrains view`: serve a page that plays a scene or a recording."""

import sys
from argparse import Namespace
from contextlib import ExitStack, suppress
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

from warpgrains.base import checks
from warpgrains.base.errors import InputError, requiring
from warpgrains.base.files import suffix_of
from warpgrains.base.warp_start import start_warp
from warpgrains.drawing.kinds import RECORDINGS
from warpgrains.grade.grader import Grader
from warpgrains.grade.sandbox import Processes
from warpgrains.reference.reference import MOST_GRAINS
from warpgrains.scene.scene import Scene
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
        raise InputError("--homework needs a scene, not a recording")
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
    others = len(scene.written_walls)
    lacking = {
        f"scheme is {scene.scheme!r}": scene.scheme != "euler",
        f"wall is {scene.wall!r}": scene.wall != "tangent",
        f"radius_in is {scene.radius_in} m": scene.radius_in == 0.0,
        f"gravity.angular_velocity is {scene.gravity_rate} rad/s": scene.gravity_rate,
        f"friction is {scene.friction}": scene.friction,
        f"wall_friction is {scene.wall_friction}": scene.wall_friction,
        f"restitution is {scene.restitution}": scene.restitution,
        f"wall_restitution is {scene.wall_restitution}": scene.wall_restitution,
        f"spin_drag is {scene.spin_drag} kg m2/s": scene.spin_drag,
        f"pressure is {scene.pressure} N/m": scene.pressure is not None,
        f"walls has {others} entries": others,
        f"the scene has {scene.n} grains": scene.n > MOST_GRAINS,
    }
    for what, is_lacking in lacking.items():
        if is_lacking:
            raise InputError(
                f"{what}: --homework needs scheme euler, wall tangent, an inner wall, constant gravity, no"
                f" friction, restitution, pressure or other walls, and at most {MOST_GRAINS} grains"
            )


def _recorded(arguments: Namespace) -> Replay:
    if arguments.overrides:
        raise InputError("--set has no effect on a recording")
    return Replay(Recording(arguments.what))


def _live(arguments: Namespace) -> Live:
    scene = Scene.load(arguments.what, arguments.overrides or [])
    start_warp()
    from warpgrains.simulation.simulation import Simulation

    simulation = Simulation(scene)
    simulation.compile()
    return Live(simulation)
