"""Films: each frame is drawn and passed at once to ffmpeg, which imageio-ffmpeg ships."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from errno import EIO
from fractions import Fraction
from math import ceil
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any, Self, Unpack

import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray

from warpgrains.base.console import progress_bar
from warpgrains.base.errors import InputError, OutputError
from warpgrains.base.files import draft_folder, draft_of, draft_path, naming, publish, require_writable_path
from warpgrains.base.locks import Lock
from warpgrains.drawing.frames import FrameTimes
from warpgrains.drawing.kinds import FILMS, SEQUENCE, FilmFormat, form_of, size_of
from warpgrains.drawing.looks import Looks
from warpgrains.drawing.painter import Painter
from warpgrains.pictures.still import Canvas, DrawnOutput
from warpgrains.scene.snapshot import Snapshot

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.simulation.options import RunOptions

_FORMATS = FILMS | {
    ".mkv": FilmFormat("matroska", ("libx264rgb", "rgb24", "-crf", "0", "-preset", "ultrafast")),
    ".png": FilmFormat("image2"),
}
"""Formats of films by suffix, and of two intermediate files: a lossless film (.mkv) and a palette (.png)."""
_SLOWEST = 1e-4  # frame rate [1/s], so that ffmpeg can read it as a fraction
_SOURCE = re.compile(r"^(\[[^]]*\] )+")  # prefix of an error message: the part of ffmpeg that reports it
_PALETTE = "palettegen=stats_mode=full"
_WITH_PALETTE = "paletteuse=dither=none:diff_mode=rectangle"


class Encoding:
    """An ffmpeg process that writes the file `output`.

    `arguments` are its command line options: inputs, filters and codec.
    """

    def __init__(self, arguments: Sequence[str | Path], output: Path) -> None:
        self._complaints = TemporaryFile()  # noqa: SIM115  # open until the process ends
        program, form = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-loglevel", "error"], form_of(output)
        folder = str(output.parent).replace("%", "%%") if form == SEQUENCE else output.parent
        name = Path(folder, output.name)
        self._process = subprocess.Popen(
            [*program, *arguments, "-f", _FORMATS[form].container, f"file:{name}"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=self._complaints,
            process_group=0,  # Ctrl-C must reach the run only, which then ends the process
        )

    def write(self, pixels: NDArray[np.uint8]) -> None:
        """Encode a frame (sRGB), shape (height, width, 3). Raises OSError if ffmpeg has ended."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(pixels.data)
        except BrokenPipeError:
            self.finish()
            raise

    def finish(self) -> None:
        """Wait until the file is complete. If ffmpeg fails, raise OSError with its first message."""
        try:
            self._wait()
        except BaseException:  # an interrupt reaches this process only
            self.stop()
            raise
        if self._process.returncode:
            self._complaints.seek(0)
            complaint = _SOURCE.sub("", self._complaints.readline().decode(errors="replace").strip())
            raise OSError(EIO, complaint or f"ffmpeg ended with code {self._process.returncode}")

    def stop(self) -> None:
        """End the process, and leave the incomplete file."""
        self._process.kill()
        self._wait()

    def _wait(self) -> None:
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):
            self._process.stdin.close()
        self._process.wait()


def encoding_of_frames(output: Path, shape: tuple[int, ...], rate: float) -> Encoding:
    """Start ffmpeg to encode a film to `output`, whose frames `Encoding.write` then takes.

    Each frame has `shape`, (height, width, 3). `rate` is the number of frames per second [1/s].
    """
    codec, colors, *options = _FORMATS[form_of(output)].encoding
    height, width = shape[:2]
    frames = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}"]
    # codecs require even widths and heights
    even = ["-vf", f"scale={width + width % 2}:{height + height % 2}"] if width % 2 or height % 2 else []
    frames += ["-r", str(Fraction(rate).limit_denominator()), "-i", "-"]
    return Encoding([*frames, "-an", "-vcodec", codec, "-pix_fmt", colors, *even, *options], output)


def require_rate(rate: float) -> None:
    """Raise InputError if a frame rate [1/s] is too low for a film."""
    if rate < _SLOWEST:
        raise InputError(f"a film has at least {_SLOWEST:g} frames a second of simulated time, not {rate:g}")


@contextmanager
def _draft_of(target: Path) -> Iterator[Path]:
    """Yield a path to which the ``with`` block writes a film, which then replaces `target` (`draft_of`).

    A film of numbered pictures replaces no earlier one, because if that was longer, its last pictures would
    remain. Raises OutputError if there are earlier pictures.
    """
    if form_of(target) != SEQUENCE:
        with draft_of(target) as draft:
            yield draft
        return
    numbered = re.compile(re.sub(r"%\d*d", r"\\d+", re.escape(target.name)))
    if earlier := sorted(path for path in target.parent.iterdir() if numbered.fullmatch(path.name)):
        raise OutputError(f"refusing to overwrite '{earlier[0]}': remove the pictures '{target}' first")
    with naming(target), draft_folder(target) as folder:
        yield folder / target.name
        for draft in sorted(folder.iterdir()):
            publish(draft, target.with_name(draft.name))


class FilmWriter:
    """Writer of a film of snapshots, at `rate` frames per second [1/s], until the end of the ``with`` block.

    Raises ValueError if the film has no frame, OSError if it cannot be encoded.
    """

    def __init__(self, path: Path, painter: Painter, rate: float) -> None:
        self._path, self._rate, self.frames = path, rate, 0
        self._canvas = Canvas(painter, FILMS[form_of(path)].side)
        self._held = ExitStack()
        has_palette = not FILMS[form_of(path)].encoding
        self._encoded = draft_path(path) / "film.mkv" if has_palette else path
        self._encoder: Encoding | None = None

    def add(self, now: Snapshot) -> None:
        pixels = np.ascontiguousarray(self._canvas.pixels(now))
        if self._encoder is None:
            self._encoder = encoding_of_frames(self._encoded, pixels.shape, self._rate)
        self._encoder.write(pixels)
        self.frames += 1

    def __enter__(self) -> Self:
        if self._encoded != self._path:
            self._held.enter_context(draft_folder(self._path))
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        with self._held:
            if kind is None:
                self._finish()
            elif self._encoder is not None:
                self._encoder.stop()

    def _finish(self) -> None:
        if self._encoder is None:
            raise ValueError(f"no frame was drawn for '{self._path}'")
        self._encoder.finish()
        if self._encoded != self._path:
            palette = self._encoded.with_name("palette.png")
            film = ["-i", f"file:{self._encoded}"]
            one_file = ["-update", "1"]  # a % in its name is no pattern of many
            Encoding([*film, "-vf", _PALETTE, *one_file], palette).finish()
            film += ["-f", "png_pipe", "-i", f"file:{palette}"]
            Encoding([*film, "-lavfi", _WITH_PALETTE], self._path).finish()


def draw_film(
    recording: str | Path, output: str | Path, progress: bool = False, **looks: Unpack[Looks]
) -> list[int]:
    """Make a film of a recording; return the numbers of the recorded frames that the film shows.

    Parameters
    ----------
    looks
        Fields of `Look` that replace those of the recording. With `fps` and `slow`, the film shows every k-th
        recorded frame; k must be a whole number.

    Raises
    ------
    InputError
        A look is invalid, contacts were not recorded, or a file cannot be read or written.
    """
    from warpgrains.usd.recording import Recording, painter_of  # a film of a run needs no USD

    output = Path(output)
    require_writable_path("film", output, *(() if form_of(output) in FILMS else FILMS))
    if (size := looks.get("size")) is not None:
        size_of("size", size, is_film=True)
    source = Recording(recording)
    rate, slow = source.times.rate, looks.get("slow") or source.times.slow
    shown = looks.get("fps") or rate / slow
    step = rate / slow / shown
    if abs(step - round(step)) > 1e-9 or round(step) < 1:
        raise InputError(
            f"fps {shown:g} cannot be met: '{recording}' has {rate / slow:g} frames a second: give this, or"
            " a half or a third of it, and so on"
        )
    step = round(step) * max(1, ceil(shown / FILMS[form_of(output)].fastest))
    require_rate(rate / slow / step)
    frames, painter = range(0, len(source), step), painter_of(source, **looks)
    with (
        Lock(output),
        _draft_of(output) as draft,
        FilmWriter(draft, painter, rate / slow / step) as film,
        progress_bar(len(frames), shown=progress, unit="frame") as bar,
    ):
        for number in frames:
            film.add(source.frame(number, source.has_forces))
            bar.update()
    return list(frames)


class Film(DrawnOutput):
    """Output of a run as a film, see `DrawnOutput`. Each recorded snapshot becomes a frame."""

    def __init__(self, scene: Scene, options: RunOptions, times: FrameTimes, *_: object) -> None:
        require_rate(times.played)
        super().__init__(scene, options)
        self._rate = times.played

    def __enter__(self) -> Self:
        draft = self.enter_context(_draft_of(self._path))
        self._writer = self.enter_context(FilmWriter(draft, self._painter, self._rate))
        return self

    def record(self, now: Snapshot) -> None:
        self._writer.add(now)

    def __exit__(self, kind: type[BaseException] | None, *error: Any) -> bool | None:
        """Complete the film. After Ctrl-C, also complete it if it has at least two frames."""
        is_kept = kind is KeyboardInterrupt and self._writer.frames > 1
        return super().__exit__(*((None, None, None) if is_kept else (kind, *error)))
