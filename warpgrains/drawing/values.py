"""Arrays as a recording holds them: float32, in three dimensions."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

_INFINITY = np.float32(np.inf)


def triples(values: NDArray[Any]) -> NDArray[np.float32]:
    """Return values, shape (n, 2), as the file shows them: float32, shape (n, 3), the third component 0."""
    shown = np.zeros((len(values), 3), dtype=np.float32)
    shown[:, :2] = values
    return shown


def covering_extent(shown: NDArray[np.float32], half_width: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the float32 box [m] that covers spheres, rounded outwards.

    Centres [m], shape (n, 3), n >= 1, and half the widths [m], shape (n,), are as the file shows them.
    """
    edges = np.empty((3, len(shown)))  # a row a component: NumPy reduces long rows much faster
    box = np.empty((2, 3), dtype=np.float32)
    low = np.subtract(shown.T, half_width, out=edges).min(axis=1)
    np.nextafter(low.astype(np.float32), -_INFINITY, out=box[0])
    high = np.add(shown.T, half_width, out=edges).max(axis=1)
    np.nextafter(high.astype(np.float32), _INFINITY, out=box[1])
    return box
