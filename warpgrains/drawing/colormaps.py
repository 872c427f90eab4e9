"""Colormaps: Matplotlib's perceptually uniform ones, safe for color-blind eyes, at 32 places each.

They stand here since recordings must be colored where Matplotlib is not installed. The place of a color is
its share of the range, from 0 to 1; between two places colors are interpolated in sRGB, which errs by less
than 0.025 (tests/usd/test_appearance.py).
"""

import numpy as np
from numpy.typing import NDArray

from warpgrains.arrays import FloatArray

_COLORS = {
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
}

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


def colormap(name: str, share: FloatArray) -> FloatArray:
    """Return the sRGB colors at shares of the range, shape (n,), as an array of shape (n, 3), in [0, 1]."""
    known = np.array([[channel / 255.0 for channel in bytes.fromhex(word)] for word in _COLORS[name].split()])
    place = np.clip(share, 0.0, 1.0) * (len(known) - 1.0)
    return np.stack([np.interp(place, np.arange(len(known)), channel) for channel in known.T], axis=1)


def linear(encoded: FloatArray) -> NDArray[np.float32]:
    """Return the linear values of sRGB colors, which is what displayColor holds."""
    values = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return values.astype(np.float32)


def encoded(linear: FloatArray) -> FloatArray:
    """Return the sRGB colors of linear values, as screens take them."""
    clipped = np.clip(linear, 0.0, 1.0)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1.0 / 2.4) - 0.055)
