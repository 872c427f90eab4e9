"""Recordings: a run as a USD file that other programs read."""

from __future__ import annotations

import tempfile
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, UsdGeom, UsdUtils, Vt

from warpgrains.errors import SceneError
from warpgrains.safe_files import publish, require_writable_folder
from warpgrains.usd_stage import GRAINS, define_stage, vec3f

if TYPE_CHECKING:
    from warpgrains.scene import Scene

SUFFIXES = (".usdc", ".usda", ".usdz")


def recording_stride(dt: float, frames_per_second: float) -> int:
    """Return how many steps lie between two frames, at least 1.

    The stride is the integer nearest to ``1 / (frames_per_second * dt)``, both taken as the decimal numbers
    a user writes, so that no rounding of a float decides it. The file then states the rate it really has,
    `recording_rate`: with dt = 0.01 s and 60 frames asked for, every 2nd step is a frame, 50 frames a second.

    Parameters
    ----------
    dt : float
        Time step [s].
    frames_per_second : float
        Wanted frames per second of simulated time [1/s].

    Raises
    ------
    SceneError
        If `frames_per_second` is not a positive finite number.
    """
    if not 0 < frames_per_second < float("inf"):
        raise SceneError(f"frames per second must be a positive number, not {frames_per_second}")
    return max(1, round(1 / (_as_written(frames_per_second) * _as_written(dt))))


def recording_rate(dt: float, stride: int) -> float:
    """Return the frames per second [1/s] of one frame every `stride` steps of `dt` [s], to the last bit."""
    return float(1 / (stride * _as_written(dt)))


def _as_written(value: float) -> Fraction:
    return Fraction(repr(float(value)))


class Recorder:
    """Writes the frames of a run to one USD file: integer time codes 0, 1, 2, ..., one a frame.

    Use it in a ``with`` block. The file appears under its name when the block ends well and only then;
    a block left by an exception, Ctrl-C included, leaves what was there before.

    Parameters
    ----------
    path : str or Path
        Output; ``.usdc`` (binary), ``.usda`` (text) or ``.usdz`` (package) by its suffix.
    scene : Scene
        What is recorded: radii, walls, time step and the scene's text go into the file.
    frames_per_second : float
        Wanted frames per second of simulated time [1/s], see `recording_stride`.

    Attributes
    ----------
    path : Path
        Output file.
    stride : int
        Steps between two frames.
    frames : int
        Frames recorded so far.

    Raises
    ------
    SceneError
        If the suffix is unknown or the folder cannot be written.
    """

    def __init__(self, path: str | Path, scene: Scene, frames_per_second: float) -> None:
        self.path = Path(path)
        if self.path.suffix not in SUFFIXES:
            raise SceneError(f"output '{self.path}' must end in {', '.join(SUFFIXES)}")
        if self.path.is_dir():
            raise SceneError(f"output '{self.path}' is a folder")
        self.stride = recording_stride(scene.dt, frames_per_second)
        require_writable_folder(self.path.parent)
        self.frames = 0
        self._radius = np.asarray(scene.radius, dtype=np.float64)
        self._stage = define_stage(scene, recording_rate(scene.dt, self.stride))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()

    def record(self, position: NDArray[np.float64], velocity: NDArray[np.float64]) -> None:
        """Append one frame.

        Parameters
        ----------
        position : ndarray
            Positions [m], shape (n, 2).
        velocity : ndarray
            Velocities [m/s], shape (n, 2).

        Raises
        ------
        ValueError
            If a shape is not (n, 2), n being the number of grains of the scene.
        """
        shape = (len(self._radius), 2)
        if np.shape(position) != shape or np.shape(velocity) != shape:
            raise ValueError(
                f"a frame has arrays of shape {shape}, not {np.shape(position)} and {np.shape(velocity)}"
            )
        grains = UsdGeom.Points(self._stage.GetPrimAtPath(GRAINS))
        grains.GetPointsAttr().Set(vec3f(position), self.frames)
        grains.GetVelocitiesAttr().Set(vec3f(velocity), self.frames)
        grains.GetExtentAttr().Set(covering_extent(position, self._radius), self.frames)
        self.frames += 1

    def close(self) -> None:
        """Write the file, check that it holds every frame, and put it under its name.

        Raises
        ------
        ValueError
            If no frame was recorded.
        """
        if self.frames == 0:
            raise ValueError(f"nothing was recorded for '{self.path}'")
        self._stage.SetStartTimeCode(0)
        self._stage.SetEndTimeCode(self.frames - 1)
        with tempfile.TemporaryDirectory(dir=self.path.parent, prefix=f".{self.path.name}.") as folder:
            draft = Path(folder) / self.path.name
            _write(self._stage.GetRootLayer(), draft)
            _require_frames(draft, self.frames)
            publish(draft, self.path)


def covering_extent(position: NDArray[np.float64], radius: NDArray[np.float64]) -> Vt.Vec3fArray:
    """Return the float32 box [m] that covers every grain as the file shows it, rounded outwards.

    Parameters
    ----------
    position : ndarray
        Positions [m], shape (n, 2).
    radius : ndarray
        Radii [m], shape (n,).
    """
    shown = position.astype(np.float32).astype(np.float64)
    half_width = (2.0 * radius).astype(np.float32).astype(np.float64)[:, np.newaxis] / 2.0
    depth = half_width.max()
    low = np.append((shown - half_width).min(axis=0), -depth)
    high = np.append((shown + half_width).max(axis=0), depth)
    infinity = np.float32(np.inf)
    corners = [np.nextafter(np.float32(low), -infinity), np.nextafter(np.float32(high), infinity)]
    return Vt.Vec3fArray.FromNumpy(np.stack(corners))


def _write(layer: Sdf.Layer, draft: Path) -> None:
    if draft.suffix != ".usdz":
        layer.Export(str(draft))
        return
    inside = draft.with_suffix(".usdc")
    layer.Export(str(inside))
    UsdUtils.CreateNewUsdzPackage(str(inside), str(draft))


def _require_frames(draft: Path, frames: int) -> None:
    """Raise OSError unless the file can be read again and holds `frames` frames."""
    layer = Sdf.Layer.OpenAsAnonymous(str(draft))
    written = layer.GetNumTimeSamplesForPath(GRAINS.AppendProperty("points"))
    if written != frames:
        raise OSError(f"'{draft.name}' holds {written} frames of {frames} after writing")
