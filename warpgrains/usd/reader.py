"""Reader of recordings, for pictures and curves."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from pxr import Sdf, Tf, Usd, UsdGeom, UsdUtils

from warpgrains.arrays import FloatArray
from warpgrains.drawing.chains import Chains
from warpgrains.drawing.colors import encoded
from warpgrains.drawing.frames import FrameTimes
from warpgrains.errors import InputError
from warpgrains.scene import checks
from warpgrains.scene.band import Band
from warpgrains.scene.scene import Scene
from warpgrains.usd.forces import read_chains
from warpgrains.usd.grains import (
    COLOR_INDICES,
    GRAINS,
    OF_GRAINS,
    ROTATION,
    VELOCITIES,
    numbers_of,
    position_of,
)
from warpgrains.usd.metadata import RECORDED_BY, Metadata
from warpgrains.usd.stage import numbers, values_of
from warpgrains.usd.walls import PLACES, WALLS, read_walls


class RecordingReader:
    """The frames 0, 1, 2, ... of a recording; its length is their number.

    Masses are in kg and radii in m, shape (n,). Raises InputError, as all methods do, where the file is
    missing, damaged, or no recording.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        with refusing_untrusted_content(path):
            self._open()

    def _open(self) -> None:
        path = self.path
        self._stage = open_recording(path)
        prim = self._stage.GetPrimAtPath(GRAINS)
        if not (prim and (prim.IsA(UsdGeom.Points) or prim.IsA(UsdGeom.PointInstancer))):
            raise InputError(f"'{path}' holds no grains")
        self._prim, self._position = prim, position_of(prim)
        codes = self._position.GetTimeSamples()
        if not codes:
            raise InputError(f"'{path}' holds no frames")
        data = self._stage.GetRootLayer().customLayerData.get(RECORDED_BY)
        if data is None:
            raise InputError(f"'{path}' holds no scene: warpgrains has not recorded it")
        for frame, code in enumerate(codes):
            if code != frame:
                raise InputError(f"'{path}' holds frame {frame} at time code {code:.17g}: it must be {frame}")
        self._count = len(codes)
        self.parameters, first_step, self.scale, self.chain_scale = Metadata.read(data)
        rate = float(self._stage.GetTimeCodesPerSecond())
        start = checks.number("time", self.parameters.get("time", 0.0))
        self.times = FrameTimes.of(checks.positive("dt", self.parameters["dt"]), rate, first_step, start)
        checks.number("time of the last frame", self.times.time(self._count - 1))
        n = len(numbers(self._position))
        self.mass, self.radius = (
            checks.positive_per_grain(name, numbers(prim.GetAttribute(attribute)), n)
            for name, attribute in OF_GRAINS.items()
        )
        self.walls = read_walls(self._stage)

    def __len__(self) -> int:
        return self._count

    def _numbers(self, attribute: Usd.Attribute, frame: int, *columns: int) -> FloatArray:
        """Return the values of the grains in a frame, shape (n, *columns)."""
        with refusing_untrusted_content(self.path):
            return numbers(attribute, frame, (len(self.radius), *columns))

    def position(self, frame: int) -> FloatArray:
        """Return the centers of the grains [m], shape (n, 2)."""
        return self._numbers(self._position, frame, 3)[:, :2]

    def velocity(self, frame: int) -> FloatArray:
        """Return the velocities of the grains [m/s], shape (n, 2)."""
        return self._numbers(self._prim.GetAttribute(VELOCITIES), frame, 3)[:, :2]

    def scene(self) -> Scene:
        """Return the scene with the grains of the first frame, which may be where a wall was at the start."""
        return Scene.of_later_state(
            position=self.position(0),
            velocity=self.velocity(0),
            spin=self.rotation(0)[0] if self.has_rotation else None,
            radius=self.radius,
            mass=self.mass,
            **self.parameters,
        )

    def moved_walls(self, frame: int) -> dict[str, Band]:
        """Return the mobile walls as drawn in a frame, by name."""
        with refusing_untrusted_content(self.path):
            return read_walls(self._stage, frame, only_mobile=True)

    def places(self, frame: int) -> FloatArray | None:
        """Return the coordinates of walls [m], shape (walls,); None where no force drives a wall."""
        with refusing_untrusted_content(self.path):
            places = self._stage.GetPrimAtPath(WALLS).GetAttribute(PLACES)
            return numbers(places, frame) if places else None

    @property
    def has_rotation(self) -> bool:
        """True if spin and angle of the grains were recorded, as in every scene with friction."""
        return all(self._prim.HasAttribute(f"primvars:{name}") for name in ROTATION)

    def rotation(self, frame: int) -> tuple[FloatArray, FloatArray]:
        """Return spin [rad/s] and angle [rad] of the grains, shape (n,) each; 0 without friction."""
        if not self.has_rotation:
            return np.zeros(len(self.radius)), np.zeros(len(self.radius))
        spin, angle = (self._prim.GetAttribute(f"primvars:{name}") for name in ROTATION)
        return self._numbers(spin, frame), self._numbers(angle, frame)

    def numbers(self, frame: int) -> dict[str, FloatArray]:
        """Return what is recorded as a number a grain, such as the pressure, by name, shape (n,) each."""
        return {name: self._numbers(own, frame) for name, own in numbers_of(self._prim).items()}

    def color(self, frame: int) -> FloatArray:
        """Return the colors of the grains as screens need them (sRGB), shape (n, 3)."""
        with refusing_untrusted_content(self.path):
            table = encoded(numbers(self._prim.GetAttribute("primvars:displayColor")))
            indices = values_of(self._prim.GetAttribute(COLOR_INDICES), frame)
            return np.tile(table[0], (len(self.radius), 1)) if indices is None else table[indices]

    def chains(self, frame: int) -> Chains:
        with refusing_untrusted_content(self.path):
            chains = read_chains(self._stage, frame)
            (first, other), n = chains.pair.T, len(self.radius)
            last_wall = -2 - len(self.parameters.get("walls", ()))
            if not ((first >= 0) & (first < n) & (last_wall <= other) & (other < n)).all():
                raise ValueError("a force chain names a grain or a wall that does not exist")
            return chains


def open_recording(path: Path) -> Usd.Stage:
    """Open a recording. Raises InputError if the file is missing or cannot be read."""
    if not path.is_file():
        raise InputError(f"recording '{path}' does not exist")
    try:
        _unprinted = UsdUtils.CoalescingDiagnosticDelegate()  # USD's warnings would be lines beside ours
        # not the layer that USD keeps of an earlier file of this name
        return Usd.Stage.Open(Sdf.Layer.OpenAsAnonymous(str(path)))
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
