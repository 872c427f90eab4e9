"""The C reference, beside which a step is timed where there is a C compiler."""

import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

from warpgrains.reference.reference import Reference, build
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import State

FLAGS = ("-O3", "-march=native")
MOST_GRAINS = 3000  # it visits all pairs, and keeps a number for each


class CReference(NamedTuple):
    """The reference, or why there is none."""

    start: Callable[[Scene, State], Reference] | None
    """Put a scene in some state into it; its `update` takes a step, its `velocity` is what comes of it."""
    status: str


@cache
def find_c_reference() -> CReference:
    """Compile the reference, if there is a C compiler."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            library = build(Path(folder), FLAGS)
        except RuntimeError as error:
            return CReference(None, f"not available ({error})")

    def start(scene: Scene, state: State) -> Reference:
        return Reference(library, scene, state)

    return CReference(start, f"cc {' '.join(FLAGS)}, all pairs, for scenes of up to {MOST_GRAINS} grains")
