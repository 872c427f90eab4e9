"""A step as a convex problem, and the matrix that is factored to solve it.

In the scaled variables u = sqrt(M) v and q = sqrt(mu_c) dv, a step is (kernels/MODEL.md, eq. 20)

    min 1/2 |u - u0|^2  subject to  A u <= b,     u = u0 - A^T q,   q >= 0

with rows of length 1. Sums are NumPy's own loops and factorizations are those of qdldl, single-threaded and
without BLAS, so that the bits are the same every time.
"""

from typing import Any, NamedTuple

import numpy as np
import qdldl
from scipy import sparse

from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.solver.constraints import Grains, StepConstraints

PROXIMITY = 1e9  # rho; without it matrix entries reach 1e13, and residuals stall at 1e-5 to 1e-7


class Projection(NamedTuple):
    """min 1/2 |u - u0|^2 subject to A u <= b, with rows of length 1."""

    rows: sparse.csr_array
    """A, shape (m, 2 n)."""
    bound: FloatArray
    """b, shape (m,)."""
    free: FloatArray
    """u0, shape (2 n,)."""
    unit: FloatArray
    """Scale of q: the value of q for a correction of 1 m/s, shape (m,)."""

    def target(self, q: FloatArray) -> FloatArray:
        """Return q - s, whose positive part equals q at the solution."""
        return q - self.bound + self.rows @ (self.free - self.rows.T @ q)

    def residual(self, q: FloatArray) -> float:
        """Return the natural residual (MODEL.md, eq. 12) [m/s]."""
        return float((np.abs(np.maximum(self.target(q), 0.0) - q) / self.unit).max(initial=0.0))


def projection_of(constraints: StepConstraints, free_velocity: FloatArray) -> Projection:
    """Return a step's problem from its constraints and free velocities [m/s], shape (n, 2)."""
    mass, normal = constraints.scene.contact_mass, constraints.normal
    j, alone, pairs = constraints.second, constraints.wall_grain, len(constraints.second)
    i = constraints.first[:pairs]
    mass_i, mass_j = mass[i], mass[j]
    share_i, share_j = (np.sqrt(other / (mass_i + mass_j))[:, np.newaxis] for other in (mass_j, mass_i))
    values = [np.hstack([share_i * normal[:pairs], -share_j * normal[:pairs]]), normal[pairs:]]
    columns = [np.hstack([_columns(i), _columns(j)]), _columns(alone)]
    unit = np.concatenate([np.sqrt(mass_i / (mass_i + mass_j) * mass_j), np.sqrt(mass[alone])])
    data, indices = (np.concatenate([part.ravel() for part in parts]) for parts in (values, columns))
    start = np.concatenate([[0], np.cumsum(np.repeat([4, 2], [pairs, len(alone)]))])
    rows = sparse.csr_array((data, indices, start), shape=(len(unit), 2 * len(mass)))
    free = (np.sqrt(mass)[:, np.newaxis] * free_velocity).ravel()
    return Projection(rows, unit * constraints.gap_rate, free, unit)


def _columns(grain: Grains) -> Grains:
    """Return the columns of A for the velocities of grains, shape (m, 2)."""
    return np.stack([2 * grain, 2 * grain + 1], axis=1)


class Solution(NamedTuple):
    """Corrections and their natural residual."""

    q: FloatArray
    """Shape (m,)."""
    residual: float
    """[m/s]."""
    factorizations: int


class NormalMatrix:
    """I + A^T diag(d) A and its factors, for all A with the same sparsity pattern.

    The entries are a matrix times d. The pattern of that matrix is found once, its values for every A.

    Parameters
    ----------
    rows : csr_array
        A; no row is empty.
    """

    def __init__(self, rows: sparse.csr_array):
        self._columns, self._starts = rows.indices, rows.indptr
        size = rows.shape[1]
        keys, row, left, right = (np.concatenate(parts) for parts in zip(*_products(rows), strict=True))
        order = np.argsort(keys, kind="stable")
        self._left, self._right, keys = left[order], right[order], keys[order]
        entries = np.sort(np.concatenate([keys, np.arange(size) * (size + 1)]), kind="stable")
        entries = entries[np.append(True, entries[1:] != entries[:-1])]
        start = np.searchsorted(keys, np.append(entries, size * size)).astype(np.int32)
        values = np.zeros(len(keys))
        self._map = sparse.csr_array(
            (values, row[order].astype(np.int32), start), shape=(len(entries), rows.shape[0])
        )
        column, line = np.divmod(entries, size)
        self._identity = (column == line).astype(float)
        start = np.searchsorted(column, np.arange(size + 1)).astype(np.int32)
        self._matrix = sparse.csc_matrix(
            (self._identity.copy(), line.astype(np.int32), start), shape=(size, size)
        )
        self._factors: Any = None

    def fits(self, rows: sparse.csr_array) -> bool:
        """Return True if another A has the same sparsity pattern."""
        return np.array_equal(rows.indices, self._columns) and np.array_equal(rows.indptr, self._starts)

    def take(self, rows: sparse.csr_array) -> None:
        """Take the values of A."""
        self._map.data[:] = rows.data[self._left] * rows.data[self._right]

    def factor(self, diagonal: FloatArray) -> None:
        """Factor the matrix for some d."""
        self._matrix.data[:] = self._identity + self._map @ diagonal
        if self._factors is None:
            self._factors = qdldl.Solver(self._matrix, upper=True)
        else:
            self._factors.update(self._matrix, upper=True)

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the inverse of the factored matrix times a vector."""
        return self._factors.solve(right)


def _products(rows: sparse.csr_array) -> list[tuple[IndexArray, IndexArray, IndexArray, IndexArray]]:
    """Return all terms of A^T diag(d) A, upper triangle: position by columns, row of A, two entries of A."""
    found = []
    lengths = np.diff(rows.indptr)
    for length in np.unique(lengths):
        row = np.flatnonzero(lengths == length)
        first, second = np.triu_indices(length)
        entry = rows.indptr[row][:, np.newaxis] + np.arange(length)
        column = rows.indices[entry].astype(np.int64)
        place = column[:, second] * rows.shape[1] + column[:, first]
        found.append(
            (place.ravel(), np.repeat(row, len(first)), entry[:, first].ravel(), entry[:, second].ravel())
        )
    return found
