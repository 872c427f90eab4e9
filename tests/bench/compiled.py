"""What the solver is compared with: C, built beside it for this machine."""

import ctypes
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from warpgrains import Scene, State
from warpgrains.reference.reference import SOURCE, Grains, Reference

from .inside import Sweeps

FLAGS = ("-O3", "-march=native", "-ffp-contract=off")
COMPILER = f"gcc {' '.join(FLAGS)}"
HERE = Path(__file__).parent


@cache
def library() -> ctypes.CDLL:
    """Build the reference and the sweep."""
    with tempfile.TemporaryDirectory() as folder:
        built = Path(folder) / "bench.so"
        sources = [str(path) for path in (SOURCE, HERE / "run.c", HERE / "sweep.c")]
        subprocess.run(
            ["gcc", *FLAGS, f"-I{SOURCE.parent}", "-shared", "-fPIC", *sources, "-o", str(built), "-lm"],
            check=True,
        )
        loaded = ctypes.CDLL(str(built))
    whole, number, array = ctypes.c_int, ctypes.c_double, ctypes.c_void_p
    loaded.run.restype = None
    loaded.run.argtypes = [ctypes.POINTER(Grains), whole, number, number, number]
    loaded.sweeps.restype = number
    loaded.sweeps.argtypes = [whole, whole, array, array, whole, array, array]
    return loaded


class CReference(Reference):
    """The all-pairs reference as compiled here."""

    def __init__(self, scene: Scene, state: State | None = None):
        super().__init__(library(), scene, state)

    def run(self, steps: int) -> None:
        """Advance by many steps without coming back to Python."""
        scene = self._scene
        self._library.run(self._grains, steps, scene.dt, scene.tolerance, scene.max_iterations)


def sweep_in_c(arrays: Sweeps, count: int) -> float:
    """Sweep the solver's own arrays so often, in their order; return the last zeta [m/s]."""
    pairs, dv, walls, velocity = (
        array.ctypes.data for array in (arrays.pairs, arrays.pair_dv, arrays.walls, arrays.velocity)
    )
    return library().sweeps(count, len(arrays.pairs), pairs, dv, len(arrays.walls), walls, velocity)
