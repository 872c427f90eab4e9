"""Graphs of contacts, and twins in Python of the loops that order them (kernels/coloring.py)."""

from collections import defaultdict

import numpy as np

from warpgrains.arrays import IntArray

COLORS = 64


def star(leaves: int) -> IntArray:
    return np.array([(0, j) for j in range(1, leaves + 1)], np.int32)


def hub_last(leaves: int) -> IntArray:
    return np.array([(i, leaves) for i in range(leaves)], np.int32)


def path(n: int) -> IntArray:
    return np.array([(i, i + 1) for i in range(n - 1)], np.int32)


def complete(n: int) -> IntArray:
    return np.stack(np.triu_indices(n, 1), axis=1).astype(np.int32)


def empty() -> IntArray:
    return np.zeros((0, 2), np.int32)


def random_graph(n: int, pairs: int, seed: int) -> IntArray:
    """So many pairs among n grains, in lexicographic order."""
    everything = complete(n)
    chosen = np.random.default_rng(seed).choice(len(everything), pairs, replace=False)
    return everything[np.sort(chosen)]


def levels(pairs: IntArray) -> list[int]:
    """Return one above the highest level among earlier pairs that share a grain."""
    top: dict[int, int] = defaultdict(int)
    found = []
    for i, j in pairs.tolist():
        found.append(max(top[i], top[j]))
        top[i] = top[j] = found[-1] + 1
    return found


def first_fit_colors(pairs: IntArray) -> list[int]:
    """Return the lowest color that neither grain has yet; beyond 64, a color of its own."""
    used: dict[int, set[int]] = defaultdict(set)
    found, next_extra = [], COLORS
    for i, j in pairs.tolist():
        color = min(set(range(COLORS)) - used[i] - used[j], default=next_extra)
        next_extra += color == next_extra
        used[i].add(color)
        used[j].add(color)
        found.append(color)
    return found
