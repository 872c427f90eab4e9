"""Recordings: a run as a USD file that other programs read."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from warpgrains.arrays import FloatArray
from warpgrains.drawing.chains import ChainScale
from warpgrains.drawing.colors import OF_CONTACTS, GrainColors
from warpgrains.drawing.frame_times import FrameTimes
from warpgrains.drawing.shapes import disc, sphere
from warpgrains.errors import SceneError
from warpgrains.frame_log import FrameLog
from warpgrains.scene import checks
from warpgrains.usd.forces import ForceChains
from warpgrains.usd.grains import GrainInstances, GrainPoints
from warpgrains.usd.output import SUFFIXES, lock_output, log_of
from warpgrains.usd.stage import Drawing, static_layer
from warpgrains.usd.writer import reopen_log, write_recording

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.forces import PairContacts, WallContacts

DRAWN_AS = ("points", "discs", "spheres")


class Recorder:
    """Writes the frames of a run to one USD file: integer time codes 0, 1, 2, ..., one a frame.

    Use it in a ``with`` block. The file appears under its name when the block ends well and only then.
    Until then each frame is appended to the log next to it, see `FrameLog`. A killed process leaves all
    frames there, and so does a block left by an exception, Ctrl-C included; but a log of one frame that was
    not flushed is deleted. `recover` makes a file of the log. Until the block ends, the recorder has a `Lock`
    on the output.

    Parameters
    ----------
    path : str or Path
        Output; ``.usdc`` (binary), ``.usda`` (text) or ``.usdz`` (package) by its suffix. Text takes much
        time and memory to check: it is for small recordings.
    scene : Scene
        What is recorded: radii, walls, time step and the scene's text go into the file.
    frames_per_second : float
        Wanted frames per second of simulated time [1/s], see `FrameTimes`.
    color_by : str
        Color of the grains: "speed", "pressure", "radius", "palette" or, with friction, "spin" or
        "mobilized", see `GrainColors`.
    forces : bool
        Whether to draw force chains, see `ForceChains`.
    draw_as : str
        How grains are drawn: as "points", or as instances of "discs" or "spheres".
    resume_at : int, optional
        Continue the log of an earlier run of the same scene, or its file, with this frame, dropping what
        follows it.

    Attributes
    ----------
    path, log : Path
        Output file, and the file that holds its frames until it is complete.
    times : FrameTimes
        When the frames are, and the step that each is made of.
    needs_contacts : bool
        Whether `record` must be given contacts: for force chains, and colors by `OF_CONTACTS`.

    Raises
    ------
    SceneError
        If the suffix, the coloring or the way to draw is unknown, the folder cannot be written, the log of an
        earlier run exists, or the one to continue does not; as an `OutputError`, if another process records
        to this file, or it is no recording.
    """

    def __init__(
        self,
        path: str | Path,
        scene: Scene,
        frames_per_second: float,
        *,
        color_by: str = "speed",
        forces: bool = False,
        draw_as: str = "points",
        resume_at: int | None = None,
    ) -> None:
        self.path = Path(path)
        self.log = log_of(self.path)
        self.times = FrameTimes.of(scene.dt, frames_per_second)
        colors = GrainColors(scene, color_by)
        self.needs_contacts = forces or color_by in OF_CONTACTS
        self._shape = scene.position.shape
        grains = _grains(draw_as, scene, colors, self.needs_contacts)
        self._drawings: list[Drawing] = [grains]
        scales: dict[str, dict[str, str | float]] = {}
        if colors.scale is not None:
            scales["colors"] = colors.scale.described()
        if forces:
            self._drawings.append(ForceChains(scene, grains.height * float(scene.radius.max())))
            scales["forces"] = ChainScale.of(scene).described()
        static = static_layer(scene, self.times.rate, self._drawings, scales)
        self._frames = FrameLog(self.log, static.ExportToString())
        self._is_needed = resume_at is not None
        self._lock = lock_output(self.path)
        try:
            if resume_at is None:
                self._frames.require_absent()
            else:
                self._resume(resume_at)
        except BaseException:
            self._lock.release()
            raise

    @property
    def frames(self) -> int:
        """Frames recorded so far."""
        return self._frames.frames

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self.close()
            elif self.frames > 1 or self._is_needed:
                with suppress(OSError):  # what ended the block is the news
                    self.flush()
            else:
                self._frames.remove()
        finally:
            self._frames.close()
            self._lock.release()

    def record(
        self,
        position: FloatArray,
        velocity: FloatArray,
        contacts: PairContacts | None = None,
        wall_contacts: WallContacts | None = None,
        *,
        spin: FloatArray | None = None,
        angle: FloatArray | None = None,
    ) -> None:
        """Append one frame.

        Parameters
        ----------
        position, velocity : ndarray
            [m] and [m/s], shape (n, 2), after step ``times.step(frames)``.
        contacts, wall_contacts
            What `Simulation.contacts` and `Simulation.wall_contacts` return; used where `needs_contacts`.
        spin, angle : ndarray, optional
            [rad/s] and [rad], shape (n,); needed with friction, and not used without.

        Raises
        ------
        ValueError
            If a shape is not (n, 2) or (n,), n being the number of grains of the scene, or contacts, spin or
            angle are needed and missing.
        OSError
            If the frame cannot be written; the frames before it are in the log, and it may be tried again.
        """
        if np.shape(position) != self._shape or np.shape(velocity) != self._shape:
            shapes = f"{np.shape(position)} and {np.shape(velocity)}"
            raise ValueError(f"a frame has arrays of shape {self._shape}, not {shapes}")
        for name, value in (("spin", spin), ("angle", angle)):
            if value is not None and np.shape(value) != self._shape[:1]:
                raise ValueError(f"{name} of a frame has shape {self._shape[:1]}, not {np.shape(value)}")
        frame = self.times.frame(self.frames, position, velocity, contacts, wall_contacts, spin, angle)
        arrays: dict[str, NDArray[Any]] = {}
        for drawing in self._drawings:
            arrays |= drawing.samples(frame)
        self._frames.append(arrays)

    def flush(self) -> None:
        """Put all frames so far on the disk: a later run can continue with ``resume_at=recorder.frames``."""
        self._frames.sync()
        self._is_needed = True

    def close(self) -> None:
        """Make one file of all frames, check it, put it under its name and delete the log.

        Raises
        ------
        ValueError
            If no frame was recorded.
        OSError
            If the file cannot be written; the log is still there.
        """
        try:
            if self.frames == 0:
                raise ValueError(f"nothing was recorded for '{self.path}'")
            self.flush()
            write_recording(self.log, self.path, self.frames)
            self._frames.remove()
        finally:
            self._frames.close()
            self._lock.release()

    def _resume(self, frames: int) -> None:
        """Continue the log behind its first frames; if it has become the file, write it anew from there."""
        is_joined = self.path.exists() and not self.log.exists()
        if is_joined:
            reopen_log(self.path, self.log)
        try:
            self._frames.reopen(frames)
        except SceneError:
            if is_joined:
                self.log.unlink()
            raise


def _grains(draw_as: str, scene: Scene, colors: GrainColors, has_contacts: bool) -> GrainPoints:
    """Return the drawing of the grains."""
    checks.one_of("draw_as", draw_as, DRAWN_AS)
    if draw_as == "points":
        return GrainPoints(scene, colors, has_contacts)
    shape = disc if draw_as == "discs" else sphere
    return GrainInstances(scene, colors, has_contacts, shape(is_marked=scene.has_friction))


def recover(log: str | Path) -> tuple[Path, int]:
    """Make a file of the frames that a killed run left, and return its path and their number.

    Parameters
    ----------
    log : str or Path
        The run's log, ``<output>.frames``; it is left as it is.

    Raises
    ------
    SceneError
        This is no log, or it holds no frames; as an `OutputError`, if its run goes on.
    """
    log = Path(checks.path("log", log))
    target = log.parent / log.stem
    if log.suffix != ".frames" or target.suffix not in SUFFIXES or not log.is_file():
        raise SceneError(f"'{log}' is not the log of a recording, such as run.usdc.frames")
    with lock_output(target):
        return target, write_recording(log, target)
