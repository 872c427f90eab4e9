"""Discs at random places between the walls: random sequential addition, by kernels/placing.py."""

from __future__ import annotations

from functools import cache
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.console import start_warp

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
    discs, position = _discs(region, radius[order])
    low, high = region.box
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    progress, tries = np.zeros(2, np.int32), FIRST_TRIES * len(radius)
    while progress[0] < len(radius) and progress[1] < MOST_TRIES:
        tries = min(tries, MOST_AT_ONCE)
        _try(discs, middle + half * (2.0 * generator.random((tries, 2)) - 1.0), progress)
        tries *= 2
    placed = np.empty_like(position)
    placed[order] = position
    return placed


def _discs(region: Region, radius: FloatArray) -> tuple[Any, FloatArray]:
    """Return discs of descending radii for the kernel, and where it writes their positions."""
    import warp as wp

    walls = region.ring
    _, start, count = np.unique(-np.frexp(radius)[1], return_index=True, return_counts=True)
    cell = np.maximum(2.0 * radius[start], walls.radius_out / np.ceil(np.sqrt(count)))
    width = (2.0 * (walls.radius_out / cell)).astype(np.int32) + 1
    cells = width * width
    position = np.full((len(radius), 2), np.nan)
    arrays = {
        "radius": radius,
        "level": np.repeat(np.arange(len(start), dtype=np.int32), count),
        "follower": np.empty(len(radius), np.int32),
        "newest": np.full(cells.sum(), -1, np.int32),
        "cell": cell,
        "width": width,
        "first": (np.cumsum(cells) - cells).astype(np.int32),
    }
    discs = _kernels().DiscsRecord()
    discs.walls, discs.box = limits(region)
    discs.position = shared(position, wp.vec2d)
    for name, array in arrays.items():
        setattr(discs, name, shared(array, wp.dtype_from_numpy(array.dtype)))
    return discs, position


def limits(region: Region) -> tuple[Any, Any]:
    """Return walls and box of a region, for kernels."""
    from warpgrains.kernels.walls import Walls

    walls, box = Walls(), _kernels().Box()
    walls.radius_in, walls.radius_out = region.ring.radius_in, region.ring.radius_out
    box.low, box.high = region.low, region.high
    return walls, box


def _try(discs: Any, places: FloatArray, progress: np.ndarray[Any, Any]) -> None:
    """Let discs try places [m], shape (m, 2), one after the other."""
    import warp as wp

    inputs = [discs, shared(places, wp.vec2d), shared(progress, wp.int32)]
    wp.launch(_kernels().place, dim=1, inputs=inputs, device="cpu")


def shared(array: np.ndarray[Any, Any], dtype: Any) -> Any:
    """Return an array for kernels, in the memory of NumPy's."""
    import warp as wp

    return wp.array(array, dtype=dtype, device="cpu", copy=False)


@cache
def _kernels() -> ModuleType:
    """Start Warp only where something is placed at random."""
    start_warp()
    from warpgrains.kernels import placing

    return placing
