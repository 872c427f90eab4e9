"""Commands for recordings (`recover`, `plot`, `export`), `compress` and `pack`, and the `report`."""

import json
import warnings
from argparse import Namespace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpgrains.base.console import in_columns, stdout_to_stderr
from warpgrains.base.errors import InputError, requiring, written_as
from warpgrains.base.files import require_writable_path, suffix_of
from warpgrains.base.shown import number_of
from warpgrains.base.warp_start import start_warp
from warpgrains.drawing.kinds import FILMS, form_of
from warpgrains.drawing.looks import Looks, with_style
from warpgrains.scene.fields import KEY_OF
from warpgrains.scene.scene import Scene
from warpgrains.scene.toml import shipped_scenes
from warpgrains.simulation.options import FLAGS

if TYPE_CHECKING:
    from warpgrains.packings.compress import Packing
    from warpgrains.packings.pack import Settled

_PACKED = {name: f"--{name}" for name in ("pressure", "duration", "steps", "threads")} | {
    "gravity": KEY_OF["gravity"]
}
"""Names of parameters of `compress` and `pack` as users write them: options, and a key of scene files."""


def recover(arguments: Namespace) -> bool:
    from warpgrains.usd.recorder import recover

    path, frames = recover(arguments.log)
    print(f"{path}: {number_of(frames, 'frame')}")
    return False


@written_as(FLAGS | {"frames": "--frames"})
def plot(arguments: Namespace) -> bool:
    output = arguments.output or str(Path(arguments.file).with_suffix(".png"))
    is_history = suffix_of(arguments.file) == ".csv"
    is_film = not is_history and form_of(output) in FILMS
    with requiring("plot", "film" if is_film else "report"):
        plots = import_module(f"warpgrains.{'pictures.film' if is_film else 'analysis.plots'}")
    given = {name: getattr(arguments, name) for name in (*Looks.__annotations__, "style")}
    given = {name: value for name, value in given.items() if value is not None}
    kind = "history" if is_history else "film" if is_film else "picture"
    if kind != "picture" and (arguments.frames is not None or not arguments.curves):
        raise InputError(f"--frames and --no-curves have no effect on a {kind}")
    for name in given:
        if is_history or (kind == "picture" and name in ("fps", "slow")):
            raise InputError(f"--{name.replace('_', '-')} has no effect on a {kind}")
    if is_history:
        print(f"{output}: {number_of(len(plots.plot_history(arguments.file, output)), 'step')}")
        return False
    looks: Any = with_style(given, given.pop("style", None))
    if is_film:
        print(f"{output}: {number_of(len(plots.draw_film(arguments.file, output, True, **looks)), 'frame')}")
        return False
    numbers = plots.plot(arguments.file, output, arguments.frames, arguments.curves, **looks)
    print(f"{output}: frame{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}")
    return False


def export(arguments: Namespace) -> bool:
    from warpgrains.analysis.vtk import export

    output = arguments.output or str(Path(arguments.file).with_suffix(".pvd"))
    print(f"{output}: {number_of(export(arguments.file, output), 'frame')}")
    return False


@written_as(_PACKED)
def compress(arguments: Namespace) -> bool:
    """Compress the grains of a scene, and print the properties of the packing."""
    scene = _scene_to_pack(arguments, "checkpoint", ".npz")
    with stdout_to_stderr(), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # the results say whether the grains are at rest
        start_warp()
        from warpgrains.packings.compress import compress

        packing = compress(scene, arguments.pressure, arguments.duration, progress=True)
        if arguments.output is not None:
            packing.simulation.save(arguments.output)
    return _print_packing(arguments, packing, packing.run.seconds)


@written_as(_PACKED)
def pack(arguments: Namespace) -> bool:
    """Let the grains of a scene settle, and print the properties of the packing."""
    scene = _scene_to_pack(arguments, "packing", ".npz", ".csv")
    with stdout_to_stderr():
        start_warp()
        from warpgrains.packings.pack import pack

        rest = pack(scene, arguments.steps, progress=True, threads=arguments.threads)
        if arguments.output is not None:
            rest.save(arguments.output)
    return _print_packing(arguments, rest, rest.seconds)


def _scene_to_pack(arguments: Namespace, kind: str, *suffixes: str) -> Scene:
    """Return the scene that the arguments name, after checking that its packing can be saved.

    The check comes before hours of work. `kind` names the packing in messages, and its file must have one of
    `suffixes`.
    """
    scene = Scene.load(arguments.scene, arguments.overrides or [])
    if arguments.output is not None:
        require_writable_path(kind, Path(arguments.output), *suffixes)
    return scene


def _print_packing(arguments: Namespace, packing: "Packing | Settled", seconds: float) -> bool:
    time = {"time": f"{seconds:.2f} s", "output": arguments.output or "none (-o saves one)"}
    results = packing.results() | {"output": arguments.output}
    print(json.dumps(results) if arguments.json else in_columns(packing.summary() | time))
    return False


def report(arguments: Namespace) -> bool:
    """Measure speed against error of scenes, and print the names of the written files."""
    with requiring("report"):
        for library in ("matplotlib", "scipy", "clarabel"):
            import_module(library)
    scenes = [Scene.load(name) for name in arguments.scenes or shipped_scenes()]
    with stdout_to_stderr(), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a trajectory may start with small overlaps
        start_warp()
        from warpgrains.report.report import why_not, write_report

        if not arguments.scenes:
            scenes = [scene for scene in scenes if not why_not(scene)]
        scenes = [scene.replace(on_unconverged="report") for scene in scenes]
        written = write_report(scenes, Path(arguments.output), progress=True)
    print("\n".join(map(str, written)))
    return False
