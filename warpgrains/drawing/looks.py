"""Options for the look of pictures, films and recordings, the same for runs, `plot` and Python."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypedDict

from warpgrains.base import checks
from warpgrains.base.described import described, described_fields
from warpgrains.base.errors import InputError, written_as
from warpgrains.drawing.kinds import color_of, colors_of, frame_of, range_of, size_of

DEFAULT_RATE = 24.0
"""Frames per second [1/s] at which Blender plays by default."""
COLORS = ("palette", "bands", "height", "id", "radius", "speed", "pressure", "force", "spin", "mobilized")
"""Values of `color_by`: the names of `CATEGORIES` and `COLORINGS`."""


def option(
    meaning: str,
    check: Callable[[str, Any], Any],
    metavar: str | None = None,
    default: Any = None,
    **more: Any,
) -> Any:
    """Return a dataclass field for an option of runs, with its help text `meaning`.

    `check` takes its name and value, and returns the value or raises InputError. Without a `metavar`, the
    option is a switch. `more` may hold `needs`, the name of an option without which this one has no effect.
    It may also hold `flag`: the flag on the command line if that is not the name of the field, or None if
    there is none.
    """
    return described(meaning, default=default, **{"needs": None} | more, check=check, metavar=metavar)


_look = partial(option, needs="record")


def _readable(read: Callable[[str, Any], object], example: str) -> Callable[[str, Any], str]:
    """Return a `check` for `option` of texts, such as `example`, that `read(field, text)` can parse.

    The check returns the text itself, not the result of `read`.
    """

    def check(field: str, text: Any) -> str:
        if not isinstance(text, str):
            raise InputError(f"{field} is {checks.shown(text)}: it must be a text, such as {example!r}")
        read(field, text)
        return text

    return check


class Looks(TypedDict, total=False):
    """The fields of `Look` as keyword arguments, for type checkers."""

    color_by: str
    colors: str | None
    range: str | None
    forces: bool
    size: str | None
    frame: str | None
    background: str
    clean: bool
    fps: float
    slow: float | None


@dataclass(frozen=True, kw_only=True)
class Look:
    """Look of grains and walls in pictures, films and recordings. Raises InputError for invalid values."""

    color_by: str = _look(
        f"Color of grains: {', '.join(COLORS)}; the last two with friction.", checks.text, "WHAT", "palette"
    )
    colors: str | None = _look(
        "Other colors: a colormap such as viridis, or a list such as '#e8d3a8,tan'.",
        _readable(colors_of, "#e8d3a8,tan"),
        "COLORS",
    )
    range: str | None = _look(
        "Values of the first and the last color, in the unit of the quantity.",
        _readable(range_of, "0,0.5"),
        "LOW,HIGH",
    )
    forces: bool = _look("Draw force chains.", checks.boolean, default=False)
    size: str | None = _look(
        "Width and height of a film or a picture [pixels]; without it, they follow from the frame.",
        _readable(size_of, "1920x1080"),
        "WIDTHxHEIGHT",
    )
    frame: str | None = _look(
        "Rectangle to show [m], also by the camera of a USD file; without it, the grains and the walls that"
        " they can touch.",
        _readable(frame_of, "-0.5,0,0.5,1"),
        "X0,Y0,X1,Y1",
    )
    background: str = _look(
        "Color behind a film or a picture.", _readable(color_of, "#ffffff"), "COLOR", "#ffffff"
    )
    clean: bool = _look("Draw grains and walls alone, without texts.", checks.boolean, default=False)
    fps: float = _look("Frames per second [1/s] as played, exactly.", checks.positive, "F", DEFAULT_RATE)
    slow: float | None = _look(
        "How many times slower than it happened it plays; without it 1, or for a film of less than a second"
        " and without fps, what makes it last about two.",
        checks.positive,
        "S",
    )

    def __post_init__(self) -> None:
        for name, one in described_fields(type(self)).items():
            value = getattr(self, name)
            if value is not None or one.default is not None:
                object.__setattr__(self, name, one.metadata["check"](name, value))

    @property
    def pixels(self) -> tuple[int, int] | None:
        """Width and height of a film or a picture [pixels], if given."""
        return None if self.size is None else size_of("size", self.size)

    @property
    def changed(self) -> dict[str, Any]:
        """Fields that differ from their defaults, by name, without `fps` and `slow`."""
        names = [name for name in LOOKS if getattr(self, name) != LOOKS[name].default]
        return {name: getattr(self, name) for name in names if name not in ("fps", "slow")}


LOOKS = described_fields(Look)
"""The fields of `Look` by name."""


def with_style(given: Mapping[str, Any], style: str | Path | None) -> dict[str, Any]:
    """Return the options `given`, by name, completed by those in the TOML file `style`, if not None.

    Raises InputError if the file cannot be read, or holds an option that `LOOKS` lacks or an invalid value.
    """
    if style is None:
        return dict(given)
    from warpgrains.scene.toml import parse_toml  # imports NumPy, which --help does not need

    path = Path(checks.path("style", style))
    try:
        table = parse_toml(path.read_text(), path)
    except (OSError, UnicodeDecodeError) as error:
        told = "does not exist" if isinstance(error, FileNotFoundError) else f"cannot be read: {error}"
        raise InputError(
            f"style '{path}' {told}: give a TOML file of looks, such as color_by = 'speed'"
        ) from None
    for name in table:
        checks.one_of(f"key of style '{path}'", name, LOOKS)
    with written_as({}, f"style '{path}'"):
        Look(**table)
    return table | dict(given)
