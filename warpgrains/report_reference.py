"""The C reference of the tests, beside which a step is timed; an installed package does not have it."""

import importlib.util
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from warpgrains.reports import State
from warpgrains.scene import Scene

SOURCE = Path(__file__).resolve().parent.parent / "tests" / "c_reference.py"
FLAGS = ("-O3", "-march=native")
MOST_GRAINS = 3000  # it visits all pairs, and keeps a number for each


class CReference(NamedTuple):
    """The reference, or why there is none."""

    start: Callable[[Scene, State], Any] | None
    """Put a scene in some state into it; its `update` takes a step, its `velocity` is what comes of it."""
    status: str


@cache
def find_c_reference() -> CReference:
    """Compile the reference of the checkout that this package belongs to, if it does."""
    spec = importlib.util.spec_from_file_location("warpgrains_c_reference", SOURCE)
    if not SOURCE.is_file() or spec is None or spec.loader is None:
        return CReference(None, "not available (it is part of the source, not of an installed package)")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    with tempfile.TemporaryDirectory() as folder:
        try:
            library = module.build(Path(folder), FLAGS)
        except RuntimeError as error:
            return CReference(None, f"not available ({error})")

    def start(scene: Scene, state: State) -> Any:
        return module.Reference(library, scene, state)

    return CReference(start, f"cc {' '.join(FLAGS)}, all pairs, for scenes of up to {MOST_GRAINS} grains")
