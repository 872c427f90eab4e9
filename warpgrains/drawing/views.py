"""Views: what a picture shows, and its size in pixels."""

from typing import TYPE_CHECKING, Any

from warpgrains.errors import InputError
from warpgrains.scene import checks
from warpgrains.scene.box import Box

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

_MARGIN = 0.04  # about the extent, in half of its longer side: walls are drawn outside of the grains' space
_SMALLEST, _LARGEST = 64, 8192  # pixels


def view_of(scene: "Scene", frame: str | None = None) -> Box:
    """Return the rectangle that pictures of a scene show: a frame as in `frame_of`, or its extent."""
    return scene.extent.grown(_MARGIN * scene.extent.half) if frame is None else frame_of("frame", frame)


def frame_of(field: str, text: Any) -> Box:
    """Return the rectangle of a text "X0,Y0,X1,Y1" [m]. Raises InputError unless X0 < X1 and Y0 < Y1."""
    words = checks.text(field, text).split(",")
    try:
        box = Box(*(checks.number(field, float(word)) for word in words))
    except (TypeError, ValueError):
        raise InputError(f"{field} is {text!r}: it must be X0,Y0,X1,Y1 in m, such as -0.5,0,0.5,1") from None
    if not (0.0 < box.width < float("inf") and 0.0 < box.height < float("inf")):
        raise InputError(f"{field} is {text!r}: X0 must be less than X1, and Y0 less than Y1")
    return box


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
