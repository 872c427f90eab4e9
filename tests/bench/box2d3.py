"""The common flowing scene in Box2D 3, compiled for this machine from its source."""

import ctypes
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from warpgrains import Scene
from warpgrains.arrays import FloatArray

from .against_c import FLAGS
from .peer_programs import FRAME, corners

STIFFEST = 1e9  # Hz: Box2D lowers it to an eighth of the rate of sub-steps


class Box2d3:
    """Box2D 3: soft contacts in sub-steps; lengths scaled, and walls made of segments, as for Box2D 2.3.

    Contacts are found `steps` times a frame, each of `substeps` sub-steps; with more than one search, they
    are as stiff as they can be. Without the folder of its `source`, this is an ImportError.
    """

    def __init__(self, scene: Scene, source: Path | None, steps: int, substeps: int):
        self._library, self._steps, self._substeps = _library(source), steps, substeps
        self._n, self._scale = len(scene.radius), 0.5 / float(scene.radius[0])
        gravity = (self._scale * g for g in scene.gravity)
        hertz = STIFFEST if steps > 1 else 0.0
        self._discs = self._library.create(self._n, *gravity, hertz, scene.friction)
        for around, radius in ((True, scene.radius_out), (False, scene.radius_in)):
            corner = _floats(corners(radius, around) * self._scale)
            self._library.addWall(self._discs, len(corner), corner.ctypes.data)
        lengths = scene.position, scene.velocity, scene.radius
        discs = [*(_floats(a * self._scale) for a in lengths), _floats(scene.mass)]
        self._library.addDiscs(self._discs, *(a.ctypes.data for a in discs), scene.drag)

    def advance(self, frames: int) -> None:
        self._library.advance(self._discs, frames * self._steps, FRAME / self._steps, self._substeps)

    def position(self) -> FloatArray:
        x = np.full((self._n, 2), np.nan)
        self._library.positions(self._discs, x.ctypes.data)
        return x / self._scale

    def __del__(self) -> None:
        if hasattr(self, "_discs"):
            self._library.destroy(self._discs)


def is_source(folder: Path) -> bool:
    """Whether a folder holds the source of Box2D 3.1 or newer."""
    return (folder / "src" / "physics_world.c").is_file()


@cache
def _library(source: Path | None) -> ctypes.CDLL:
    if source is None:
        raise ImportError("--box2d3 gives no folder of its source")
    with tempfile.TemporaryDirectory() as folder:
        built = Path(folder) / "box2d3.so"
        flags = ["-std=gnu17", *FLAGS, "-DNDEBUG", *_simd(), f"-I{source / 'include'}", "-pthread"]
        sources = [Path(__file__).with_name("box2d3.c"), *sorted((source / "src").glob("*.c"))]
        line = ["cc", *flags, "-shared", "-fPIC", *map(str, sources), "-o", str(built), "-lm"]
        subprocess.run(line, check=True)
        loaded = ctypes.CDLL(str(built))
    whole, number, array = ctypes.c_int, ctypes.c_float, ctypes.c_void_p
    loaded.create.restype = array
    loaded.create.argtypes = [whole, number, number, number, number]
    loaded.addWall.argtypes = [array, whole, array]
    loaded.addDiscs.argtypes = [array, array, array, array, array, number]
    loaded.advance.argtypes = [array, whole, number, whole]
    loaded.positions.argtypes = [array, array]
    loaded.destroy.argtypes = [array]
    return loaded


def _simd() -> list[str]:
    """Its own option for eight contacts at a time, where the processor can."""
    return ["-DBOX2D_AVX2"] if "avx2" in Path("/proc/cpuinfo").read_text() else []


def _floats(values: FloatArray) -> np.ndarray:
    return np.ascontiguousarray(values, dtype=np.float32)
