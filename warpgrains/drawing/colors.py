"""Colors of grains: their tables and scales."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from warpgrains.base import checks
from warpgrains.base.arrays import BoolArray, FloatArray, IndexArray
from warpgrains.base.errors import InputError, requiring
from warpgrains.drawing.colorings import COLORINGS, colorings_of, numbers_of_birth, start_height
from warpgrains.drawing.kinds import colors_of, range_of
from warpgrains.scene.snapshot import Snapshot

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

LEVELS = 64
"""Number of colors of a scale."""

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear red, green and blue (ITU-R BT.709)
_DARK = 0.18  # luminance of what looks half as bright as white
_CONTRAST = 0.4  # of a mark, in the color or its complement

# Pebbles: light, warm, and a little apart from each other.
PALETTE: FloatArray = np.array(
    colors_of("palette", "#e0caa5,#d8ba91,#ddc19b,#d2b189,#dac4a2,#d5b58f,#cfb290")
)

# Okabe and Ito's colors, which color-blind readers tell apart too.
BANDS: FloatArray = np.array(colors_of("bands", "#e69f00,#56b4e9,#009e73,#f0e442,#0072b2,#d55e00,#cc79a7"))
_BANDS = 8  # from the lowest grain to the highest one at the start

# Matplotlib's colormaps, safe for color-blind readers, at points of the range between which colors are
# interpolated in sRGB, for use without Matplotlib; tests/usd/test_colors.py bounds the error.
_COLORMAPS = {
    "viridis": """
        440154 470d60 48186a 482374 472e7c 453882 424186 3e4a89 3a548c 365d8d 32658e 2e6d8e 2b758e 287d8e
        25848e 228c8d 1f948c 1e9c89 20a386 25ab82 2eb37c 3aba76 48c16e 58c765 6ccd5a 7fd34e 93d741 a8db34
        c0df25 d5e21a eae51a fde725
    """,
    "plasma": """
        0d0887 220690 310597 3f049c 4e02a2 5b01a5 6700a8 7401a8 8104a7 8d0ba5 9814a0 a21d9a ad2793 b6308b
        bf3984 c7427c cf4c74 d6556d dd5e66 e3685f e97257 ef7c51 f3874a f79143 fa9e3b fca934 fdb52e fdc229
        fcd025 f9dd25 f5eb27 f0f921
    """,
    "YlGnBu": "ffffd9 edf8b1 c6e9b4 7ecdbb 40b5c4 1d90c0 225da8 243392 081d58",
    "YlOrBr": "ffffe5 fff7bc fee390 fec34f fe9829 eb6f14 cb4b02 983404 662506",
    "YlGn": "ffffe5 f7fcb9 d9f0a3 acdd8e 77c679 40aa5c 228343 006737 004529",
    "Purples": "fcfbfd efedf5 dadaeb bcbddc 9e9ac8 807cba 6950a3 53268f 3f007d",
    "PuOr": "7f3b08 b25706 e08214 fcb761 fee0b6 f6f6f7 d8daeb b1aad1 8073ac 532687 2d004b",
}


@dataclass(frozen=True)
class ColorScale:
    """Scale from the values of a quantity to colors, the same in recordings, pictures, films and the page."""

    quantity: str
    """One of `COLORINGS`."""
    low: float
    """Value of the first color, which smaller values also have."""
    high: float
    """Value of the last color, which larger values also have."""
    colormap: str
    """Name of a colormap, or a list of colors, see `Look.colors`."""

    @property
    def label(self) -> str:
        """Name and unit of the quantity, and "root scale" if colors follow the square root."""
        unit, root = COLORINGS[self.quantity].unit, ", root scale" * COLORINGS[self.quantity].has_root
        return f"{self.quantity} [{unit}]{root}" if unit else self.quantity

    def described(self) -> dict[str, str | float]:
        """Return the scale as a recording stores it."""
        return {"unit": COLORINGS[self.quantity].unit, **asdict(self)}

    @classmethod
    def read(cls, described: Mapping[str, Any]) -> Self:
        """Return the scale that a recording stores. Raises InputError if it is damaged."""
        name = checks.one_of("quantity of colors", described["quantity"], COLORINGS)
        low, high = (checks.number(f"{end} of colors", described[end]) for end in ("low", "high"))
        colors = checks.text("colormap of colors", described["colormap"])
        colormap(colors, np.zeros(1))
        return cls(name, low, high, colors)

    def levels(self, values: FloatArray) -> IndexArray:
        """Return the color of each value as an index into the result of `colors`, shape (n,)."""
        reach = self.high - self.low
        share = np.clip((values - self.low) / reach, 0.0, 1.0) if reach > 0.0 else np.zeros_like(values)
        share = np.sqrt(share) if COLORINGS[self.quantity].has_root else share
        return np.rint(share * (LEVELS - 1)).astype(np.int64)

    def colors(self) -> FloatArray:
        """Return the colors from low to high (sRGB), shape (64, 3)."""
        return colormap(self.colormap, np.linspace(0.0, 1.0, LEVELS))


class GrainColors:
    """Colors of the grains of a scene.

    `color_by` is one of `COLORINGS`, whose values have a scale of colors, or one of `CATEGORIES`, which have
    tables of colors without a scale. `colors` and `range` are those of `Look`. The scale depends only on the
    scene, so that a color means the same in every snapshot and after a restart. If the colors of grains do
    not change during a run, `still` holds their indices, shape (n,). In scenes with sources or sinks they
    change.

    Raises InputError if `color_by` is unknown or needs friction that the scene does not have, or if a `range`
    is given and there is no scale.
    """

    def __init__(
        self, scene: Scene, color_by: str, colors: str | None = None, range: str | None = None
    ) -> None:
        coloring = COLORINGS.get(color_by) if isinstance(color_by, str) else None
        if coloring is not None and coloring.needs_friction and not scene.has_friction:
            raise InputError(f"color_by is {color_by!r}: it needs a scene with friction")
        checks.one_of("color_by", color_by, [*CATEGORIES, *colorings_of(scene)])
        if scene.exchanges_grains and color_by in OF_START:
            raise InputError(
                f"color_by is {color_by!r}: it is that of the start, and sources add grains later"
            )
        self.needs_contacts = coloring is not None and coloring.needs_contacts
        self.scale: ColorScale | None = None
        self.still: IndexArray | None = None
        if coloring is not None:
            ends = coloring.ends(scene) if range is None else range_of("range", range)
            self.scale = ColorScale(color_by, *ends, colors or coloring.colormap)
            self.colors = self.scale.colors()
            if not (coloring.changes or scene.exchanges_grains):
                self.still = self.scale.levels(coloring.values(scene))
        else:
            if range is not None:
                raise InputError(
                    f"range has no effect on color_by {color_by!r}, which has no scale, as speed has"
                )
            self.colors, self._number = CATEGORIES[color_by]
            if colors is not None:
                listed = colors_of("colors", colors)
                self.colors = np.array(listed or colormap(colors, np.linspace(0.0, 1.0, len(self.colors))))
            if not scene.exchanges_grains:
                self.still = self._number(scene) % len(self.colors)

    def levels(self, now: Snapshot) -> IndexArray:
        """Return the color of each grain as an index into the attribute `colors`, shape (n,)."""
        if self.still is not None:
            return self.still
        if self.scale is None:
            return self._number(now) % len(self.colors)
        name = self.scale.quantity
        return self.scale.levels(now.recorded[name] if name in now.recorded else COLORINGS[name].values(now))

    def of(self, now: Snapshot) -> FloatArray:
        """Return the colors of the grains (sRGB), shape (n, 3)."""
        return self.colors[self.levels(now)]


def _bands(scene: Scene) -> IndexArray:
    """Return the horizontal band in which each grain starts, as a number, 0 at the bottom, shape (n,)."""
    height = start_height(scene)
    share = (height - height.min()) / (np.ptp(height) or 1.0)
    return np.minimum((_BANDS * share).astype(np.int64), _BANDS - 1)


CATEGORIES: dict[str, tuple[FloatArray, Callable[[Any], IndexArray]]] = {
    "palette": (PALETTE, numbers_of_birth),
    "bands": (BANDS, _bands),
}
"""Tables of colors without a scale, by the value of `color_by`.

Each comes with a function that takes a snapshot or a scene, and returns a number per grain. The color of a
grain is table[number % len(table)].
"""
OF_START = ("bands", "height")
"""Values of `color_by` for which the color of a grain depends on its position at the start."""


def colormap(name: str, share: FloatArray) -> FloatArray:
    """Return the colors of a colormap (sRGB), shape (n, 3), at parameters `share` from 0 to 1, shape (n,).

    `name` is the name of a colormap of Matplotlib, or a list of colors, separated by commas.
    """
    forwards = name.removesuffix("_r")
    if "," in name:
        known = np.array(colors_of("colors", name))
    elif forwards in _COLORMAPS:
        codes = map(bytes.fromhex, _COLORMAPS[forwards].split())
        known = np.array([[*code] for code in codes])[:: 1 if name == forwards else -1] / 255.0
    else:
        with requiring(f"colors {name!r}", "report"):
            from matplotlib import colormaps
        if name not in colormaps:
            nearest = (get_close_matches(name, colormaps, n=1) or ["viridis"])[0]
            raise InputError(
                f"unknown colors {checks.shown(name)}: give a colormap of Matplotlib, such as {nearest}, or a"
                " list of colors, such as '#e8d3a8,tan'"
            )
        known = colormaps[name](np.linspace(0.0, 1.0, 256))[:, :3]
    place = np.clip(share, 0.0, 1.0) * (len(known) - 1.0)
    return np.stack([np.interp(place, np.arange(len(known)), channel) for channel in known.T], axis=1)


def mark_color(color: FloatArray) -> FloatArray:
    """Return the color of the mark, which shows rotation, on grains of these colors (sRGB), shape (n, 3).

    It is darker than the grain, or lighter if the grain is dark.
    """
    return np.where(is_dark(color)[..., np.newaxis], 1.0 - _CONTRAST * (1.0 - color), _CONTRAST * color)


def is_dark(color: FloatArray) -> BoolArray:
    """Return whether each color (sRGB), shape (..., 3), looks less than half as bright as white."""
    return np.asarray(linear(color) @ _LUMINANCE <= _DARK)


def linear(encoded: FloatArray) -> NDArray[np.float32]:
    """Convert sRGB colors to linear values, which displayColor of USD holds."""
    values = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return values.astype(np.float32)


def encoded(linear: FloatArray) -> FloatArray:
    """Convert linear values to sRGB colors, which screens show."""
    clipped = np.clip(linear, 0.0, 1.0)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1.0 / 2.4) - 0.055)
