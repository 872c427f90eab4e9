"""Random positions of discs between the walls, by the kernels of kernels/packings.

Loose packings are made by random sequential addition. For dense ones, discs are added while small, then
grown, and pushed apart while they overlap. They grow to slightly more than their final radii, and the
remaining overlaps are smaller than this margin, so that the final discs do not overlap. The largest
possible packing fraction is not known in advance: if pushing does not converge, the discs are
declared not to fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from warpgrains.base.arrays import FloatArray
from warpgrains.base.turns import BUILDING
from warpgrains.space.geometry import distance, overlapping_pairs
from warpgrains.walls.bodies import image_ways
from warpgrains.walls.wall import SHAPE, Wall

if TYPE_CHECKING:
    from warpgrains.space.region import Region
from warpgrains.base.warp_start import start_warp

MOST_TRIES = 1_000_000  # for one disc; after that hardly any free space is left
FIRST_TRIES = 8  # per disc in the first batch; the next batches double
MOST_AT_ONCE = 1 << 18  # tries per launch; Ctrl-C is handled between two launches

INITIAL_FRACTION = 0.35  # packing fraction before the discs grow
STAGES = 24  # number of growth stages
MARGIN = 2e-4  # relative excess of the radii at the end of growth
WHILE_GROWING, HOPELESS = 0.02, 0.15  # overlaps [radii]: growth goes on below the 1st, fails above the 2nd
SKIN = 0.2  # largest gap of listed pairs, in radii
SWEEPS, LAST_SWEEPS = 400, 40_000  # largest numbers of sweeps, in a stage and at the end
AT_ONCE = 20  # sweeps between two tests of the displacements


def place_at_random(
    region: Region,
    radius: FloatArray,
    generator: np.random.Generator,
    walls: Sequence[Wall] = (),
    most_tries: int = MOST_TRIES,
) -> FloatArray:
    """Place discs in a region by random sequential addition, the largest first, without overlaps.

    Return positions [m], shape (n, 2). If `most_tries` tries for a disc fail, its position is NaN, and so are
    those of all smaller discs.
    """
    order = np.argsort(-radius, kind="stable")
    discs = _Discs(region, radius[order], walls)
    low, high = region.box
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    tries = FIRST_TRIES * len(radius)
    most = most_tries if region.is_box else most_tries * region.area / float((high - low).prod())
    while discs.placed < len(radius) and discs.tries < most:
        tries = min(tries, MOST_AT_ONCE)
        places = middle + half * (2.0 * generator.random((tries, 2)) - 1.0)
        discs.try_positions(places if region.is_box else places[region.contains(places)])
        tries *= 2
    placed = np.empty_like(discs.position)
    placed[order] = discs.position
    return placed


class _Discs:
    """Discs in descending order of radius, as a record of arrays that the kernel reads."""

    def __init__(self, region: Region, radius: FloatArray, walls: Sequence[Wall]) -> None:
        self._arrays: dict[str, np.ndarray[Any, Any]] = {}
        self._record = np.zeros(1, _record_dtype())
        limits = self._record["walls"]
        limits["annulus"]["radius_in"], limits["annulus"]["radius_out"] = region.ring
        limits["period"] = region.period.lengths
        self._record["bounds"]["low"], self._record["bounds"]["high"] = _box(region)
        self._set("shape", _shapes(walls), limits)
        self._set("image", image_ways(walls, region.period), limits)
        _, start, count = np.unique(-np.frexp(radius)[1], return_index=True, return_counts=True)
        period = region.period
        low, high = np.where(period.repeats, (period.low, period.low + period.lengths), region.box)
        roomy = 0.5 * np.sqrt((high - low).prod()) / np.ceil(np.sqrt(count))
        least = np.maximum(2.0 * radius[start], roomy)
        width = np.maximum(((high - low) / least[:, np.newaxis]).astype(np.int32), 1)
        cell, cells = (high - low) / width, width.prod(axis=1, dtype=np.int32)
        self._record["corner"] = low
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
        """Number of discs that have a position."""
        return int(self._record["placed"][0])

    @property
    def tries(self) -> int:
        """Number of failed tries for the next disc."""
        return int(self._record["tries"][0])

    def try_positions(self, positions: FloatArray) -> None:
        """Try positions [m], shape (m, 2), in order, each for the next disc without a position."""
        import warp as wp

        from warpgrains.base.host_kernels import launch

        self._set("places", positions)
        record = wp.array(ptr=self._record.ctypes.data, shape=1, dtype=_kernels().DiscsRecord, device="cpu")
        launch(_kernels().place, [record])

    def _set(self, name: str, array: np.ndarray[Any, Any], record: Any = None) -> None:
        """Store the address of an array in field `name` of `record`, by default of the record of all discs.

        Making Warp arrays instead would take longer than placing the discs.
        """
        self._arrays[name] = array
        field = (self._record if record is None else record)[name]
        field["data"], field["ndim"] = array.ctypes.data, 1
        field["shape"][:, 0], field["strides"][:, 0] = len(array), array.strides[0]


def grow(
    region: Region, radius: FloatArray, generator: np.random.Generator, walls: Sequence[Wall] = ()
) -> tuple[FloatArray, float]:
    """Place discs densely, and return their positions [m], shape (n, 2), and a factor <= 1.

    If the radii are multiplied by this factor, no discs overlap.
    """
    filled = float(np.pi * (radius**2).sum()) / region.area
    start = min(1.0, float(np.sqrt(INITIAL_FRACTION / filled)))
    position = place_at_random(region, start * radius, generator, walls)
    while np.isnan(position).any():  # until the few large discs are placed too
        start *= 0.7
        position = place_at_random(region, start * radius, generator, walls)
    reached = start
    for share in np.linspace(start, 1.0, STAGES + 1)[1:].tolist():
        grown = position.copy()
        if _push(region, walls, grown, share * (1.0 + MARGIN) * radius, WHILE_GROWING, SWEEPS) > HOPELESS:
            break
        position, reached = grown, share
    _push(region, walls, position, reached * (1.0 + MARGIN) * radius, 0.5 * MARGIN, LAST_SWEEPS)
    share = min(1.0, _clear_share(region, walls, position, radius))
    return region.period.wrapped(position), share


def _clear_share(region: Region, walls: Sequence[Wall], position: FloatArray, radius: FloatArray) -> float:
    """Return the largest factor for the radii with which no disc overlaps another disc, a wall or the border.

    It is 0 if a center is outside of the region.
    """
    if not (region.is_box or region.contains(position).all()):
        return 0.0
    i, j = _near(region, position, radius).T
    (near, far), rho = region.ring, distance(position)
    to_border = [far - rho, *([rho - near] if near else [])]
    for wall in walls:
        to_border.append(wall.side(wall.places(position, region.period), radius).gap + radius)
    low, high = _box(region)
    to_border += [position - low, high - position]
    shares = [(one.T / radius).min() for one in to_border]
    apart = distance(region.period.nearest(position[j] - position[i]))
    shares.append((apart / (radius[i] + radius[j])).min(initial=np.inf))
    return max(0.0, float(min(shares)))


def _push(
    region: Region,
    walls: Sequence[Wall],
    position: FloatArray,
    radius: FloatArray,
    enough: float,
    sweeps: int,
) -> float:
    """Push overlapping discs apart in place, until no overlap exceeds `enough` or `sweeps` sweeps are done.

    Return the largest overlap. It and `enough` are relative to the radii.
    """
    import warp as wp

    with BUILDING:
        from warpgrains.base.host_kernels import launch, shared
        from warpgrains.kernels.packings import pushing

    limits, bounds = _limits(region, walls)
    worst = np.array([np.inf, 0.0])
    centers, radii = shared(position, wp.vec2d), shared(radius)
    result = shared(worst)
    far, listed, pair = SKIN * radius.min(), np.full_like(position, np.inf), np.empty((0, 2), np.int32)
    while sweeps > 0 and (worst[0] > enough or distance(position - listed).max() > far):
        if distance(position - listed).max() > far:
            listed, pair = position.copy(), _near(region, position, (1.0 + SKIN) * radius)
        inputs: list[Any] = [centers, radii, shared(pair, wp.vec2i), limits, bounds, AT_ONCE, enough, result]
        launch(pushing.push, inputs)
        sweeps -= int(worst[1])
    return float(worst[0])


def _near(region: Region, position: FloatArray, radius: FloatArray) -> np.ndarray[Any, Any]:
    """Return the pairs of discs that overlap, in lexicographic order, shape (m, 2)."""
    n, pairs = len(radius), overlapping_pairs(position, radius, region.period)
    keys = np.concatenate([np.empty(0, np.int64), *(i * n + j for i, j in pairs)])
    keys.sort()  # faster than a sort of pairs
    return np.stack(np.divmod(keys, n), axis=1).astype(np.int32)


def _limits(region: Region, walls: Sequence[Wall]) -> tuple[Any, Any]:
    """Return walls and region as the structs `Walls` and `Bounds` of the kernels."""
    from warpgrains.base.host_kernels import shared
    from warpgrains.kernels.types import Shape, Vectors
    from warpgrains.kernels.walls.walls import Walls

    limits, bounds = Walls(), _kernels().Bounds()
    limits.annulus.radius_in, limits.annulus.radius_out = region.ring
    limits.period = region.period.lengths
    limits.shape = shared(_shapes(walls), Shape)
    limits.image = shared(image_ways(walls, region.period), Vectors.dtype)
    bounds.low, bounds.high = _box(region)
    return limits, bounds


def _box(region: Region) -> FloatArray:
    """Return the box about a region [m], shape (2, 2); infinite in directions where it spans the period."""
    low, high = region.outer_box
    is_whole = region.period.repeats & (high - low >= region.period.lengths)
    return np.where(is_whole, [[-np.inf], [np.inf]], [low, high])


def _shapes(walls: Sequence[Wall]) -> FloatArray:
    """Return the numbers of each wall for the kernels, see `Wall.shape`, shape (walls, SHAPE)."""
    return np.array([wall.shape for wall in walls]).reshape(-1, SHAPE)


def _kernels() -> ModuleType:
    """Import the kernels, and so Warp, only when discs are placed at random."""
    with BUILDING:
        start_warp()
        from warpgrains.kernels.packings import placing

        return placing


@cache
def _record_dtype() -> np.dtype[Any]:
    return np.dtype(_kernels().DiscsRecord.numpy_dtype())
