"""Memory layout of scenes: every scene has one block of memory for all arrays of its record."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from math import prod
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpgrains.arrays import IndexArray
from warpgrains.kernels.record import SceneRecord
from warpgrains.solver.sizes import Sizes, lengths

ALIGNMENT = 16  # bytes
LINE = 128  # bytes: two cache lines, which cores transfer together


class ArrayField(NamedTuple):
    """An array of the record."""

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
        """Size of one element."""
        return self.dtype.itemsize * prod(self.shape)

    def of(self, record: Any) -> Any:
        """Return the value at the field's path in records or in nested dictionaries."""
        for name in self.path:
            record = record[name]
        return record


@cache
def array_fields() -> tuple[ArrayField, ...]:
    """Return all array fields of the record."""
    return tuple(_fields_of(SceneRecord, ()))


def _fields_of(struct: Any, path: tuple[str, ...]) -> Iterator[ArrayField]:
    for name, variable in struct.vars.items():
        if isinstance(variable.type, wp.array):
            element = wp.empty(0, dtype=variable.type.dtype, device="cpu").numpy()
            yield ArrayField((*path, name), element.dtype, element.shape[1:])
        elif hasattr(variable.type, "vars"):
            yield from _fields_of(variable.type, (*path, name))


class BlockLayout(NamedTuple):
    """Where the arrays are in the memory blocks of scenes."""

    length: IndexArray
    """Elements of the array, shape (fields, scenes)."""
    offset: IndexArray
    """Bytes before it, shape (fields, scenes)."""
    size: IndexArray
    """Bytes of a block, shape (scenes,)."""

    @classmethod
    def of(cls, size: Sizes) -> BlockLayout:
        """Return the layout for scenes of some sizes."""
        table, fields = lengths(size), array_fields()
        length = np.stack([np.broadcast_to(field.of(table), size.grains.shape) for field in fields])
        item = np.array([field.bytes for field in fields])[:, None]
        end = np.cumsum(-(-length * item // ALIGNMENT) * ALIGNMENT, axis=0)
        return cls(length, np.concatenate([np.zeros_like(end[:1]), end[:-1]]), end[-1])


def bytes_needed(size: Sizes) -> IndexArray:
    """Return the memory of each scene [bytes], shape (scenes,)."""
    return BlockLayout.of(size).size + SceneRecord.numpy_dtype()["itemsize"]


class Block:
    """The memory of all arrays of one scene: on a CPU the arrays themselves, else a host copy of them.

    `pointer` is the address on the device. On the host, blocks are in separate cache lines, because a line
    that two threads write to slows both down.
    """

    def __init__(self, host: NDArray[np.uint8], pointer: int, device: wp.Device):
        self.host, self.pointer = host, pointer
        self._device = None
        if device.is_cuda:
            self._device = wp.array(host, dtype=wp.uint8, device=device)
            self.pointer = self._device.ptr

    @classmethod
    def several(cls, sizes: IndexArray, device: wp.Device) -> list[Block]:
        """Return zeroed blocks of these sizes [bytes]. On the host they are in one allocation."""
        whole = (sizes // LINE + 1) * LINE
        memory = np.zeros(int(whole.sum()) + LINE, np.uint8)
        begin = memory.ctypes.data
        first = np.cumsum(whole) - whole - begin % LINE + LINE
        places = zip(first.tolist(), sizes.tolist(), strict=True)
        return [cls(memory[start : start + size], begin + start, device) for start, size in places]

    def pull(self) -> None:
        """Copy the block from the device to the host."""
        if self._device is not None:
            self.host[:] = self._device.numpy()

    def push(self) -> None:
        """Copy the block from the host to the device."""
        if self._device is not None:
            self._device.assign(self.host)
