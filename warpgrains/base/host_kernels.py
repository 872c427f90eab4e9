"""Functions that run Warp kernels with one thread of the host, on the memory of NumPy arrays."""

from functools import cache
from typing import Any

import numpy as np
import warp as wp

from warpgrains.base import kernel_cache

Array = np.ndarray[Any, Any]


def shared(array: Array, dtype: Any = None) -> Any:
    """Return a Warp array on the memory of a NumPy array, by default with the `dtype` of the latter."""
    dtype = dtype or wp.dtype_from_numpy(array.dtype)
    return wp.array(array, dtype=dtype, device="cpu", copy=False)


def share(record: Any, arrays: dict[str, Array]) -> None:
    """Set fields of the Warp struct `record` to Warp arrays on the memory of NumPy arrays.

    `arrays` holds the NumPy arrays by name of field.
    """
    for name, array in arrays.items():
        setattr(record, name, shared(array))


@cache
def _load(module: Any) -> None:
    kernel_cache.load(module, wp.get_device("cpu"), 1)


def launch(kernel: Any, inputs: list[Any]) -> None:
    """Launch a kernel with one thread on the CPU. Other Python threads may launch it at the same time."""
    _load(kernel.module)
    wp.launch(kernel, dim=1, inputs=inputs, device="cpu")
