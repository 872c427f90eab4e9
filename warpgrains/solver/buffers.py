"""Memory layout of scenes: every scene has one block of memory for all arrays of its record."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpgrains.kernels.record import SceneRecord
from warpgrains.solver.sizes import Counts, Sizes, lengths

ALIGNMENT = 16  # bytes
LINE = 128  # bytes: two cache lines, which cores transfer together


@dataclass(frozen=True)
class Field:
    """An array of the record.

    Attributes
    ----------
    path : tuple of str
        Names of the enclosing structs and of the array.
    dtype, shape : np.dtype, tuple of int
        Type and shape of one element for NumPy.
    """

    path: tuple[str, ...]
    dtype: np.dtype
    shape: tuple[int, ...]

    @property
    def name(self) -> str:
        """The path as one dotted name."""
        return ".".join(self.path)

    @property
    def bytes(self) -> int:
        """Size of one element."""
        return self.dtype.itemsize * int(np.prod(self.shape, dtype=np.int64))

    def of(self, record: Any) -> Any:
        """Return the value at the field's path in records or in nested dictionaries."""
        for name in self.path:
            record = record[name]
        return record


@cache
def fields() -> tuple[Field, ...]:
    """Return all array fields of the record."""
    return tuple(_fields_of(SceneRecord, ()))


def _fields_of(struct: Any, path: tuple[str, ...]) -> Iterator[Field]:
    for name, variable in struct.vars.items():
        if isinstance(variable.type, wp.array):
            element = wp.empty(0, dtype=variable.type.dtype, device="cpu").numpy()
            yield Field((*path, name), element.dtype, element.shape[1:])
        elif hasattr(variable.type, "vars"):
            yield from _fields_of(variable.type, (*path, name))


@dataclass(frozen=True)
class Layout:
    """Lengths and offsets of the arrays in the memory blocks of scenes.

    Attributes
    ----------
    length, offset : ndarray
        Elements of the array, and bytes before it, shape (fields, scenes).
    size : ndarray
        Bytes of a block, shape (scenes,).
    """

    length: Counts
    offset: Counts
    size: Counts

    @classmethod
    def of(cls, size: Sizes) -> Layout:
        """Return the layout for scenes of some sizes."""
        table = lengths(size)
        length = np.stack([np.broadcast_to(field.of(table), size.grains.shape) for field in fields()])
        item = np.array([field.bytes for field in fields()])[:, None]
        end = np.cumsum(-(-length * item // ALIGNMENT) * ALIGNMENT, axis=0)
        offset = np.concatenate([np.zeros_like(end[:1]), end[:-1]])
        return cls(length, offset, end[-1])


def bytes_needed(size: Sizes) -> Counts:
    """Return the memory of each scene [bytes], shape (scenes,)."""
    return Layout.of(size).size + SceneRecord.numpy_dtype()["itemsize"]


class Block:
    """The memory of all arrays of one scene: on a CPU the arrays themselves, else a host copy of them.

    Parameters
    ----------
    host : ndarray
        Bytes in separate cache lines, because a line that two threads write to slows both down.
    pointer : int
        Address on the host.
    device : wp.Device

    Attributes
    ----------
    host : ndarray
    pointer : int
        Address on the device.
    """

    def __init__(self, host: NDArray[np.uint8], pointer: int, device: wp.Device):
        self.host, self.pointer = host, pointer
        self._device = None
        if device.is_cuda:
            self._device = wp.array(host, dtype=wp.uint8, device=device)
            self.pointer = self._device.ptr

    @classmethod
    def several(cls, sizes: Counts, device: wp.Device) -> list[Block]:
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
