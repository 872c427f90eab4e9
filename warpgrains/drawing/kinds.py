"""Kinds of outputs of runs, by the suffix of their files, and parsers of the texts of their options."""

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
"""Result of `form_of` for a film that consists of pictures, with the number of the frame in their names."""

_NUMBERED = re.compile(r"[^%]*%0?\d?d[^%]*\.png", re.IGNORECASE)

_SMALLEST, _LARGEST = 64, 8192  # pixels of a side of a picture


class FilmFormat(NamedTuple):
    """Options of ffmpeg for a film, or for an intermediate file of one."""

    container: str
    """ffmpeg's name of the file format."""
    encoding: tuple[str, ...] = ()
    """Codec, format of the pixels, and options; empty if the film needs a palette of all its frames first."""
    side: int = 400
    """Longer side of the axes in a frame [pixels], if the film is given no size."""
    fastest: float = 50.0
    """Largest frame rate that ffmpeg can write and browsers can play in this format [1/s]."""


_H264 = ("libx264", "yuv420p", "-crf", "18", "-preset", "fast", "-movflags", "+faststart")
FILMS = {
    ".mp4": FilmFormat("mp4", _H264, side=720, fastest=1e6),
    ".mov": FilmFormat("mov", _H264, side=720, fastest=1e6),
    ".gif": FilmFormat("gif"),
    ".webp": FilmFormat("webp", ("libwebp_anim", "yuv420p", "-lossless", "0", "-q:v", "80", "-loop", "0")),
    SEQUENCE: FilmFormat("image2", ("png", "rgb24", "-start_number", "0"), side=720, fastest=1e6),
}
"""Formats of films, by the result of `form_of`."""


class Output(AbstractContextManager[Any], Protocol):
    """Interface of a file that receives frames of a run, and is complete at the end of the ``with`` block."""

    needs_contacts: bool
    """Whether frames must have contacts."""

    def record(self, now: Snapshot) -> None:
        """Append a snapshot, which is already moved to its frame's time.

        A picture receives only the last state.
        """

    def flush(self) -> None:
        """Write all frames so far to the disk, so that a later run can continue after them."""


class Kind(NamedTuple):
    """A kind of output of runs."""

    name: str
    shows: str
    """Phrase for users that names the content of the output."""
    suffixes: tuple[str, ...]
    factory: str
    """Function that `opened` imports and calls, as "module:name"."""
    extra: str | None = None
    """Extra of this package that installs the libraries for the output; None if it needs none."""
    has_frames: bool = True
    """Whether the output shows the whole run rather than its end."""
    continues: bool = False
    """Whether a run that is resumed from a checkpoint can continue the output."""
    lacks: tuple[str, ...] = ()
    """Options of runs that have no effect on the output."""

    @property
    def listed(self) -> str:
        return ", ".join(self.suffixes)

    def opened(
        self, scene: Scene, options: RunOptions, times: FrameTimes | None, resume_at: int | None
    ) -> Output:
        """Create the output of a run, which no other process can write meanwhile, and return it.

        `times` is None for an output without frames. If `resume_at` is not None, continue the output of an
        earlier run at this frame.
        """
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
"""Kinds of outputs, by the result of `form_of`."""


def form_of(path: str | Path) -> str:
    """Return the suffix of a file's name in lower case, or `SEQUENCE` for a name such as "a_%04d.png"."""
    return SEQUENCE if _NUMBERED.fullmatch(Path(path).name) else suffix_of(path)


def described_kinds() -> str:
    """Return a description of all kinds of outputs with their suffixes, for users."""
    *first, last = (f"{kind.shows} ({kind.listed})" for kind in dict.fromkeys(KINDS.values()))
    return f"{', '.join(first)} or {last}"


def frame_of(field: str, text: Any) -> Bounds:
    """Parse a rectangle "X0,Y0,X1,Y1" [m].

    Raises InputError, which names `field`, unless X0 < X1 and Y0 < Y1.
    """
    box = Bounds(*_numbers(field, text, 4, "X0,Y0,X1,Y1 in m, such as -0.5,0,0.5,1"))
    if not (0.0 < box.width < float("inf") and 0.0 < box.height < float("inf")):
        raise InputError(f"{field} is {text!r}: X0 must be less than X1, and Y0 less than Y1")
    return box


def range_of(field: str, text: Any) -> tuple[float, float]:
    """Parse a range "LOW,HIGH". Raises InputError, which names `field`, unless LOW < HIGH."""
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
    """Parse a size "WIDTHxHEIGHT" [pixels].

    Raises InputError, which names `field`, if a side is too short or long, or odd for a film.
    """
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
    """Parse a color such as "#e8d3a8", or a name if Matplotlib is installed, to sRGB.

    Raises InputError, which names `field`, if it is no color.
    """
    if re.fullmatch("#[0-9a-fA-F]{6}", text):
        red, green, blue = (channel / 255.0 for channel in bytes.fromhex(text[1:]))
        return red, green, blue
    with requiring(f"{field} {text!r}", "report"):
        from matplotlib.colors import is_color_like, to_rgb
    if not is_color_like(text):
        raise InputError(f"{field} is {text!r}: it must be a color, such as '#e8d3a8' or tan")
    return to_rgb(text)


def colors_of(field: str, text: str) -> list[tuple[float, float, float]] | None:
    """Parse a list of colors, separated by commas, to sRGB.

    None if the text has no comma, because then it is the name of a colormap.
    """
    return [color_of(field, one.strip()) for one in text.split(",")] if "," in text else None
