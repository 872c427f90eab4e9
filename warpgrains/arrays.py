"""Arrays by what they hold."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]
"""Grains as the kernels number them."""
IndexArray = NDArray[np.int64]
"""Grains as NumPy numbers them."""
BoolArray = NDArray[np.bool_]
