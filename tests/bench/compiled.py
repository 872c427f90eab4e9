"""What the solver is compared with: C, built beside it for this machine."""

import ctypes
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from warpgrains import Scene, State
from warpgrains.arrays import FloatArray
from warpgrains.reference.reference import SOURCE, Grains, Reference

from .inside import Sweeps

FLAGS = ("-O3", "-march=native", "-ffp-contract=off")
COMPILER = f"gcc {' '.join(FLAGS)}"
HERE = Path(__file__).parent
SOURCES = ("run.c", "sweep.c", "neighbors.c")


@cache
def library() -> ctypes.CDLL:
    """Build the reference and the sweep."""
    with tempfile.TemporaryDirectory() as folder:
        built = Path(folder) / "bench.so"
        sources = [str(path) for path in (SOURCE, *(HERE / name for name in SOURCES))]
        subprocess.run(
            ["gcc", *FLAGS, f"-I{SOURCE.parent}", "-shared", "-fPIC", *sources, "-o", str(built), "-lm"],
            check=True,
        )
        loaded = ctypes.CDLL(str(built))
    whole, number, array = ctypes.c_int, ctypes.c_double, ctypes.c_void_p
    loaded.run.restype = None
    loaded.run.argtypes = [ctypes.POINTER(Grains), whole, number, number, number]
    loaded.sweeps.restype = number
    loaded.sweeps.argtypes = [whole, whole, whole, array, array, array]
    loaded.cellList.restype = whole
    loaded.cellList.argtypes = [whole, array, number, number, whole, *[array] * 5]
    loaded.firstFit.restype = whole
    loaded.firstFit.argtypes = [whole, *[array] * 4]
    return loaded


class CReference(Reference):
    """The all-pairs reference as compiled here."""

    def __init__(self, scene: Scene, state: State | None = None):
        super().__init__(library(), scene, state)

    def run(self, steps: int) -> None:
        """Advance by many steps without coming back to Python."""
        scene = self._scene
        self._library.run(self._grains, steps, scene.dt, scene.tolerance, scene.max_iterations)


class CellList:
    """A cell list with first-fit colors.

    Parameters
    ----------
    x : ndarray, shape (n, 2)
        Positions [m].
    reach : float
        Distance within which two grains are a pair [m].
    half : float
        Largest coordinate [m].
    """

    def __init__(self, x: FloatArray, reach: float, half: float):
        n, self._width = len(x), int(2.0 * half / reach)
        self._x, self._reach, self._half = np.ascontiguousarray(x), reach, half * (1.0 + 1e-12)
        self._cell_start = np.empty(self._width**2 + 1, dtype=np.int32)
        self._grains, self._cells = np.empty((2, n), dtype=np.int32)
        self.start, self.neighbors = np.empty(n + 1, dtype=np.int32), np.empty(40 * n, dtype=np.int32)
        self._used, self.color = np.empty(n, dtype=np.uint64), np.empty(40 * n, dtype=np.int32)

    def build(self) -> int:
        """List the pairs, and color them. Returns how many there are."""
        room = (self._cell_start, self._grains, self._cells, self.start, self.neighbors)
        n, x = len(self._x), self._x.ctypes.data
        pairs = library().cellList(n, x, self._reach, self._half, self._width, *(a.ctypes.data for a in room))
        ordered = (self.start, self.neighbors, self._used, self.color)
        library().firstFit(n, *(a.ctypes.data for a in ordered))
        return int(pairs)


def sweep_in_c(arrays: Sweeps, count: int) -> float:
    """Sweep the solver's own arrays so often, in their order; return the last zeta [m/s]."""
    swept = (array.ctypes.data for array in (arrays.contact, arrays.dv, arrays.velocity))
    return library().sweeps(count, arrays.pairs, arrays.walls, *swept)
