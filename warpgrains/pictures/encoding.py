"""Encoding by the ffmpeg that imageio-ffmpeg ships."""

import re
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from errno import EIO
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryFile

import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray

_FORMATS = {".mp4": "mp4", ".webp": "webp", ".gif": "gif", ".mkv": "matroska", ".png": "image2"}
"""What ffmpeg calls the kinds of files; left to itself it takes %d in a name for a number of images."""
_CODECS = {
    ".mp4": ("libx264", "yuv420p", ["-crf", "18", "-preset", "fast", "-movflags", "+faststart"]),
    ".webp": ("libwebp_anim", "yuv420p", ["-lossless", "0", "-q:v", "80", "-loop", "0"]),
    ".mkv": ("libx264rgb", "rgb24", ["-crf", "0", "-preset", "ultrafast"]),
}
_SOURCE = re.compile(r"^(\[[^]]*\] )+")  # of a complaint: the part of ffmpeg that it is from


class Encoding:
    """A process of ffmpeg that writes a file.

    Parameters
    ----------
    arguments
        Inputs and filters.
    output
        The file.
    """

    def __init__(self, arguments: Sequence[str | Path], output: Path) -> None:
        self._complaints = TemporaryFile()  # noqa: SIM115  # as long as the process
        program = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-loglevel", "error"]
        self._process = subprocess.Popen(
            [*program, *arguments, "-f", _FORMATS[output.suffix], f"file:{output}"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=self._complaints,
            process_group=0,  # Ctrl-C ends the run, which ends the process
        )

    def write(self, pixels: NDArray[np.uint8]) -> None:
        """Encode a frame (sRGB), shape (height, width, 3).

        Raises
        ------
        OSError
            The process has ended.
        """
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(pixels.data)
        except BrokenPipeError:
            self.finish()
            raise

    def finish(self) -> None:
        """Wait until the file is whole.

        Raises
        ------
        OSError
            It cannot be written: the message is the first line that ffmpeg says of it.
        """
        self._wait()
        if self._process.returncode:
            self._complaints.seek(0)
            complaint = _SOURCE.sub("", self._complaints.readline().decode(errors="replace").strip())
            raise OSError(EIO, complaint or f"ffmpeg ended with code {self._process.returncode}")

    def stop(self) -> None:
        """End the process, and leave the file as it is."""
        self._process.kill()
        self._wait()

    def _wait(self) -> None:
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):
            self._process.stdin.close()
        self._process.wait()


def encoding_of_frames(output: Path, shape: tuple[int, ...], rate: float) -> Encoding:
    """Return an encoding of frames of shape (height, width, 3); `rate` is in frames per second [1/s]."""
    codec, colors, options = _CODECS[output.suffix]
    height, width = shape[:2]
    frames = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}"]
    # codecs need even widths and heights
    even = ["-vf", f"scale={width + width % 2}:{height + height % 2}"] if width % 2 or height % 2 else []
    frames += ["-r", str(Fraction(rate).limit_denominator()), "-i", "-"]
    return Encoding([*frames, "-an", "-vcodec", codec, "-pix_fmt", colors, *even, *options], output)
