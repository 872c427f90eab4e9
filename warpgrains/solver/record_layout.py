"""How long the arrays of a scene's record are, and where they lie: a batch holds thousands of scenes."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpgrains.kernels.momentum import CHUNK
from warpgrains.kernels.record import SceneRecord
from warpgrains.kernels.variant import Variant

Counts = NDArray[np.int64]
ALIGNMENT = 16  # bytes


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
        if hasattr(variable.type, "vars") and not isinstance(variable.type, wp.array):
            yield from _fields_of(variable.type, (*path, name))
        elif isinstance(variable.type, wp.array):
            element = wp.empty(0, dtype=variable.type.dtype, device="cpu").numpy()
            yield Field((*path, name), element.dtype, element.shape[1:])


def lengths(n: Counts, pairs: Counts, variant: Variant) -> Counts:
    """Return the length of every array, shape (fields, scenes), for n grains and room for so many pairs."""
    table = _lengths_by_name(n, pairs, variant)
    return np.stack([np.broadcast_to(field.of(table), n.shape) for field in fields()])


def _lengths_by_name(n: Counts, pairs: Counts, variant: Variant) -> dict[str, Any]:
    cells = grid_width(n) ** 2 + 1
    rows = {"start": n + 1, "cursor": n + 1, "neighbor": pairs, "found": pairs, "total": 1}
    ahead = int(variant.accelerated)
    return {
        "grains": {
            **dict.fromkeys(("position", "velocity", "free_velocity", "next_velocity"), n),
            **dict.fromkeys(("rebuilt_velocity", "last_position"), n),
            "radius": n if variant.distinct_radii else 1,
            "mass": n if variant.distinct_masses else 1,
        },
        "contacts": {
            "pairs": pairs,
            "pair_dv": pairs,
            "weights": pairs * int(variant.distinct_masses),
            "pair_dv_start": pairs,
            "group_start": pairs + 2,
            **dict.fromkeys(("lane_turn", "turn_after", "lane_wall"), 0),
            "walls": n,
            "wall_dv_start": n,
            "count": 3,
        },
        "watch": {
            **dict.fromkeys(("peak", "limit", "recent", "reach", "built_position", "built_velocity"), n),
            "frame": 3,
            "scalar": 8,
            "flag": 4,
        },
        "progress": {
            **dict.fromkeys(("iterating", "checking", "accepted", "zeta", "residual"), 1),
            **dict.fromkeys(("overlap", "carrying"), 1),
            "report": 6,
        },
        "momentum": {
            "pair_last": ahead * pairs,
            "pair_part": ahead * (pairs + pairs // CHUNK + 1),
            **dict.fromkeys(("wall_last", "wall_part", "last_velocity", "grain_part"), ahead * n),
            "scalar": 3,
            "undo": 1,
        },
        "grid": {"cell_start": cells, "cell_cursor": cells, "cell_grain": n, "extent": n},
        "rows": rows,
        "workspace": {
            "old_rows": rows | {"cursor": 0, "found": 0, "total": 0},
            **dict.fromkeys(("old_pair_dv", "slot", "sequence"), pairs),
            "group": pairs + 1,
            **dict.fromkeys(("wall_dv", "influence", "next_level", "used_colors"), n),
            "lost": 1,
        },
        "flag": 4,
        "tally": 8,
    }


def grid_width(n: Any) -> Any:
    """Return how many cells a side the grid for n grains has."""
    return 1 << np.ceil(np.log2(n) / 2).astype(np.int64)


def first_room(n: Counts) -> Counts:
    """Return for how many pairs there is room at first: more than a list mostly needs, at most all."""
    return np.maximum(1, np.minimum(n * (n - 1) // 2, 5 * n))


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
    def of(cls, n: Counts, pairs: Counts, variant: Variant) -> "Layout":
        """Lay out scenes with n grains and room for so many pairs, shape (scenes,)."""
        length = lengths(n, pairs, variant)
        item = np.array([field.bytes for field in fields()])[:, None]
        end = np.cumsum(-(-length * item // ALIGNMENT) * ALIGNMENT, axis=0)
        offset = np.concatenate([np.zeros_like(end[:1]), end[:-1]])
        return cls(length, offset, end[-1])


def record_bytes(n: Counts, variant: Variant) -> Counts:
    """Return what scenes of n grains take in memory at first [bytes]."""
    return Layout.of(n, first_room(n), variant).size + SceneRecord.numpy_dtype()["itemsize"]
