"""Dense packings: discs are placed at random while small, then grown, and pushed apart where they overlap.

In the end they are a little larger than they are to be, with overlaps that are smaller still: so none is
left. How dense a packing can be is not known beforehand: where pushing does not end, they do not fit so.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.scene.geometry import distance, overlapping_pairs
from warpgrains.scene.placing import launch, limits, place_at_random, shared
from warpgrains.turns import BUILDING

if TYPE_CHECKING:
    from warpgrains.scene.region import Region

LOOSE = 0.35  # share of the region that discs fill where they start
STAGES = 24  # in which they grow
MARGIN = 2e-4  # that they are larger in the end, in radii
WHILE_GROWING, HOPELESS = 0.02, 0.15  # overlap that may be left while growing, and that ends it, in radii
SKIN = 0.2  # how far apart pairs are still looked at, in radii
SWEEPS, LAST_SWEEPS = 400, 40_000  # of a stage, and of the last one
AT_ONCE = 20  # sweeps between two looks at how far discs have moved


def grow(region: Region, radius: FloatArray, generator: np.random.Generator) -> tuple[FloatArray, float]:
    """Return places of discs that fill a region densely [m], shape (n, 2), and how large they may be there.

    That is 1 where they fit, and else the share of their radii at which none overlaps.
    """
    filled = float(np.pi * (radius**2).sum()) / region.area
    start = min(1.0, float(np.sqrt(LOOSE / filled)))
    position = place_at_random(region, start * radius, generator)
    while np.isnan(position).any():  # a few large ones
        start *= 0.7
        position = place_at_random(region, start * radius, generator)
    reached = start
    for share in np.linspace(start, 1.0, STAGES + 1)[1:].tolist():
        grown = position.copy()
        if _push(region, grown, share * (1.0 + MARGIN) * radius, WHILE_GROWING, SWEEPS) > HOPELESS:
            break
        position, reached = grown, share
    _push(region, position, reached * (1.0 + MARGIN) * radius, 0.5 * MARGIN, LAST_SWEEPS)
    return position, min(1.0, _clear_share(region, position, radius))


def _clear_share(region: Region, position: FloatArray, radius: FloatArray) -> float:
    """Return at which share of their radii discs overlap neither each other nor what they are in."""
    i, j = _near(position, radius).T
    room = [wall.gap + radius for wall in region.ring.seen_from(position, radius)]
    room += [position - region.low, region.high - position]
    shares = [(one.T / radius).min() for one in room]
    shares.append((distance(position[j] - position[i]) / (radius[i] + radius[j])).min(initial=np.inf))
    return max(0.0, float(min(shares)))


def _push(region: Region, position: FloatArray, radius: FloatArray, enough: float, sweeps: int) -> float:
    """Push discs apart, in place, until overlaps are small enough; return the worst, in radii.

    A list of pairs lasts until some disc has moved as far as its gap to one that is not listed may be small.
    """
    import warp as wp

    with BUILDING:
        from warpgrains.kernels import pushing

    walls, box = limits(region)
    worst = np.array([np.inf, 0.0])
    places, radii, told = shared(position, wp.vec2d), shared(radius, wp.float64), shared(worst, wp.float64)
    far, listed, pair = SKIN * radius.min(), np.full_like(position, np.inf), np.empty((0, 2), np.int32)
    while sweeps > 0 and (worst[0] > enough or distance(position - listed).max() > far):
        if distance(position - listed).max() > far:
            listed, pair = position.copy(), _near(position, (1.0 + SKIN) * radius)
        inputs: list[Any] = [places, radii, shared(pair, wp.vec2i), walls, box, AT_ONCE, enough, told]
        launch(pushing.push, inputs)
        sweeps -= int(worst[1])
    return float(worst[0])


def _near(position: FloatArray, radius: FloatArray) -> np.ndarray[Any, Any]:
    """Return the pairs of discs that overlap, in lexicographic order, shape (m, 2)."""
    found = [np.stack(pair, axis=1) for pair in overlapping_pairs(position, radius)]
    pair = np.concatenate([np.empty((0, 2), np.int64), *found])
    return np.ascontiguousarray(pair[np.lexsort(pair.T[::-1])], np.int32)
