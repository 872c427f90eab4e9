"""Rigid grains in an annulus or a box, with or without friction, by nonsmooth contact dynamics.

>>> import warpgrains as wg
>>> simulation = wg.Simulation(wg.Scene.load("annulus"))
>>> summary = simulation.run(duration=8.0)
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0"

# In a checkout `kernels/` and `scenes/` are next to this package, in a wheel inside it (pyproject.toml).
_checkout = Path(__file__).resolve().parent.parent
if not (Path(__file__).parent / "kernels").is_dir() and (_checkout / "kernels" / "__init__.py").is_file():
    __path__.append(str(_checkout))

if TYPE_CHECKING:
    from warpgrains import accuracy, analysis
    from warpgrains.base.errors import InputError, NoAreaError, OutputError, SimulationError
    from warpgrains.batch.batch import Batch
    from warpgrains.packings.compress import Packing, compress
    from warpgrains.packings.pack import Settled, pack
    from warpgrains.packings.separate import Separation, separate
    from warpgrains.scene.layouts import random_layout
    from warpgrains.scene.scene import Scene
    from warpgrains.scene.sources import Sink, Source
    from warpgrains.scene.state import State
    from warpgrains.simulation.simulation import Simulation
    from warpgrains.solver.statistics import StepReport, Summary
    from warpgrains.usd.recording import Recording
    from warpgrains.walls.arc import Arc
    from warpgrains.walls.box import Box
    from warpgrains.walls.disc import Disc
    from warpgrains.walls.line import Line
    from warpgrains.walls.polyline import Polyline
    from warpgrains.walls.row import Row
    from warpgrains.walls.segment import Segment

__all__ = [
    "Arc",
    "Batch",
    "Box",
    "Disc",
    "InputError",
    "Line",
    "NoAreaError",
    "OutputError",
    "Packing",
    "Polyline",
    "Recording",
    "Row",
    "Scene",
    "Segment",
    "Separation",
    "Settled",
    "Simulation",
    "SimulationError",
    "Sink",
    "Source",
    "State",
    "StepReport",
    "Summary",
    "accuracy",
    "analysis",
    "compress",
    "pack",
    "random_layout",
    "separate",
]

_NAMES = {
    "packings.compress": ("Packing", "compress"),
    "packings.pack": ("Settled", "pack"),
    "packings.separate": ("Separation", "separate"),
    "usd.recording": ("Recording",),
    "batch.batch": ("Batch",),
    "base.errors": ("InputError", "NoAreaError", "OutputError", "SimulationError"),
    "walls.arc": ("Arc",),
    "walls.box": ("Box",),
    "walls.disc": ("Disc",),
    "walls.line": ("Line",),
    "walls.polyline": ("Polyline",),
    "walls.row": ("Row",),
    "scene.layouts": ("random_layout",),
    "scene.scene": ("Scene",),
    "walls.segment": ("Segment",),
    "scene.sources": ("Sink", "Source"),
    "scene.state": ("State",),
    "simulation.simulation": ("Simulation",),
    "solver.statistics": ("StepReport", "Summary"),
}
_HOME = {name: home for home, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that the command line starts without loading Warp."""
    if name in __all__ and name not in _HOME:
        return import_module(f"warpgrains.{name}")
    if name not in _HOME:
        raise AttributeError(f"module 'warpgrains' has no attribute {name!r}")
    return getattr(import_module(f"warpgrains.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*__all__, *(name for name in globals() if name.startswith("__"))])
