"""Recorder: a run as a USD file that other programs read."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from warpgrains.drawing.chains import ChainScale
from warpgrains.drawing.colors import GrainColors
from warpgrains.drawing.frames import Frame, FrameTimes
from warpgrains.drawing.kinds import DRAWN_AS, RECORDINGS
from warpgrains.drawing.shapes import disc, sphere
from warpgrains.drawing.views import view_of
from warpgrains.errors import InputError
from warpgrains.files import suffix_of
from warpgrains.frame_log import LOG_SUFFIX, FrameLog, is_complete, log_of
from warpgrains.scene import checks
from warpgrains.usd.forces import ForceChains
from warpgrains.usd.grains import GrainInstances, GrainPoints
from warpgrains.usd.metadata import described, lock_output
from warpgrains.usd.reader import refusing_untrusted_content
from warpgrains.usd.stage import Drawing, static_layer, too_coarse
from warpgrains.usd.walls import Walls
from warpgrains.usd.writer import identity, reopen_log, write_recording

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.simulation.options import RunOptions


class Recorder:
    """Writer of the frames of a run to one USD file, at integer time codes 0, 1, 2, ....

    Use it in a ``with`` block. The file appears only when the block ends without an exception. Until then
    each frame is appended to the log next to it, see `FrameLog`. The log remains after a killed process or
    an exception, Ctrl-C included; only a log of one frame that was not flushed is deleted. `recover` makes a
    recording from the log. During the block, the recorder holds a `Lock` on the output. The end of the block
    raises ValueError if no frame was recorded, and OSError if the file cannot be written; the log remains.

    Parameters
    ----------
    path : str or Path
        Output; ``.usdc`` (binary), ``.usda`` (text) or ``.usdz`` (package) by its suffix. Use text for small
        recordings only, because checking it takes much time and memory.
    scene : Scene
        The scene that is recorded. Its radii, walls, time step and text are stored in the file.
    times : FrameTimes
        Times of the frames, and the steps that they belong to.
    color_by : str
        Color of the grains, see `GrainColors`.
    forces : bool
        Whether to draw force chains, see `ForceChains`.
    draw_as : str
        Form of the grains: "points", or instances of "discs" or "spheres".
    resume_at : int, optional
        First frame to write when the log or the file of an earlier run of the same scene is continued; later
        frames of it are dropped.

    Attributes
    ----------
    path, log : Path
        Output file, and the log that holds its frames until it is complete.
    needs_contacts : bool
        Whether `record` requires contacts, for force chains or colors.

    Raises
    ------
    InputError
        The suffix, the coloring or the form of the grains is unknown, float32 has no such lengths or rounds
        positions by more than 1 % of the smallest radius, the folder cannot be written, the log of an earlier
        run exists, or the log to continue is missing. It is an `OutputError` if another process records to
        this file, or the file exists and is no recording.
    """

    def __init__(
        self,
        path: str | Path,
        scene: Scene,
        times: FrameTimes,
        *,
        color_by: str = "speed",
        forces: bool = False,
        draw_as: str = "points",
        frame: str | None = None,
        resume_at: int | None = None,
    ) -> None:
        _require_float32(scene)
        self.path = Path(path)
        self.log = log_of(self.path)
        colors = GrainColors(scene, color_by)
        self.needs_contacts = forces or colors.needs_contacts
        self._shape = scene.position.shape
        grains = _grains(draw_as, scene, colors, self.needs_contacts)
        self._drawings: list[Drawing] = [grains, Walls(scene)]
        scale = ChainScale.of(scene) if forces else None
        if scale is not None:
            self._drawings.append(ForceChains(scene, scale, grains.height * float(scene.radius.max())))
        data = described(scene, times.first_step, draw_as, colors.scale, scale)
        static = static_layer(scene, times.rate, self._drawings, data, view_of(scene, frame))
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

    @classmethod
    def of_run(
        cls, path: Path, scene: Scene, times: FrameTimes, options: RunOptions, resume_at: int | None
    ) -> Self:
        """Return the recorder of a run with these options."""
        looks = {name: getattr(options, name) for name in ("color_by", "forces", "draw_as", "frame")}
        return cls(path, scene, times, **looks, resume_at=resume_at)

    @property
    def frames(self) -> int:
        """Number of frames recorded so far."""
        return self._frames.frames

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._finish()
            elif self.frames > 1 or self._is_needed:
                with suppress(OSError):  # the exception that ended the block is the one to report
                    self.flush()
            else:
                self._frames.remove()
        finally:
            self._frames.close()
            self._lock.release()

    def record(self, frame: Frame) -> None:
        """Append one frame.

        Parameters
        ----------
        frame : Frame
            Frame number `frames`, as `FrameTimes.shown` returns it, with contacts if `needs_contacts`.

        Raises
        ------
        InputError
            float32 has no numbers of the size of a value.
        ValueError
            A shape is not (n, 2) or (n,) with the scene's number n of grains, or required contacts, spins or
            angles are missing.
        OSError
            The frame cannot be written. Earlier frames are in the log, and the call may be repeated.
        """
        if np.shape(frame.position) != self._shape or np.shape(frame.velocity) != self._shape:
            shapes = f"{np.shape(frame.position)} and {np.shape(frame.velocity)}"
            raise ValueError(f"a frame has arrays of shape {self._shape}, not {shapes}")
        for name, value in (("spin", frame.spin), ("angle", frame.angle)):
            if value is not None and np.shape(value) != self._shape[:1]:
                raise ValueError(f"{name} of a frame has shape {self._shape[:1]}, not {np.shape(value)}")
        arrays: dict[str, NDArray[Any]] = {}
        for drawing in reversed(self._drawings):  # forces first, so that a refusal does not name the pressure
            arrays |= drawing.samples(frame)
        self._frames.append(arrays)

    def flush(self) -> None:
        """Flush all frames to the disk. A later run can continue with ``resume_at=recorder.frames``."""
        self._frames.sync()
        self._is_needed = True

    def _finish(self) -> None:
        """Make one file of all frames, check it, move it to its name and delete the log."""
        if self.frames == 0:
            raise ValueError(f"no frame was recorded for '{self.path}'")
        self.flush()
        write_recording(self.log, self.path, self.frames)
        self._frames.remove()

    def _resume(self, frames: int) -> None:
        """Continue the log after its first frames.

        If only the finished file exists, the log is rebuilt from it.
        """
        is_joined = is_complete(self.path)
        if is_joined:
            reopen_log(self.path, self.log)
        try:
            with refusing_untrusted_content(self.log):
                self._frames.reopen(frames, identity)
        except InputError:
            if is_joined:
                self.log.unlink()
            raise


def _require_float32(scene: Scene) -> None:
    """Raise InputError unless float32 holds the lengths of a scene, and where its grains begin."""
    smallest, largest = float(scene.radius.min()), 2.0 * scene.radius_out
    least, most = float(np.finfo(np.float32).tiny), float(np.finfo(np.float32).max)
    if smallest < least or largest > most:
        raise InputError(
            f"lengths of the scene are {smallest} to {largest} m: a recording holds {least:.3g} to"
            f" {most:.3g} m; choose another unit of length"
        )
    farthest = int(np.abs(scene.position).max(axis=1).argmax())
    if complaint := too_coarse(scene.position, scene.radius):
        x, y = scene.position[farthest]
        raise InputError(f"grain {farthest} is at ({x:g}, {y:g}) m: {complaint}, too much for a recording")


def _grains(draw_as: str, scene: Scene, colors: GrainColors, has_contacts: bool) -> GrainPoints:
    """Return the drawing of the grains."""
    checks.one_of("draw_as", draw_as, DRAWN_AS)
    if draw_as == "points":
        return GrainPoints(scene, colors, has_contacts)
    shape = disc if draw_as == "discs" else sphere
    return GrainInstances(scene, colors, has_contacts, shape(is_marked=scene.has_friction))


def recover(log: str | Path) -> tuple[Path, int]:
    """Make a recording from the frames of a killed run, and return its path and number of frames.

    Parameters
    ----------
    log : str or Path
        The run's log, ``<output>.frames``; it is kept unchanged.

    Raises
    ------
    InputError
        The file is no log or holds no frames. It is an `OutputError` if its run still continues.
    """
    log = Path(checks.path("log", log))
    target = log.parent / log.stem
    if log.suffix != LOG_SUFFIX or suffix_of(target) not in RECORDINGS or not log.is_file():
        raise InputError(f"'{log}' is not the log of a recording, such as run.usdc.frames")
    with lock_output(target):
        return target, write_recording(log, target)
