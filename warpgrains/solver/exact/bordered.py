"""Solution of systems with I + rho A_W^T A_W, for sets W of rows of A that differ from a base by a few rows.

The matrix of the base is factored. Each changed row adds a border, that is a column and a row, to this matrix
(kernels/exact/bordered.py).
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from warpgrains.base.arrays import BoolArray, FloatArray, IndexArray
from warpgrains.base.host_kernels import Array, launch, share, shared
from warpgrains.kernels.exact import bordered as kernels
from warpgrains.solver.exact.projection import PROXIMITY, NormalMatrix

MOST = 400  # borders of a matrix
FEW = 10_000  # up to this number of rows, the matrix has entries for all rows, and its order is kept


class BorderedMatrix:
    """Factors for a base set of rows of A, and borders for the rows by which W differs from the base.

    Attributes
    ----------
    base : ndarray
        Mask of the rows of the base, shape (m,).
    changed : ndarray
        Indices of the rows in either W or the base, but not in both.
    """

    base: BoolArray
    changed: IndexArray

    def __init__(self) -> None:
        self._rows = sparse.csr_array((0, 0))
        self._matrix, self._factors, self._borders = NormalMatrix(), kernels.Factors(), kernels.Borders()
        self._host: dict[str, Array] = {}
        self._share(count=np.zeros(1, np.int32), index=np.empty(0, np.int32), value=np.empty(0))
        self._host["work"] = np.empty(0)

    def _reserve(self, most: int) -> None:
        """Reserve memory for at most `most` borders."""
        self._borders.most = most
        self._share(start=np.zeros(most + 1, np.int32), used=np.empty(most, np.int32))
        self._share(**{name: np.empty(most) for name in ("shift", "force")})
        self._share(**{name: np.empty(most * most) for name in ("schur", "lower")})

    def _share(self, **arrays: Array) -> None:
        """Share arrays with the kernels, by name."""
        self._host |= arrays
        share(self._borders, arrays)

    def fits(self, rows: sparse.csr_array) -> bool:
        """Return True if `rows` is the very matrix A that was last given to `factor`."""
        return self._rows is rows

    def factor(self, rows: sparse.csr_array, base: BoolArray) -> None:
        """Factor I + rho A_B^T A_B, where A_B has the rows that the mask `base`, shape (m,), selects.

        All borders are dropped.
        """
        self._rows, self.base = rows, base
        most = min(MOST, len(base))
        if most > self._borders.most:
            self._reserve(most)
        weight = np.where(base, PROXIMITY, 0.0)
        if len(base) > FEW:
            rows, weight = rows[base], weight[base]
        self._matrix.take(rows)
        self._matrix.factor(weight)
        self._border = np.full(len(base), -1, np.int32)  # number of the border of each row; -1: none
        self._host["count"][0] = self._factored = 0
        self.changed, self._are_shared = np.empty(0, np.int64), False

    def _share_factors(self) -> None:
        """Share the factors with the kernels."""
        lower, pivot, self._order = self._matrix.solver.factors()
        size = len(pivot)
        self._column = np.empty(size, np.int32)
        self._column[self._order] = np.arange(size)
        parts = {"start": lower.indptr, "row": lower.indices, "value": lower.data, "pivot": pivot}
        share(self._factors, parts)
        if size != len(self._host["work"]):
            self._share(**{name: np.zeros(size) for name in ("work", "x", "y", "scaled")})
        self._are_shared = True

    def change(self, carrying: BoolArray) -> bool:
        """Set W to a mask of rows, shape (m,), and return True.

        Return False, and change nothing, if this needs too many borders.
        """
        wanted = carrying != self.base
        new = np.flatnonzero(wanted & (self._border < 0))
        if self._host["count"][0] + len(new) > self._borders.most:
            return False
        if len(new):
            self._add_borders(new)
        stays = wanted[self.changed]
        self._factored = min(self._factored, len(stays) if stays.all() else int(stays.argmin()))
        wanted[self.changed] = False
        self.changed = np.append(self.changed[stays], np.flatnonzero(wanted))
        self._host["used"][: len(self.changed)] = self._border[self.changed]
        self._host["shift"][: len(self.changed)] = np.where(self.base[self.changed], -1.0, 1.0) / PROXIMITY
        return True

    def _add_borders(self, new: IndexArray) -> None:
        if not self._are_shared:
            self._share_factors()
        start, last = self._rows.indptr[new, np.newaxis], self._rows.indptr[new + 1, np.newaxis] - 1
        place = start + np.arange(4)
        entry = np.where(place <= last, self._rows.data[np.minimum(place, last)], 0.0)
        column = self._column[self._rows.indices[np.minimum(place, last)]]
        given, count = [shared(column.ravel()), shared(entry.ravel())], self._host["count"]
        first = count.item()
        while count[0] < first + len(new):
            enough = self._host["start"][count.item()] + len(self._column)
            if len(self._host["index"]) < enough:
                self._share(**{name: np.resize(self._host[name], 2 * enough) for name in ("index", "value")})
            launch(kernels.add_borders, [self._factors, self._borders, *given, count.item() - first])
        self._border[new] = np.arange(first, first + len(new))

    def take(self, right: FloatArray) -> None:
        """Set the right-hand side r, shape (2 n,), of M x = r - A^T f (`solve`)."""
        self._right, self._is_forward = right, False

    def solve(self, own: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the forces f on the changed rows, and the x of M x = r - A^T f, shape (2 n,).

        M = I + rho A_B^T A_B is the matrix of the base B. `own` holds the right-hand sides of the equations
        that the changed rows add, in the order of `changed`.
        """
        count = len(own)
        if count == 0:
            return own, self._matrix.solve(self._right)
        if not self._is_forward:
            self._host["y"][:] = self._right[self._order]
            launch(kernels.forward, [self._factors, self._borders])
            self._is_forward = True
        self._host["force"][:count] = own
        launch(kernels.solve, [self._factors, self._borders, self._factored, count])
        self._factored = count
        found = np.empty_like(self._right)
        found[self._order] = self._host["x"]
        return self._host["force"][:count].copy(), found
