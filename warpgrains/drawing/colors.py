"""Colors of grains: their tables and scales."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.drawing.colorings import COLORINGS, colorings_of
from warpgrains.errors import InputError
from warpgrains.scene import checks
from warpgrains.scene.snapshot import Snapshot

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

LEVELS = 64
"""Number of colors of a scale."""

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear red, green and blue (ITU-R BT.709)
_DARK = 0.18  # luminance of what looks half as bright as white
_CONTRAST = 0.4  # of a mark, in the color or its complement

# Okabe and Ito's colors, which color-blind readers tell apart too.
PALETTE: FloatArray = np.array(
    [
        (0.90, 0.62, 0.00),
        (0.34, 0.71, 0.91),
        (0.00, 0.62, 0.45),
        (0.94, 0.89, 0.26),
        (0.00, 0.45, 0.70),
        (0.84, 0.37, 0.00),
        (0.80, 0.47, 0.65),
    ]
)

# Matplotlib's perceptually uniform colormaps, safe for color-blind readers, at 32 points of the range, for
# use without Matplotlib. Colors between are interpolated in sRGB; tests/usd/test_colors.py bounds
# the error.
_COLORMAPS = {
    "viridis": """
        440154 470d60 48186a 482374 472e7c 453882 424186 3e4a89 3a548c 365d8d 32658e 2e6d8e 2b758e 287d8e
        25848e 228c8d 1f948c 1e9c89 20a386 25ab82 2eb37c 3aba76 48c16e 58c765 6ccd5a 7fd34e 93d741 a8db34
        c0df25 d5e21a eae51a fde725
    """,
    "cividis": """
        00224e 00285b 002e6a 053371 1c396f 293f6e 33446d 3c4a6c 45506c 4d556c 555b6d 5c616e 646770 6b6d72
        727274 787877 807f78 888578 908b78 979177 a09875 a89e73 b0a571 b9ab6d c2b369 cbb965 d3c05f dcc859
        e6d051 efd748 f8df3c fee838
    """,
    "plasma": """
        0d0887 220690 310597 3f049c 4e02a2 5b01a5 6700a8 7401a8 8104a7 8d0ba5 9814a0 a21d9a ad2793 b6308b
        bf3984 c7427c cf4c74 d6556d dd5e66 e3685f e97257 ef7c51 f3874a f79143 fa9e3b fca934 fdb52e fdc229
        fcd025 f9dd25 f5eb27 f0f921
    """,
    "managua": """
        ffcf67 f5bf62 ebb05d e1a158 d79152 cd844e c3774a b96c46 ae5f42 a3543f 97493c 8a3f3a 7c3639 702f3a
        652a3d 5c2843 542a4e 4f305b 4d376a 4c4179 4d4e8a 4f5a98 5266a5 5672b1 5b80bc 608dc6 659acf 6aa8d9
        70b8e3 76c7ec 7bd7f5 81e7ff
    """,
    "magma": """
        000004 030312 0a0822 130d34 1e1149 2a115c 38106c 451077 54137d 601880 6d1d81 792282 882781 942c80
        a1307e ae347b bd3977 ca3e72 d6456c e24d66 ec5860 f3655c f8745c fb835f fd9467 fea36f feb27a fec185
        fed194 fde0a1 fceeb0 fcfdbf
    """,
}


@dataclass(frozen=True)
class ColorScale:
    """Colors of a quantity, with the same colormap in recordings, pictures, films and windows."""

    quantity: str
    """One of `COLORINGS`."""
    low: float
    """Value of the first color; smaller values have it too."""
    high: float
    """Value of the last color; larger values have it too."""

    @property
    def label(self) -> str:
        """Name and unit of the quantity; a pure number has none."""
        unit = COLORINGS[self.quantity].unit
        return f"{self.quantity} [{unit}]" if unit else self.quantity

    def described(self) -> dict[str, str | float]:
        """Return the scale as a recording stores it."""
        unit, name, *_ = COLORINGS[self.quantity]
        return {"quantity": self.quantity, "unit": unit, "colormap": name, "low": self.low, "high": self.high}

    @classmethod
    def read(cls, described: Mapping[str, Any]) -> Self:
        name = checks.one_of("quantity of colors", described["quantity"], COLORINGS)
        return cls(name, *(checks.number(f"{end} of colors", described[end]) for end in ("low", "high")))

    def levels(self, values: FloatArray) -> IndexArray:
        """Return the index into `colors` of each value, shape (n,)."""
        reach = self.high - self.low
        share = np.clip((values - self.low) / reach, 0.0, 1.0) if reach > 0.0 else np.zeros_like(values)
        return np.rint(share * (LEVELS - 1)).astype(np.int64)

    def colors(self) -> FloatArray:
        """Colors from low to high (sRGB), shape (64, 3)."""
        return colormap(COLORINGS[self.quantity].colormap, np.linspace(0.0, 1.0, LEVELS))


class GrainColors:
    """Colors of the grains of a scene by one of `COLORINGS`, or the "palette" that distinguishes neighbors.

    Scales depend only on the scene, so that a color means the same in every snapshot and after a restart.
    `still` holds the index of the color of each grain, shape (n,), where it is constant. Raises InputError
    where `color_by` is unknown, or needs friction that the scene does not have.
    """

    def __init__(self, scene: Scene, color_by: str) -> None:
        coloring = COLORINGS.get(color_by) if isinstance(color_by, str) else None
        if coloring is not None and coloring.needs_friction and not scene.has_friction:
            raise InputError(f"color_by is {color_by!r}: it needs a scene with friction")
        checks.one_of("color_by", color_by, ["palette", *colorings_of(scene)])
        self.needs_contacts = coloring is not None and coloring.needs_contacts
        self.scale = None if coloring is None else ColorScale(color_by, *coloring.ends(scene))
        self.colors = PALETTE if self.scale is None else self.scale.colors()
        self.still: IndexArray | None = None
        if coloring is None:
            self.still = np.arange(scene.n) % len(PALETTE)
        elif self.scale is not None and not coloring.changes:
            self.still = self.scale.levels(getattr(scene, color_by))

    def levels(self, now: Snapshot) -> IndexArray:
        """Return the index of the color of each grain, shape (n,)."""
        if self.still is not None:
            return self.still
        assert self.scale is not None
        name = self.scale.quantity
        return self.scale.levels(now.recorded[name] if name in now.recorded else COLORINGS[name].values(now))

    def of(self, now: Snapshot) -> FloatArray:
        """Return the colors of the grains (sRGB), shape (n, 3)."""
        return self.colors[self.levels(now)]


def colormap(name: str, share: FloatArray) -> FloatArray:
    """Return the sRGB colors at shares of the range, shape (n,), as an array of shape (n, 3), in [0, 1]."""
    known = np.array(
        [[channel / 255.0 for channel in bytes.fromhex(word)] for word in _COLORMAPS[name].split()]
    )
    place = np.clip(share, 0.0, 1.0) * (len(known) - 1.0)
    return np.stack([np.interp(place, np.arange(len(known)), channel) for channel in known.T], axis=1)


def mark_color(color: FloatArray) -> FloatArray:
    """Return the colors (sRGB) of marks on grains of some colors (sRGB), shape (n, 3): darker, or lighter."""
    is_bright = linear(color) @ _LUMINANCE > _DARK
    return np.where(is_bright[..., np.newaxis], _CONTRAST * color, 1.0 - _CONTRAST * (1.0 - color))


def linear(encoded: FloatArray) -> NDArray[np.float32]:
    """Return the linear values of sRGB colors, as displayColor holds them."""
    values = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return values.astype(np.float32)


def encoded(linear: FloatArray) -> FloatArray:
    """Return the sRGB colors of linear values, as screens need them."""
    clipped = np.clip(linear, 0.0, 1.0)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1.0 / 2.4) - 0.055)
