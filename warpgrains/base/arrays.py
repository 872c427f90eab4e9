"""Types of arrays, named after their content."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]
"""Indices as the kernels store them, such as those of grains."""
IndexArray = NDArray[np.int64]
"""Indices as NumPy returns them."""
Indices = NDArray[np.integer[Any]]
"""Indices of either kind."""
BoolArray = NDArray[np.bool_]
