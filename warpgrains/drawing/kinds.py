"""Kinds of outputs of runs, by the suffix of their files, and what their options say."""

from __future__ import annotations

import re
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from warpgrains.base import checks
from warpgrains.base.errors import InputError, requiring
from warpgrains.base.files import suffix_of
from warpgrains.space.bounds import Bounds

if TYPE_CHECKING:
    from warpgrains.drawing.frames import FrameTimes
    from warpgrains.scene.scene import Scene
    from warpgrains.scene.snapshot import Snapshot
    from warpgrains.simulation.options import RunOptions

RECORDINGS = (".usdc", ".usda", ".usdz")
STILLS = (".png", ".pdf", ".svg")
SEQUENCE = "%d.png"
"""Form of a film that is one picture for each frame, with the number of the frame in its name."""

_NUMBERED = re.compile(r"[^%]*%0?\d?d[^%]*\.png", re.IGNORECASE)

_SMALLEST, _LARGEST = 64, 8192  # pixels of a side of a picture


class FilmFormat(NamedTuple):
    """Options of ffmpeg for a film, or for a file on the way to one."""

    container: str
    """ffmpeg's name of the file format; without one, it takes %d in a file name for a sequence of images."""
    encoding: tuple[str, ...] = ()
    """Codec, format of the pixels, and options; empty if the film needs a palette of all its frames first."""
    side: int = 400
    """Longer side of what a frame shows [pixels], unless the film has a size."""
    fastest: float = 50.0
    """Largest frame rate that browsers play, or ffmpeg writes [1/s]."""


SLOWEST = 1e-4
"""Least frame rate of a film [1/s], which ffmpeg takes as a fraction."""
_H264 = ("libx264", "yuv420p", "-crf", "18", "-preset", "fast", "-movflags", "+faststart")
FILMS = {
    ".mp4": FilmFormat("mp4", _H264, side=720, fastest=1e6),
    ".mov": FilmFormat("mov", _H264, side=720, fastest=1e6),
    ".gif": FilmFormat("gif"),
    ".webp": FilmFormat("webp", ("libwebp_anim", "yuv420p", "-lossless", "0", "-q:v", "80", "-loop", "0")),
    SEQUENCE: FilmFormat("image2", ("png", "rgb24", "-start_number", "0"), side=720, fastest=1e6),
}
"""Formats of films, see `form_of`."""


class Output(AbstractContextManager[Any], Protocol):
    """Interface of a file that receives frames of a run, and is complete at the end of the ``with`` block."""

    needs_contacts: bool
    """Whether frames must have contacts."""

    def record(self, now: Snapshot) -> None:
        """Append the next frame, which is at its time; a picture's only frame is the end."""

    def flush(self) -> None:
        """Flush to the disk the frames from which a later run can continue."""


class Kind(NamedTuple):
    name: str
    shows: str
    """What it is, for users."""
    suffixes: tuple[str, ...]
    factory: str
    """Where to find the function that `opened` calls, `module:name`; its module is imported then."""
    extra: str | None = None
    """Extra with the libraries that it needs."""
    has_frames: bool = True
    """Whether it shows the whole run; otherwise it is a picture of the end."""
    continues: bool = False
    """Whether a run that is resumed from a checkpoint continues it."""
    lacks: tuple[str, ...] = ()
    """Options of runs that have no effect on it."""

    @property
    def listed(self) -> str:
        return ", ".join(self.suffixes)

    def opened(
        self, scene: Scene, options: RunOptions, times: FrameTimes | None, resume_at: int | None
    ) -> Output:
        """Return a locked output of a run, which continues at a frame if the run is resumed."""
        with requiring(f"'{options.record}'", self.extra) if self.extra else nullcontext():
            factory = resolve_name(f"warpgrains.{self.factory}")
        output: Output = factory(scene, options, times, resume_at)
        return output


RECORDING = Kind(
    "recording", "a USD file of the frames, the present state first", RECORDINGS,
    "usd.recorder:Recorder", continues=True, lacks=("size", "background", "clean"),
)  # fmt: skip
FILM = Kind("film", "a film of them", tuple(FILMS), "pictures.film:Film", "film", lacks=("draw_as",))
STILL = Kind(
    "still", "a picture of the end", STILLS, "pictures.still:Still", "report",
    has_frames=False, lacks=("draw_as", "fps", "slow"),
)  # fmt: skip
KINDS = {suffix: kind for kind in (RECORDING, FILM, STILL) for suffix in kind.suffixes}
"""Kinds of outputs, see `form_of`."""


def form_of(path: str | Path) -> str:
    """Return the suffix of a file's name in lower case; `SEQUENCE` for a name such as "a_%04d.png"."""
    return SEQUENCE if _NUMBERED.fullmatch(Path(path).name) else suffix_of(path)


def described_kinds() -> str:
    """Return what there is to record, with the suffixes."""
    *first, last = (f"{kind.shows} ({kind.listed})" for kind in dict.fromkeys(KINDS.values()))
    return f"{', '.join(first)} or {last}"


def frame_of(field: str, text: Any) -> Bounds:
    """Return the rectangle of a text "X0,Y0,X1,Y1" [m]. Raises InputError unless X0 < X1 and Y0 < Y1."""
    box = Bounds(*_numbers(field, text, 4, "X0,Y0,X1,Y1 in m, such as -0.5,0,0.5,1"))
    if not (0.0 < box.width < float("inf") and 0.0 < box.height < float("inf")):
        raise InputError(f"{field} is {text!r}: X0 must be less than X1, and Y0 less than Y1")
    return box


def range_of(field: str, text: Any) -> tuple[float, float]:
    """Return the numbers of a text "LOW,HIGH". Raises InputError unless LOW < HIGH."""
    low, high = _numbers(field, text, 2, "LOW,HIGH, such as 0,0.5")
    if not low < high:
        raise InputError(f"{field} is {text!r}: LOW must be less than HIGH")
    return low, high


def _numbers(field: str, text: Any, count: int, form: str) -> list[float]:
    words = checks.text(field, text).split(",")
    try:
        found = [checks.number(field, float(word)) for word in words]
    except ValueError:
        found = []
    if len(found) != count:
        raise InputError(f"{field} is {text!r}: it must be {form}")
    return found


def size_of(field: str, text: Any, is_film: bool = False) -> tuple[int, int]:
    """Return the numbers of a text "WIDTHxHEIGHT" [pixels]. Raises InputError if no picture has them."""
    words = checks.text(field, text).split("x")
    if len(words) != 2 or not all(word.isascii() and word.isdigit() for word in words):
        raise InputError(f"{field} is {text!r}: it must be WIDTHxHEIGHT in pixels, such as 1920x1080")
    width, height = (int(word[:9]) for word in words)
    if not all(_SMALLEST <= side <= _LARGEST for side in (width, height)):
        raise InputError(f"{field} is {text!r}: each side must have {_SMALLEST} to {_LARGEST} pixels")
    if is_film and (width % 2 or height % 2):
        raise InputError(f"{field} is {text!r}: a film needs even numbers of pixels")
    return width, height


def color_of(field: str, text: str) -> tuple[float, float, float]:
    """Return a color (sRGB) of a text, such as "#e8d3a8" or, with Matplotlib, a name."""
    if re.fullmatch("#[0-9a-fA-F]{6}", text):
        red, green, blue = (channel / 255.0 for channel in bytes.fromhex(text[1:]))
        return red, green, blue
    with requiring(f"{field} {text!r}", "report"):
        from matplotlib.colors import is_color_like, to_rgb
    if not is_color_like(text):
        raise InputError(f"{field} is {text!r}: it must be a color, such as '#e8d3a8' or tan")
    return to_rgb(text)


def colors_of(field: str, text: str) -> list[tuple[float, float, float]] | None:
    """Return the colors (sRGB) of a text of several, with commas between; None for a colormap's name."""
    return [color_of(field, one.strip()) for one in text.split(",")] if "," in text else None


def require_drawing(what: str, is_film: bool = False) -> None:
    """Raise InputError unless the libraries for a picture, or a film of it, are installed."""
    with requiring(what, "film" if is_film else "report"):
        import matplotlib.axes  # noqa: F401

        if is_film:
            import imageio_ffmpeg  # noqa: F401
