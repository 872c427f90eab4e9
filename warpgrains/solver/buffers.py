"""The memory layout of scenes: each scene has one block of memory for all arrays of its record."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from math import prod
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpgrains.base.arrays import IndexArray
from warpgrains.kernels.record import SceneRecord
from warpgrains.solver.sizes import Sizes, lengths

ALIGNMENT = 16  # bytes
LINE = 128  # bytes: two cache lines, which cores transfer together


class ArrayField(NamedTuple):
    """Name and element type of an array of `SceneRecord`."""

    path: tuple[str, ...]
    """Names of the enclosing structs and of the array."""
    dtype: np.dtype
    shape: tuple[int, ...]
    """Type and shape of one element for NumPy."""

    @property
    def name(self) -> str:
        """The path as one dotted name."""
        return ".".join(self.path)

    @property
    def bytes(self) -> int:
        """Size of one element [bytes]."""
        return self.dtype.itemsize * prod(self.shape)

    def of(self, record: Any) -> Any:
        """Return the value at the path of this field, in a record array or in nested dictionaries."""
        for name in self.path:
            record = record[name]
        return record


@cache
def array_fields() -> tuple[ArrayField, ...]:
    """Return the fields of all arrays in `SceneRecord` and its nested structs, in order of declaration."""
    return tuple(_fields_of(SceneRecord, ()))


def _fields_of(struct: Any, path: tuple[str, ...]) -> Iterator[ArrayField]:
    for name, variable in struct.vars.items():
        if isinstance(variable.type, wp.array):
            element = wp.empty(0, dtype=variable.type.dtype, device="cpu").numpy()
            yield ArrayField((*path, name), element.dtype, element.shape[1:])
        elif hasattr(variable.type, "vars"):
            yield from _fields_of(variable.type, (*path, name))


class BlockLayout(NamedTuple):
    """Lengths and offsets of the arrays in the memory blocks of scenes."""

    length: IndexArray
    """Number of elements of each array, shape (fields, scenes)."""
    offset: IndexArray
    """Offset of each array in its block [bytes], shape (fields, scenes)."""
    size: IndexArray
    """Size of each block [bytes], shape (scenes,)."""

    @classmethod
    def of(cls, size: Sizes) -> BlockLayout:
        """Return the layout for scenes with these sizes."""
        table, fields = lengths(size), array_fields()
        length = np.stack([np.broadcast_to(field.of(table), size.grains.shape) for field in fields])
        item = np.array([field.bytes for field in fields])[:, None]
        end = np.cumsum(-(-length * item // ALIGNMENT) * ALIGNMENT, axis=0)
        return cls(length, np.concatenate([np.zeros_like(end[:1]), end[:-1]]), end[-1])


@cache
def record_dtype() -> np.dtype[Any]:
    """Return the NumPy type of `SceneRecord`, cached because Warp takes milliseconds to derive it."""
    return np.dtype(SceneRecord.numpy_dtype())


def records_in(array: wp.array) -> np.ndarray[Any, Any]:
    """Return an array of `SceneRecord` on the host as a NumPy array, which shares and keeps its memory."""
    of_bytes = {"data": (array.ptr, False), "shape": array.shape, "typestr": f"|V{record_dtype().itemsize}"}
    memory = SimpleNamespace(__array_interface__={**of_bytes, "version": 3}, owner=array)
    return np.asarray(memory).view(record_dtype())


def bytes_needed(size: Sizes) -> IndexArray:
    """Return the memory that each scene needs [bytes], shape (scenes,)."""
    return BlockLayout.of(size).size + record_dtype().itemsize


def copied_memory(length: int, dtype: Any, device: wp.Device) -> tuple[wp.array, wp.array]:
    """Return two zeroed arrays of `length` elements: on the host, pinned for fast copies, and on the GPU."""
    return tuple(wp.zeros(length, dtype, where, pinned=where == "cpu") for where in ("cpu", device))


class Block(NamedTuple):
    """The host memory of all arrays of one scene: the arrays themselves on a CPU, a copy of them for a GPU.

    On the host, blocks do not share cache lines, because two threads that write to one line slow each other.
    """

    host: NDArray[np.uint8]
    pointer: int
    """Address of the block on the device."""
    copies: tuple[wp.array, ...]
    """The allocations on the host and on the GPU that contain the block; empty on a CPU."""

    @classmethod
    def several(cls, sizes: IndexArray, device: wp.Device) -> list[Block]:
        """Return zeroed blocks of these sizes [bytes], in one allocation."""
        whole = (sizes // LINE + 1) * LINE
        total = int(whole.sum()) + LINE
        copies: tuple[wp.array, ...] = ()
        if device.is_cpu:
            host = np.zeros(total, np.uint8)
            begin = host.ctypes.data
        else:
            copies = copied_memory(total, wp.uint8, device)
            host, begin = copies[0].numpy(), copies[1].ptr
        first = np.cumsum(whole) - whole - begin % LINE + LINE
        places = zip(first.tolist(), sizes.tolist(), strict=True)
        return [cls(host[start : start + size], begin + start, copies) for start, size in places]
