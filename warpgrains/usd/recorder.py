"""Recordings: a run as a USD file that other programs read."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from pxr import Sdf

from warpgrains.arrays import FloatArray
from warpgrains.drawing.chains import ChainScale
from warpgrains.drawing.colors import Frame, GrainColors
from warpgrains.drawing.frame_rate import recording_rate, recording_stride
from warpgrains.errors import SceneError
from warpgrains.usd.chunks import ChunkFolder
from warpgrains.usd.flatten import count_frames, flatten, resume
from warpgrains.usd.forces import ForceChains
from warpgrains.usd.grains import GrainInstances, GrainPoints
from warpgrains.usd.output import SUFFIXES, chunks_of, lock_output
from warpgrains.usd.shapes import disc, sphere
from warpgrains.usd.stage import Drawing, static_layer

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.forces import PairContacts, WallContacts

DRAWN_AS = ("discs", "spheres", "points", "light")


class Recorder:
    """Writes the frames of a run to one USD file: integer time codes 0, 1, 2, ..., one a frame.

    Use it in a ``with`` block. The file appears under its name when the block ends well and only then.
    Until then the frames gather in the folder `chunks` beside it, in chunks of a hundred or 16 MB; viewers
    open its ``root.usda``. A block left by an exception, Ctrl-C included, leaves all frames there, or
    nothing if they were less than a chunk. A killed process leaves all but the last chunk. `recover` makes
    a file of them. Until the block ends, the recorder has a `Lock` on the output.

    Parameters
    ----------
    path : str or Path
        Output; ``.usdc`` (binary), ``.usda`` (text) or ``.usdz`` (package) by its suffix. Text takes much
        time and memory to check: it is for small recordings.
    scene : Scene
        What is recorded: radii, walls, time step and the scene's text go into the file.
    frames_per_second : float
        Wanted frames per second of simulated time [1/s], see `recording_stride`.
    color_by : str
        Color of the grains: "speed", "pressure", "radius" or "palette", see `GrainColors`.
    forces : bool
        Whether to draw force chains, see `ForceChains`.
    draw_as : str
        How grains are drawn: as instances of colored "discs" or "spheres", as "points", or "light": as points
        that have neither colors nor velocities, for long runs of many grains.
    resume_at : int, optional
        Continue the chunks of an earlier run of the same scene, or its file, with this frame, dropping what
        follows it. `flush` must have been called when the earlier run had recorded just as many frames.

    Attributes
    ----------
    path, chunks : Path
        Output file, and the folder that holds its frames until it is whole.
    stride : int
        Steps between two frames.
    needs_contacts : bool
        Whether `record` must be given contacts: for force chains and colors by pressure.

    Raises
    ------
    SceneError
        If the suffix, the coloring or the way to draw is unknown, the folder cannot be written, the chunks of
        an earlier run are there, or those to continue are not; as an `OutputError`, if another process
        records to this file, or it is no recording.
    """

    def __init__(
        self,
        path: str | Path,
        scene: Scene,
        frames_per_second: float,
        *,
        color_by: str = "speed",
        forces: bool = False,
        draw_as: str = "discs",
        resume_at: int | None = None,
    ) -> None:
        self.path = Path(path)
        self.chunks = chunks_of(self.path)
        self.stride = recording_stride(scene.dt, frames_per_second)
        colors = GrainColors(scene, color_by)
        self.needs_contacts = forces or (color_by == "pressure" and draw_as != "light")
        self._shape = scene.position.shape
        grains = _grains(draw_as, scene, colors, self.needs_contacts)
        self._drawings: list[Drawing] = [grains]
        scales: dict[str, dict[str, str | float]] = {}
        if colors.scale is not None and draw_as != "light":
            scales["colors"] = colors.scale.described()
        if forces:
            self._drawings.append(ForceChains(scene, grains.height * float(scene.radius.max())))
            scales["forces"] = ChainScale.of(scene).described()
        static = static_layer(scene, recording_rate(scene.dt, self.stride), self._drawings, scales)
        self._folder = ChunkFolder(self.chunks, static)
        self._lock = lock_output(self.path)
        try:
            if resume_at is None:
                self._folder.require_absent()
            else:
                resume(self.path, self._folder, resume_at)
        except BaseException:
            self._lock.release()
            raise

    @property
    def frames(self) -> int:
        """Frames recorded so far."""
        return self._folder.frames

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self.close()
            elif self._folder.has_written:
                with suppress(OSError):  # what ended the block is the news
                    self._folder.flush()
        finally:
            self._folder.remove_if_empty()
            self._lock.release()

    def record(
        self,
        position: FloatArray,
        velocity: FloatArray,
        contacts: PairContacts | None = None,
        wall_contacts: WallContacts | None = None,
    ) -> None:
        """Append one frame.

        Parameters
        ----------
        position, velocity : ndarray
            [m] and [m/s], shape (n, 2).
        contacts, wall_contacts
            What `Simulation.contacts` and `Simulation.wall_contacts` return; used where `needs_contacts`.

        Raises
        ------
        ValueError
            If a shape is not (n, 2), n being the number of grains of the scene, or contacts are needed
            and missing.
        OSError
            If earlier frames could not be written; what was on the disk before is still there.
        """
        if np.shape(position) != self._shape or np.shape(velocity) != self._shape:
            shapes = f"{np.shape(position)} and {np.shape(velocity)}"
            raise ValueError(f"a frame has arrays of shape {self._shape}, not {shapes}")
        frame = Frame(position, velocity, contacts, wall_contacts)
        samples: dict[Sdf.Path, object] = {}
        for drawing in self._drawings:
            samples |= drawing.samples(frame)
        self._folder.add(samples)

    def flush(self) -> None:
        """Put all frames so far on the disk: a later run can continue with ``resume_at=recorder.frames``."""
        self._folder.flush()

    def close(self) -> None:
        """Make one file of all frames, check it, put it under its name and drop the chunks.

        Raises
        ------
        ValueError
            If no frame was recorded.
        OSError
            If the file cannot be written; the chunks are still there.
        """
        try:
            if self.frames == 0:
                raise ValueError(f"nothing was recorded for '{self.path}'")
            self._folder.flush()
            flatten(self.chunks, self.path, self.frames)
            self._folder.remove()
        finally:
            self._lock.release()


def _grains(draw_as: str, scene: Scene, colors: GrainColors, has_contacts: bool) -> GrainPoints:
    """Return the drawing of the grains."""
    if draw_as not in DRAWN_AS:
        raise SceneError(f"draw as '{draw_as}' is unknown; choose {', '.join(DRAWN_AS)}")
    if draw_as == "light":
        return GrainPoints(scene, None, has_contacts)
    if draw_as == "points":
        return GrainPoints(scene, colors, has_contacts)
    return GrainInstances(scene, colors, has_contacts, disc() if draw_as == "discs" else sphere())


def recover(folder: str | Path) -> tuple[Path, int]:
    """Make a file of the frames that a killed run left, and return its path and their number.

    Parameters
    ----------
    folder : str or Path
        The run's chunks, ``<output>.chunks``; they are left as they are.

    Raises
    ------
    SceneError
        If this is no folder of chunks, or it holds no frames; as an `OutputError`, if its run goes on.
    """
    chunks = Path(folder)
    target = chunks.with_suffix("")
    if chunks != chunks_of(target) or target.suffix not in SUFFIXES or not chunks.is_dir():
        raise SceneError(f"'{folder}' is not a folder of chunks, such as run.usdc.chunks")
    with lock_output(target):
        frames = count_frames(chunks)
        flatten(chunks, target, frames)
    return target, frames
