"""Which discs overlap: a search by cells in NumPy, for scenes; the solver has its own on the device."""

from collections.abc import Iterator

import numpy as np

from warpgrains.arrays import FloatArray, IndexArray

ROUNDING = 8 * np.finfo(np.float64).eps
"""A gap within this share of the size of the coordinates is a touch, not an overlap."""


def distance(vectors: FloatArray) -> FloatArray:
    """Return the lengths of vectors, shape (m, 2) to (m,), in the arithmetic of the solver."""
    with np.errstate(over="ignore"):
        return np.sqrt(vectors[:, 0] * vectors[:, 0] + vectors[:, 1] * vectors[:, 1])


def overlapping_pairs(position: FloatArray, radius: FloatArray) -> Iterator[tuple[IndexArray, IndexArray]]:
    """Find the pairs of discs that overlap, each once, in memory proportional to n.

    The discs are taken by size class, a factor of two wide. A disc and one of its own class or a smaller
    one can only overlap if their cells, as wide as the largest diameter of the class, are neighbours. So
    a few huge discs among many small ones cost no more than discs of one size.

    Parameters
    ----------
    position
        Centres [m], shape (n, 2).
    radius
        Radii [m], shape (n,), all > 0.

    Yields
    ------
    i, j
        Indices of overlapping discs, i < j, in pieces of any length and in no special order.
    """
    size_class = np.frexp(radius)[1]
    for this_class in np.unique(size_class):
        members = np.flatnonzero(size_class == this_class)
        seekers = np.flatnonzero(size_class <= this_class)
        cell = np.floor((position - position.min(axis=0)) / (2.0 * radius[members].max())).astype(np.int64)
        stride = cell[:, 1].max() + 3
        key = cell[:, 0] * stride + cell[:, 1]
        members = members[np.argsort(key[members], kind="stable")]
        for column in (-stride, 0, stride):
            for neighbour in (column - 1, column, column + 1):
                yield from _overlaps_in_cell(
                    position, radius, members, key[members], seekers, key[seekers] + neighbour
                )


def _overlaps_in_cell(
    position: FloatArray,
    radius: FloatArray,
    members: IndexArray,
    member_key: IndexArray,
    seekers: IndexArray,
    key: IndexArray,
) -> Iterator[tuple[IndexArray, IndexArray]]:
    """Hold every seeker against the members of the one cell named by its key."""
    first = np.searchsorted(member_key, key, side="left")
    last = np.searchsorted(member_key, key, side="right")
    touch = ROUNDING * np.abs(position).max()
    while (busy := first < last).any():
        seekers, first, last = seekers[busy], first[busy], last[busy]
        found = members[first]
        gap = distance(position[found] - position[seekers]) - (radius[found] + radius[seekers])
        same_class = np.frexp(radius[found])[1] == np.frexp(radius[seekers])[1]
        overlap = (gap < -touch) & (~same_class | (seekers < found))
        if overlap.any():
            pair = np.sort(np.stack([seekers[overlap], found[overlap]]), axis=0)
            yield pair[0], pair[1]
        first = first + 1
