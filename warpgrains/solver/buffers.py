"""The memory of scenes: one table of how long every array is, and the records that point to them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpgrains.kernels.accelerated import CHUNK
from warpgrains.kernels.record import SceneRecord
from warpgrains.kernels.threads import GPU_PARTIALS

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

Counts = NDArray[np.int64]
ALIGNMENT = 16  # bytes
LINE = 128  # bytes that cores pass on together
FEW = 40  # grains that are not worth a grid
BINS = 4096  # of the coordinate that is cut into strips


@dataclass(frozen=True)
class Sizes:
    """What the lengths of a scene's arrays follow from; every entry has shape (scenes,), or is one for all.

    Attributes
    ----------
    grains, pairs : ndarray
        Grains, and candidate pairs that there is room for.
    weighted : ndarray
        1 where masses differ, 0 elsewhere.
    accelerated : int
        1 where the sweeps are accelerated, 0 elsewhere.
    team : int
        CPU threads that share a scene.
    partials : int
        Parts in which threads keep a maximum or a sum.
    history : int
        Iterations of a step whose zeta and residual are kept.
    """

    grains: Counts
    pairs: Counts
    weighted: Counts
    accelerated: int
    team: int
    partials: int
    history: int = 0

    @classmethod
    def first(cls, scenes: Sequence[Scene], team: int, device: wp.Device) -> Sizes:
        """Return the sizes that scenes of one method have at first."""
        n = np.array([scene.n for scene in scenes])
        partials = team if device.is_cpu else GPU_PARTIALS
        weighted = np.array([not scene.has_equal_masses for scene in scenes], np.int64)
        return cls(n, first_pairs(n), weighted, int(scenes[0].method != "gauss-seidel"), team, partials)

    @property
    def has_strips(self) -> bool:
        """Whether threads have strips of their own."""
        return self.team > 1 and not self.accelerated

    def of(self, k: int) -> Sizes:
        """Return the sizes of scene k alone."""
        one = slice(k, k + 1)
        return replace(self, grains=self.grains[one], pairs=self.pairs[one], weighted=self.weighted[one])


def first_pairs(n: Counts) -> Counts:
    """Return for how many pairs there is room at first: more than a list mostly needs, at most all."""
    return np.maximum(1, np.minimum(n * (n - 1) // 2, 5 * n))


def lengths(size: Sizes) -> dict[str, Any]:
    """Return the length of every array of a record, by struct and name: the one table of them."""
    n, pairs = size.grains, size.pairs
    cells = grid_width(n) ** 2 + 1
    rows = {"start": n + 1, "cursor": n + 1, "neighbor": pairs, "found": pairs, "total": 1}
    ahead, strips = size.accelerated, size.team * size.has_strips
    has_strips = int(size.has_strips)
    return {
        "grains": {
            **dict.fromkeys(("position", "velocity", "free_velocity", "next_velocity"), n),
            **dict.fromkeys(("rebuilt_velocity", "last_position", "last_velocity", "radius", "mass"), n),
        },
        "contacts": {
            **dict.fromkeys(("pairs", "pair_dv", "pair_dv_start"), pairs),
            "weights": pairs * size.weighted,
            "set_start": pairs + 2,
            **dict.fromkeys(("walls", "wall_dv_start"), n),
        },
        "verlet": {
            **dict.fromkeys(("peak_deviation", "peak_limit", "recent_deviation", "skin"), n),
            **dict.fromkeys(("reference_position", "reference_velocity"), n),
        },
        "momentum": {
            "pair_last": ahead * pairs,
            "pair_part": ahead * (pairs + pairs // CHUNK + 1),
            **dict.fromkeys(("wall_last", "wall_part", "last_velocity", "grain_part"), ahead * n),
        },
        "grid": {
            **dict.fromkeys(("cell_start", "cell_cursor"), cells),
            **dict.fromkeys(("grain", "position", "velocity", "skin", "extent"), n),
        },
        "neighbors": rows,
        "workspace": {
            "old": rows | {"cursor": 0, "found": 0, "total": 0},
            **dict.fromkeys(("old_pair_dv", "color", "old_color", "sweep_index", "sequence"), pairs),
            "group": pairs + 1,
            **dict.fromkeys(("old_wall_dv", "was_at_wall", "row_sum", "next_level", "used_colors"), n),
        },
        "strips": {
            "bins": BINS * has_strips,
            **dict.fromkeys(("strip", "last"), n * has_strips),
            **dict.fromkeys(("cursor", "late_cursor"), strips),
            "seen": strips**2,
            "segment": pairs * has_strips,
            **dict.fromkeys(("first_segment", "first_wall"), strips + 1),
            "dependencies": (pairs + 1) * strips,
        },
        "partial": dict.fromkeys(("zeta", "residual", "overlap", "active"), size.partials),
        "history": dict.fromkeys(("zeta", "residual"), size.history),
    }


def grid_width(n: Any) -> Any:
    """Return how many cells a side the grid for n grains has; few grains are all looked at."""
    return np.where(n <= FEW, 1, 1 << np.ceil(np.log2(n) / 2).astype(np.int64))


@dataclass(frozen=True)
class Field:
    """An array of the record.

    Attributes
    ----------
    path : tuple of str
        Names of the structs that it is in, and its own.
    dtype, shape : np.dtype, tuple of int
        Of one element, as NumPy sees it.
    """

    path: tuple[str, ...]
    dtype: np.dtype
    shape: tuple[int, ...]

    @property
    def name(self) -> str:
        """The path in one word."""
        return ".".join(self.path)

    @property
    def bytes(self) -> int:
        """Size of one element."""
        return self.dtype.itemsize * int(np.prod(self.shape, dtype=np.int64))

    def of(self, record: Any) -> Any:
        """Return what stands in the field's place in records, or in nested dictionaries."""
        for name in self.path:
            record = record[name]
        return record


@cache
def fields() -> tuple[Field, ...]:
    """Return all arrays of the record."""
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
    """Where arrays of scenes lie in the scenes' blocks of memory.

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
        """Lay out scenes of some sizes."""
        table = lengths(size)
        length = np.stack([np.broadcast_to(field.of(table), size.grains.shape) for field in fields()])
        item = np.array([field.bytes for field in fields()])[:, None]
        end = np.cumsum(-(-length * item // ALIGNMENT) * ALIGNMENT, axis=0)
        offset = np.concatenate([np.zeros_like(end[:1]), end[:-1]])
        return cls(length, offset, end[-1])


def bytes_needed(size: Sizes) -> Counts:
    """Return what scenes take in memory [bytes], shape (scenes,)."""
    return Layout.of(size).size + SceneRecord.numpy_dtype()["itemsize"]


class Block:
    """The memory of all arrays of one scene: on a CPU the arrays themselves, else a copy for the host.

    Parameters
    ----------
    host : ndarray
        Bytes, in lines of their own: a line that two threads write to is slow for both.
    pointer : int
        Where the host has them.
    device : wp.Device

    Attributes
    ----------
    host : ndarray
    pointer : int
        Where the device has them.
    """

    def __init__(self, host: NDArray[np.uint8], pointer: int, device: wp.Device):
        self.host, self.pointer = host, pointer
        self._device = None
        if device.is_cuda:
            self._device = wp.array(host, dtype=wp.uint8, device=device)
            self.pointer = self._device.ptr

    @classmethod
    def several(cls, sizes: Counts, device: wp.Device) -> list[Block]:
        """Return blocks of these sizes [bytes], all zero, which the host has in one piece of memory."""
        whole = (sizes // LINE + 1) * LINE
        memory = np.zeros(int(whole.sum()) + LINE, np.uint8)
        begin = memory.ctypes.data
        first = np.cumsum(whole) - whole - begin % LINE + LINE
        places = zip(first.tolist(), sizes.tolist(), strict=True)
        return [cls(memory[start : start + size], begin + start, device) for start, size in places]

    def pull(self) -> None:
        """Let the host see what the device has written."""
        if self._device is not None:
            self.host[:] = self._device.numpy()

    def push(self) -> None:
        """Let the device see what the host has written."""
        if self._device is not None:
            self._device.assign(self.host)
