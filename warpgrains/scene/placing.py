"""Discs at random places between the walls: random sequential addition, by kernels/placing.py."""

from __future__ import annotations

from functools import cache
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.console import start_warp
from warpgrains.turns import BUILDING

if TYPE_CHECKING:
    from warpgrains.scene.region import Region

MOST_TRIES = 1_000_000  # in a row, of one disc: then hardly a place is left
FIRST_TRIES = 8  # for each disc, then twice as many, ...
MOST_AT_ONCE = 1 << 18  # tries between which an interrupt is heard


def place_at_random(region: Region, radius: FloatArray, generator: np.random.Generator) -> FloatArray:
    """Give discs places at random: the largest first, each the first place where it overlaps none before.

    Parameters
    ----------
    region
        Where they are to be, wholly.
    radius
        Radii [m], shape (n,), all > 0.
    generator
        Draws the places; the same ones for the same state of it.

    Returns
    -------
    ndarray
        Positions [m], shape (n, 2); NaN for those that were left when one had found no place in a million.
    """
    order = np.argsort(-radius, kind="stable")
    discs = _Discs(region, radius[order])
    low, high = region.box
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    tries = FIRST_TRIES * len(radius)
    while discs.placed < len(radius) and discs.tries < MOST_TRIES:
        tries = min(tries, MOST_AT_ONCE)
        discs.try_places(middle + half * (2.0 * generator.random((tries, 2)) - 1.0))
        tries *= 2
    placed = np.empty_like(discs.position)
    placed[order] = discs.position
    return placed


class _Discs:
    """Discs of descending radii: a record of arrays for the kernel."""

    def __init__(self, region: Region, radius: FloatArray) -> None:
        self._arrays: dict[str, np.ndarray[Any, Any]] = {}
        self._record = np.zeros(1, _record_dtype())
        walls = region.ring
        annulus = self._record["walls"]["annulus"]
        annulus["radius_in"], annulus["radius_out"] = walls[:2]
        self._record["box"]["low"], self._record["box"]["high"] = region.low, region.high
        _, start, count = np.unique(-np.frexp(radius)[1], return_index=True, return_counts=True)
        cell = np.maximum(2.0 * radius[start], walls.radius_out / np.ceil(np.sqrt(count)))
        width = (2.0 * (walls.radius_out / cell)).astype(np.int32) + 1
        cells = width * width
        self.position = np.full((len(radius), 2), np.nan)
        self._set("position", self.position)
        self._set("radius", radius)
        self._set("level", np.repeat(np.arange(len(start), dtype=np.int32), count))
        self._set("follower", np.empty(len(radius), np.int32))
        self._set("newest", np.full(cells.sum(), -1, np.int32))
        self._set("cell", cell)
        self._set("width", width)
        self._set("first", (np.cumsum(cells) - cells).astype(np.int32))

    @property
    def placed(self) -> int:
        """How many have a place."""
        return int(self._record["placed"][0])

    @property
    def tries(self) -> int:
        """How many places the next one has tried in vain."""
        return int(self._record["tries"][0])

    def try_places(self, places: FloatArray) -> None:
        """Try places [m], shape (m, 2), one after the other."""
        import warp as wp

        self._set("places", places)
        record = wp.array(ptr=self._record.ctypes.data, shape=1, dtype=_kernels().DiscsRecord, device="cpu")
        launch(_kernels().place, [record])

    def _set(self, name: str, array: np.ndarray[Any, Any]) -> None:
        """Let the kernel see an array: arrays of Warp's own, eight a scene, take longer than all the rest."""
        self._arrays[name] = array
        field = self._record[name]
        field["data"], field["ndim"] = array.ctypes.data, 1
        field["shape"][:, 0], field["strides"][:, 0] = len(array), array.strides[0]


def limits(region: Region) -> tuple[Any, Any]:
    """Return walls and box of a region, for kernels."""
    from warpgrains.kernels.annulus import Annulus

    walls, box = Annulus(), _kernels().Box()
    walls.radius_in, walls.radius_out = region.ring.radius_in, region.ring.radius_out
    box.low, box.high = region.low, region.high
    return walls, box


def shared(array: np.ndarray[Any, Any], dtype: Any) -> Any:
    """Return an array for kernels, in the memory of NumPy's."""
    import warp as wp

    return wp.array(array, dtype=dtype, device="cpu", copy=False)


def launch(kernel: Any, inputs: list[Any]) -> None:
    """Launch one thread of a kernel on the CPU; other Python threads may launch it at the same time."""
    import warp as wp

    with BUILDING:
        kernel.module.load(wp.get_device("cpu"), 1)
    wp.launch(kernel, dim=1, inputs=inputs, device="cpu")


def _kernels() -> ModuleType:
    """Start Warp only where something is placed at random."""
    with BUILDING:
        start_warp()
        from warpgrains.kernels import placing

        return placing


@cache
def _record_dtype() -> np.dtype[Any]:
    return np.dtype(_kernels().DiscsRecord.numpy_dtype())
