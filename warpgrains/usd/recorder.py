"""Recorder: writes a run as a USD file that other programs read."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf

import warpgrains
from warpgrains.base import checks
from warpgrains.base.errors import InputError
from warpgrains.base.files import require_writable_path, suffix_of
from warpgrains.base.frame_log import LOG_SUFFIX, FrameLog, is_complete, log_of
from warpgrains.base.locks import Lock, lock_own
from warpgrains.drawing.frames import FrameTimes
from warpgrains.drawing.kinds import RECORDINGS
from warpgrains.drawing.painter import Painter
from warpgrains.drawing.shapes import SHAPES
from warpgrains.scene.snapshot import Snapshot
from warpgrains.scene.toml import parameters_text
from warpgrains.usd.grains import Grains
from warpgrains.usd.meshes import ForceChains, Walls
from warpgrains.usd.stage import RECORDED_BY, Drawing, refusing_untrusted_content, static_layer, too_coarse
from warpgrains.usd.writer import identity, reopen_log, write_recording

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.simulation.options import RunOptions


class Recorder:
    """Writer of the frames of a run to one USD file, at integer time codes 0, 1, 2, ....

    The file appears when the ``with`` block ends without an exception. Until then each frame is appended to a
    log next to the file. The log remains after an exception or a killed process, unless it has only one frame
    and `flush` was not called. With `resume_at`, the log or the file of an earlier run of the same scene is
    continued at this frame.

    Raises InputError if an option is unknown, if float32 cannot hold the lengths of the scene, if successive
    float32 coordinates are more than 1 % of the smallest radius apart, if the log of an earlier run exists,
    or if there is none to continue. Raises OutputError if the file exists and is not a recording.
    """

    def __init__(
        self, scene: Scene, options: RunOptions, times: FrameTimes, resume_at: int | None = None
    ) -> None:
        _require_float32(scene)
        self.path = Path(options.record or "")
        self.log = log_of(self.path)
        painter = Painter(scene, options)
        self.needs_contacts = painter.needs_contacts
        shape_of = SHAPES[checks.one_of("draw_as", options.draw_as, SHAPES)]
        grains = Grains(painter, shape_of and shape_of(is_marked=scene.has_friction), times.slow)
        self._drawings: list[Drawing] = [grains, Walls(painter, grains.height)]
        if painter.chain_scale is not None:
            height = grains.height * float(scene.radius.max())
            self._drawings.append(ForceChains(painter.chain_scale, height, scene.has_friction))
        scales = {"colors": painter.colors.scale, "forces": painter.chain_scale}
        data = {
            "version": warpgrains.__version__,
            "name": scene.name,
            "scene": scene.text,
            "parameters": parameters_text(scene),
            "draw_as": options.draw_as,
            "first_step": times.first_step,
            "slow": times.slow,
            "look": painter.look.changed,
            **{name: own.described() for name, own in scales.items() if own is not None},
        }
        static = static_layer(scene.text, times.played, self._drawings, data, painter.view)
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
        """Number of frames written so far."""
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

    def record(self, now: Snapshot) -> None:
        """Append a frame. Raises InputError if float32 cannot hold one of its numbers."""
        arrays: dict[str, NDArray[Any]] = {}
        for drawing in reversed(self._drawings):  # forces first, so that a refusal does not name the pressure
            arrays |= drawing.samples(now)
        self._frames.append(arrays)

    def flush(self) -> None:
        """Write all frames so far to the disk.

        A later run can continue after them, with `resume_at` equal to the present value of `frames`.
        """
        self._frames.sync()
        self._is_needed = True

    def _finish(self) -> None:
        """Convert the complete log to the USD file, and delete the log."""
        if self.frames == 0:
            raise ValueError(f"no frame was recorded for '{self.path}'")
        self.flush()
        write_recording(self.log, self.path, self.frames)
        self._frames.remove()

    def _resume(self, frames: int) -> None:
        """Open the log of an earlier run, and keep its first `frames` frames.

        If that run has completed its USD file, make a log of its frames first.
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
    """Raise InputError unless float32 can hold the lengths of a scene, and resolves its first positions."""
    smallest, largest = float(scene.radius.min()), 2.0 * scene.reach
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


def recover(log: str | Path) -> tuple[Path, int]:
    """Convert the log of a killed run to a recording.

    Returns the path of the recording and its number of frames. The log is kept.
    """
    log = Path(checks.path("log", log))
    target = log.parent / log.stem
    if not log.exists():
        raise InputError(f"'{log}' does not exist: give the log of a killed run, such as run.usdc.frames")
    if log.suffix != LOG_SUFFIX or suffix_of(target) not in RECORDINGS or not log.is_file():
        raise InputError(f"'{log}' is not the log of a recording, such as run.usdc.frames")
    with lock_output(target):
        return target, write_recording(log, target)


def lock_output(path: Path) -> Lock:
    """Lock the path of a recording, so that no other process writes it; return the lock.

    Raises InputError if the file cannot be written, or exists and is not a recording.
    """
    require_writable_path("output", path, *RECORDINGS)
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise InputError(f"output '{path}' is not UTF-8: USD cannot write a file of this name") from None
    return lock_own(path, _is_recording, "recording of warpgrains")


def _is_recording(path: Path) -> bool:
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(path), metadataOnly=True)
    except Tf.ErrorException:
        return False
    return layer is not None and RECORDED_BY in layer.customLayerData
