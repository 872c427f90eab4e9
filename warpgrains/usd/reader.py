"""Reader of recordings, for pictures and curves."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Tf, Usd, UsdGeom

from warpgrains.arrays import FloatArray
from warpgrains.drawing.chains import Chains, ChainScale
from warpgrains.drawing.colors import ColorScale, encoded
from warpgrains.errors import InputError
from warpgrains.scene import checks
from warpgrains.scene.band import Band
from warpgrains.scene.document import read_parameters
from warpgrains.usd.forces import FORCES, GRAINS_OF, TANGENTIAL
from warpgrains.usd.grains import COLOR_INDICES, GRAINS
from warpgrains.usd.output import RECORDED_BY
from warpgrains.usd.walls import PLACES, WALLS, read_walls

Values = NDArray[Any]

_ROTATION = ("spin", "angle")


class RecordingReader:
    """The frames of a recording, for any form in which its grains are drawn.

    Parameters
    ----------
    path : str or Path
        A USD file that `Recorder` wrote.

    Attributes
    ----------
    time : ndarray
        Time of each frame since the first one [s], shape (f,).
    simulated_time : ndarray
        Simulated time of each frame [s], shape (f,). It differs from `time` if the run began after earlier
        steps.
    rate : float
        Frames per second [1/s].
    first_step : int
        Time steps before the first frame.
    radius : ndarray
        Radii of the grains [m], shape (n,).
    walls : list of Band
        Walls as drawn; those that move are those of the first frame.
    scale : ColorScale or None
        Range of values that the colors represent; None for the palette.
    chain_scale : ChainScale or None
        Scale from forces to widths; None if no force chains were recorded.

    Raises
    ------
    InputError
        The file is missing, is not USD or holds no frames of grains.
    """

    def __init__(self, path: str | Path) -> None:
        self._stage = open_recording(Path(path))
        prim = self._stage.GetPrimAtPath(GRAINS)
        is_points = bool(prim) and prim.IsA(UsdGeom.Points)
        if not (is_points or (prim and prim.IsA(UsdGeom.PointInstancer))):
            raise InputError(f"'{path}' holds no grains")
        self._position = prim.GetAttribute("points" if is_points else "positions")
        self._prim = prim
        self._codes = self._position.GetTimeSamples()
        if not self._codes:
            raise InputError(f"'{path}' holds no frames")
        self.rate = float(self._stage.GetTimeCodesPerSecond())
        self.time = (np.array(self._codes) - self._codes[0]) / self.rate
        radius = (
            _values(prim.GetAttribute("widths")) / 2.0
            if is_points
            else _values(prim.GetAttribute("scales"))[:, 0]
        )
        self.radius = np.broadcast_to(radius, (len(self.position(0)),))
        self.walls = list(read_walls(self._stage).values())
        data = self._stage.GetRootLayer().customLayerData.get(RECORDED_BY, {})
        self.first_step = checks.whole_number("first_step", data.get("first_step", 0), least=0)
        start = self.first_step * _time_step(data) if self.first_step else 0.0
        self.simulated_time = start + self.time
        self.scale = ColorScale.read(data["colors"]) if "colors" in data else None
        has_forces = bool(self._stage.GetPrimAtPath(FORCES))
        self.chain_scale = ChainScale.read(data["forces"]) if has_forces else None

    def position(self, frame: int) -> FloatArray:
        """Return the centers of the grains [m], shape (n, 2)."""
        return _values(self._position, self._codes[frame])[:, :2]

    def velocity(self, frame: int) -> FloatArray:
        """Return the velocities of the grains [m/s], shape (n, 2)."""
        return _values(self._prim.GetAttribute("velocities"), self._codes[frame])[:, :2]

    def moved_walls(self, frame: int) -> dict[int, Band]:
        """Return the mobile walls as drawn in a frame, by their index in `walls`."""
        return read_walls(self._stage, self._codes[frame], only_mobile=True)

    def places(self, frame: int) -> FloatArray | None:
        """Return the coordinates of walls [m], shape (walls,); None where no force drives a wall."""
        places = self._stage.GetPrimAtPath(WALLS).GetAttribute(PLACES)
        return _values(places, self._codes[frame]) if places else None

    @property
    def has_rotation(self) -> bool:
        """True if spin and angle of the grains were recorded, as in every scene with friction."""
        return all(self._prim.HasAttribute(f"primvars:{name}") for name in _ROTATION)

    def rotation(self, frame: int) -> tuple[FloatArray, FloatArray]:
        """Return spin [rad/s] and angle [rad] of the grains, shape (n,) each; 0 without friction."""
        if not self.has_rotation:
            return np.zeros(len(self.radius)), np.zeros(len(self.radius))
        spin, angle = (self._prim.GetAttribute(f"primvars:{name}") for name in _ROTATION)
        return _values(spin, self._codes[frame]), _values(angle, self._codes[frame])

    def color(self, frame: int) -> FloatArray:
        """Return the colors of the grains as screens need them (sRGB), shape (n, 3)."""
        table = encoded(_values(self._prim.GetAttribute("primvars:displayColor")))
        indices = values_of(self._prim.GetAttribute(COLOR_INDICES), self._codes[frame])
        return np.tile(table[0], (len(self.radius), 1)) if indices is None else table[indices]

    def scene_fields(self) -> dict[str, Any]:
        """Return the fields of the simulated scene, except those that frames and radii contain."""
        data = self._stage.GetRootLayer().customLayerData.get(RECORDED_BY, {})
        mass = self._prim.GetAttribute("primvars:mass")
        if "parameters" not in data or not mass:
            raise InputError("the recording does not contain its complete scene: an earlier release wrote it")
        fields = read_parameters(str(data["parameters"]))
        texts = {"name": str(data["name"]), "text": str(data["scene"])}
        return {**fields, **texts, "mass": _values(mass)}

    def chains(self, frame: int) -> Chains:
        """Return the force chains of a frame."""
        forces, code = self._stage.GetPrimAtPath(FORCES), self._codes[frame]
        corner = _values(forces.GetAttribute("points"), code).reshape(-1, 4, 3)[:, :, :2]
        ends = np.stack([corner[:, [0, 3]].mean(axis=1), corner[:, [1, 2]].mean(axis=1)], axis=1)
        width = np.hypot(*(corner[:, 0] - corner[:, 3]).T)
        force = _values(forces.GetAttribute("primvars:force"), code)
        grains = [forces.GetAttribute(f"primvars:{name}").Get(code) for name in GRAINS_OF]
        pair = np.full((len(force), 2), -1) if None in grains else np.stack(grains, axis=1)
        tangential = forces.GetAttribute(TANGENTIAL)
        tangential_force = _values(tangential, code) if tangential else np.zeros_like(force)
        return Chains(ends, width, force, tangential_force, pair.astype(np.int32))


def _time_step(data: dict[str, Any]) -> float:
    """Return the time step of the scene [s], from the custom data of a recording."""
    return checks.positive("dt", read_parameters(str(data["parameters"]))["dt"])


def open_recording(path: Path) -> Usd.Stage:
    """Open a recording. Raises InputError if the file is missing or cannot be read."""
    if not path.is_file():
        raise InputError(f"recording '{path}' does not exist")
    try:
        return Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise InputError(f"recording '{path}' is not a USD file that can be read") from error


@contextmanager
def refusing_untrusted_content(path: str | Path) -> Iterator[None]:
    """Raise InputError instead of any exception of USD or NumPy that unexpected content causes."""
    try:
        yield
    except (InputError, OSError, MemoryError):
        raise
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"recording '{path}' is damaged: {reason}") from error


def values_of(attribute: Usd.Attribute, code: float = 0.0) -> Values | None:
    """Return the value at a time code, or None if there is none.

    Raises TypeError if it is no array of numbers.
    """
    value = attribute.Get(code)
    if value is None:
        return None
    kind, array = type(value).__name__, np.array(value)
    if not kind.endswith("Array") or array.dtype.kind not in "fiu":
        raise TypeError(f"{attribute.GetPath()} is a {kind}, not an array of numbers")
    return array


def _values(attribute: Usd.Attribute, code: float = 0.0) -> FloatArray:
    array = values_of(attribute, code)
    if array is None:
        raise TypeError(f"{attribute.GetPath()} has no value")
    return array.astype(np.float64)
