"""Static structure factor of the centers of grains."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpgrains.analysis.correlations import counted_region
from warpgrains.analysis.region_table import Where
from warpgrains.analysis.snapshot import HasState, snapshot
from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import InputError
from warpgrains.scene.snapshot import Snapshot

CHUNK = 2048  # grains whose waves fit into the cache
SAME_CHANGE = 1e-15  # tolerance of equal spacing, relative to the largest wave number, for rounding errors

ComplexArray = NDArray[np.complex128]


class StructureFactor(NamedTuple):
    """Static structure factor of grain centers."""

    k: FloatArray
    """Wave numbers [1/m], shape (K,). In a periodic box, each is the mean length of its wave vectors."""
    s: FloatArray
    """S(k), shape (K,); NaN without grains."""


def structure_factor(
    of: Snapshot | HasState, k: ArrayLike | None = None, directions: int = 16, region: Where = None
) -> StructureFactor:
    """Return S(k), the mean of ``|sum_j exp(-i k . x_j)|^2 / n`` over directions of k.

    It is evaluated directly, for the n grains in a region and for wave vectors at equal angles from the x
    axis on. With many directions it tends to sum_ij J_0(k r_ij) / n, freud's Debye form in two dimensions.
    For k below some 20 / (width of the region), S(k) is mostly that of the shape of the region, n at k = 0.
    Independent random centers have S = 1.

    In a periodic direction, each component of a wave vector is rounded to a multiple of 2 pi / (side of the
    box). Wave vectors that become 0 are left out, unless all of the same k become 0.

    Parameters
    ----------
    k : array_like, optional
        Wave numbers [1/m], shape (K,), of any order. Equal spacing is fastest. By default 100 up to
        8 pi / (mean diameter), which takes less than a second for 100,000 grains.
    directions : int
        Number of directions in half a turn; S(-k) is S(k).
    region : mapping, optional
        As for `radial_distribution`, with the same default.

    Raises
    ------
    InputError
        Wave numbers are not a list of finite numbers, or the region is invalid.

    Examples
    --------
    >>> k, s = analysis.structure_factor(simulation, k=[0.0, 10.0, 20.0], region={})
    >>> round(float(s[0]), 9)  # the number of grains
    15.0
    """
    now = snapshot(of)
    if k is None:
        k = np.arange(1, 101) * (0.04 * np.pi / now.scene.radius.mean())
    number = np.array(np.nan if isinstance(k, str) else k, np.float64)
    if number.ndim != 1 or not np.isfinite(number).all():
        raise InputError(f"k has shape {number.shape}: it must be a list of finite wave numbers [1/m]")
    counted = counted_region(now, region)
    position = now.position[counted.contains(now.position)]
    angle = np.pi * np.arange(checks.whole_number("directions", directions)) / directions
    way = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    if counted.period:
        return _of_cell(number, way, position, counted.period.lengths)
    along = way @ position.T
    total = np.zeros((len(number), directions), np.complex128)
    for start in range(0, len(position), CHUNK):
        total += _waves(number, along[:, start : start + CHUNK])
    with np.errstate(invalid="ignore"):
        s = (np.abs(total) ** 2).mean(axis=1) / np.float64(len(position))
    return StructureFactor(number, s)


def _of_cell(k: FloatArray, way: FloatArray, position: FloatArray, period: FloatArray) -> StructureFactor:
    """Return S(k) in a periodic cell, as a mean over directions `way`, unit vectors of shape (d, 2).

    k [1/m] has the shape (K,). `period` holds the lengths of the cell [m], shape (2,), 0 without a period. A
    wave vector is k times a direction, rounded to the nearest one that is periodic in the cell.
    """
    vector = k[:, np.newaxis, np.newaxis] * way
    step = np.divide(2.0 * np.pi, period, out=np.zeros(2), where=period > 0.0)
    whole = np.rint(np.divide(vector, step, out=np.zeros_like(vector), where=step > 0.0))
    vector = np.where(step > 0.0, whole * step, vector)
    size = np.hypot(*np.moveaxis(vector, -1, 0))
    weight = np.where(size.any(axis=1, keepdims=True), size > 0.0, True)
    with np.errstate(invalid="ignore"):
        s = [np.abs(np.exp(-1j * (own @ position.T)).sum(axis=1)) ** 2 / len(position) for own in vector]
    return StructureFactor(*(np.average(values, axis=1, weights=weight) for values in (size, np.array(s))))


def _waves(k: FloatArray, along: FloatArray) -> ComplexArray:
    """Return the sum over c of exp(-i k x), for K wave numbers and coordinates x [m], (d, c); shape (K, d).

    Each wave is the previous one times exp(-i dk x), which is computed again only where dk changes.
    """
    wave, factor, previous = np.ones(along.shape, np.complex128), None, np.inf
    sums = np.empty((len(k), len(along)), np.complex128)
    for m, change in enumerate(np.diff(k, prepend=0.0)):
        if factor is None or abs(change - previous) > SAME_CHANGE * np.abs(k).max():
            factor, previous = np.exp(-1j * change * along), change
        wave *= factor
        sums[m] = wave.sum(axis=1)
    return sums
