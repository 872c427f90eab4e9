"""A recording read back, for pictures and curves."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Tf, Usd, UsdGeom

from warpgrains.arrays import FloatArray
from warpgrains.errors import SceneError
from warpgrains.usd.stage import FORCES, GRAINS
from warpgrains.usd.walls import read_walls


@dataclass(frozen=True)
class Chains:
    """The force chains of a frame."""

    ends: FloatArray
    """Both ends of each segment [m], shape (m, 2, 2)."""
    width: FloatArray
    """Width of each segment [m], shape (m,): proportional to the force up to the smallest grain's."""


class RecordingReader:
    """The frames of a recording, whichever way its grains are drawn.

    Parameters
    ----------
    path : str or Path
        A USD file that `Recorder` wrote, or the ``root.usda`` of its chunks.

    Attributes
    ----------
    time : ndarray
        Time of each frame since the first one [s], shape (f,).
    radius : ndarray
        Radii of the grains [m], shape (n,).
    walls : list of (float, float)
        Inner and outer radius of each wall, as thick as it is drawn [m].
    has_forces : bool
        Whether force chains were recorded.

    Raises
    ------
    SceneError
        The file is missing, is not USD or holds no frames of grains.
    """

    def __init__(self, path: str | Path) -> None:
        self._stage = open_recording(Path(path))
        prim = self._stage.GetPrimAtPath(GRAINS)
        is_points = bool(prim) and prim.IsA(UsdGeom.Points)
        if not (is_points or (prim and prim.IsA(UsdGeom.PointInstancer))):
            raise SceneError(f"'{path}' holds no grains")
        self._position = prim.GetAttribute("points" if is_points else "positions")
        self._velocity = prim.GetAttribute("velocities")
        self._color = prim.GetAttribute("primvars:displayColor")
        self._codes = self._position.GetTimeSamples()
        if not self._codes:
            raise SceneError(f"'{path}' holds no frames")
        self.time = (np.array(self._codes) - self._codes[0]) / self._stage.GetTimeCodesPerSecond()
        radius = (
            _values(prim.GetAttribute("widths")) / 2.0
            if is_points
            else _values(prim.GetAttribute("scales"))[:, 0]
        )
        self.radius = np.broadcast_to(radius, (len(self.position(0)),))
        self.walls = read_walls(self._stage)
        self.has_forces = bool(self._stage.GetPrimAtPath(FORCES))

    def position(self, frame: int) -> FloatArray:
        """Return the centres of the grains [m], shape (n, 2)."""
        return _values(self._position, self._codes[frame])[:, :2]

    def velocity(self, frame: int) -> FloatArray:
        """Return the velocities of the grains [m/s], shape (n, 2)."""
        return _values(self._velocity, self._codes[frame])[:, :2]

    def color(self, frame: int) -> FloatArray:
        """Return the colors of the grains as screens take them (sRGB), shape (n, 3)."""
        linear = np.clip(_values(self._color, self._codes[frame]), 0.0, 1.0)
        return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)

    def chains(self, frame: int) -> Chains:
        """Return the force chains."""
        forces, code = self._stage.GetPrimAtPath(FORCES), self._codes[frame]
        ends = _values(forces.GetAttribute("points"), code).reshape(-1, 2, 3)[:, :, :2]
        return Chains(ends, _values(forces.GetAttribute("widths"), code)[::2])


def open_recording(path: Path) -> Usd.Stage:
    """Open a recording; SceneError if there is none that can be read."""
    if not path.is_file():
        raise SceneError(f"recording '{path}' does not exist")
    try:
        return Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise SceneError(f"recording '{path}' is not a USD file that can be read") from error


def _values(attribute: Usd.Attribute, code: float = 0.0) -> Any:
    return np.array(attribute.Get(code), dtype=np.float64)
