"""Which pairs of grains are within reach of each other, in lexicographic order."""

import numpy as np
import warp as wp

from warpgrains.kernels import detect
from warpgrains.kernels.data import Grains, Watch
from warpgrains.kernels.detect import Grid, Rows
from warpgrains.kernels.variant import Variant
from warpgrains.solver.launch import Replay, reader


class NeighborSearch:
    """Finds every pair within reach (kernels/watch.py).

    Parameters
    ----------
    grains : Grains
    watch : Watch
        Holds the reaches [m].
    rows : Rows
        Where the pairs are put. `found` and `neighbor` must have room for `total` entries before `sort`.
    variant : Variant
        What the scene's kernels are compiled for.
    replay : Replay
    cell_size : float
        Side of a cell [m]; about the diameter of the grains that are most frequent.
    """

    def __init__(
        self,
        grains: Grains,
        watch: Watch,
        rows: Rows,
        variant: Variant,
        replay: Replay,
        cell_size: float,
    ):
        self._grains, self._watch, self._rows, self._replay = grains, watch, rows, replay
        self._kernels = detect.kernels(variant)
        self._n = grains.position.shape[0]
        self._read_total = reader(self._rows.total)
        self._grid = self._empty_grid(cell_size)

    def _empty_grid(self, cell_size: float) -> Grid:
        device = self._replay.device
        grid = Grid()
        grid.size = cell_size
        grid.width = 1 << int(np.ceil(np.log2(self._n) / 2))
        grid.cell_start = wp.zeros(grid.width**2 + 1, dtype=wp.int32, device=device)
        grid.cell_cursor = wp.zeros(grid.width**2 + 1, dtype=wp.int32, device=device)
        grid.extent = wp.zeros(self._n, dtype=wp.float64, device=device)
        grid.cell_grain = wp.zeros(self._n, dtype=wp.int32, device=device)
        return grid

    @property
    def total(self) -> int:
        """Pairs found."""
        return int(self._read_total()[0])

    def find(self) -> None:
        """Sort the grains into cells, and find the pairs within reach as far as there is room for them."""
        each, kernels, grid, rows = self._replay.each, self._kernels, self._grid, self._rows
        grid.cell_cursor.zero_()
        each(kernels.count_cells, self._n, self._grains, self._watch, grid)
        wp.utils.array_scan(grid.cell_cursor, grid.cell_start, inclusive=False)
        each(kernels.fill_cells, self._n, self._grains, grid)
        rows.cursor.zero_()
        rows.total.zero_()
        each(kernels.find_pairs, self._n, self._grains, self._watch, grid, rows)

    def sort(self) -> None:
        """Put the pairs found in lexicographic order."""
        each, kernels, rows = self._replay.each, self._kernels, self._rows
        wp.utils.array_scan(rows.cursor, rows.start, inclusive=False)
        each(kernels.fill_rows, rows.found.shape[0], rows)
        each(kernels.sort_rows, self._n, rows)
