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

from warpgrains.base.arrays import FloatArray, Indices
from warpgrains.solver.exact.constraints import StepConstraints

PROXIMITY = 1e9  # rho; without rho, matrix entries reach 1e13, and residuals stall at 1e-5 to 1e-7


class Projection(NamedTuple):
    """min 1/2 |u - u0|^2 subject to A u <= b, with rows of length 1."""

    rows: sparse.csr_array
    """A, shape (m, 2 n)."""
    bound: FloatArray
    """b, shape (m,)."""
    free: FloatArray
    """u0, shape (2 n,)."""
    unit: FloatArray
    """Factor from m/s to the scaled slack s, shape (m,). A correction of 1 m/s is q = K unit (eq. 28)."""
    widest: float = np.inf
    """Bound on |u| of a solution."""

    def target(self, q: FloatArray) -> FloatArray:
        """Return q - s for multipliers q and the slacks s of the rows, shape (m,).

        At the solution, its positive part is q.
        """
        return q - self.bound + self.rows @ (self.free - self.rows.T @ q)

    def residual(self, q: FloatArray) -> float:
        """Return the natural residual [m/s] (MODEL.md, eq. 12) for q = `unit` K dv, shape (m,)."""
        return float((np.abs(np.maximum(self.target(q), 0.0) - q) / self.unit).max(initial=0.0))

    def is_infeasible(self, q: FloatArray) -> bool:
        """Return True if weights q prove that no |u| <= widest has A u <= b (Farkas; MODEL.md, eq. 15)."""
        force = self.rows.T @ q
        return float((self.bound * q).sum()) < -self.widest * float(np.sqrt((force * force).sum()))


def projection_of(constraints: StepConstraints, free_velocity: FloatArray) -> Projection:
    """Return a step's problem from its constraints and free velocities [m/s], shape (n, 2).

    Each driven wall is treated as another grain, with velocity (speed, 0).
    """
    mass, normal, compliance = constraints.mass, constraints.normal, constraints.compliance
    j, alone, pairs = constraints.second, constraints.wall[:, 0], len(constraints.second)
    i = constraints.first[:pairs]
    mass_i, mass_j = mass[i], mass[j]
    share_i, share_j = (np.sqrt(other / (mass_i + mass_j))[:, np.newaxis] for other in (mass_j, mass_i))
    at_wall, driver = np.sqrt(compliance[pairs:])[:, np.newaxis], constraints.driver
    lever = constraints.lever[:, :1] * np.sqrt(mass[alone] / mass[driver])[:, np.newaxis] * [1.0, 0.0]
    values = (
        [share_i * normal[:pairs], -share_j * normal[:pairs]],
        [normal[pairs:] / at_wall, -lever / at_wall],
    )
    columns = [_columns(i), _columns(j)], [_columns(alone), _columns(driver)]
    has_four = np.append(np.ones(pairs, bool), driver >= 0)
    kept = np.stack([np.ones(len(has_four), bool), np.ones(len(has_four), bool), has_four, has_four], axis=1)
    data, indices = (np.concatenate([np.hstack(part) for part in parts])[kept] for parts in (values, columns))
    start = np.concatenate([[0], np.cumsum(np.where(has_four, 4, 2))]).astype(np.int32)
    indices = indices.astype(np.int32)
    unit = np.concatenate(
        [np.sqrt(mass_i / (mass_i + mass_j) * mass_j), np.sqrt(mass[alone] / compliance[pairs:])]
    )
    rows = sparse.csr_array((data, indices, start), shape=(len(unit), 2 * len(mass)))
    free = (np.sqrt(mass)[:, np.newaxis] * free_velocity).ravel()
    # all grains cross the domain in the step
    widest = 2.0 * constraints.scene.reach / constraints.scene.dt * float(np.sqrt(mass.sum()))
    return Projection(rows, unit * constraints.gap_rate, free, unit, widest)


def _columns(grain: Indices) -> Indices:
    """Return the columns of A for the velocities of grains, shape (m, 2)."""
    return np.stack([2 * grain, 2 * grain + 1], axis=1)


class Solution(NamedTuple):
    """Corrections and their natural residual."""

    q: FloatArray
    """Scaled corrections (head of this module), shape (m,)."""
    residual: float
    """Natural residual of q (eq. 12) [m/s]."""
    factorizations: int


class NormalMatrix:
    """I + A^T diag(d) A and its factors. A grain has two rows and columns, so the matrix has 2 x 2 blocks.

    Attributes
    ----------
    solver : qdldl.Solver
        Factors of the matrix.
    """

    def __init__(self) -> None:
        self._pairs = np.empty(0, np.int64)
        self._size = 0
        self.solver: Any = None

    def take(self, rows: sparse.csr_array) -> None:
        """Set A. Its rows have two entries, of one grain, or four, of two grains in ascending order.

        The order of elimination depends only on the pairs of grains, and is kept while these are the same.
        """
        start = rows.indptr[:-1].astype(np.int64)
        self._is_pair = np.diff(rows.indptr) == 4
        pair = start[self._is_pair]
        self._alone, self._first = rows.indices[start] // 2, rows.indices[pair] // 2
        self._second = rows.indices[pair + 2] // 2
        grains = rows.shape[1] // 2
        key = self._second.astype(np.int64) * grains + self._first
        pairs = np.sort(key)
        pairs = pairs[np.append(True, pairs[1:] != pairs[:-1])[: len(pairs)]]
        if grains != self._size or not np.array_equal(pairs, self._pairs):
            self._size, self._pairs = grains, pairs
            self._make_pattern()
        self._place = np.searchsorted(self._pairs, key)
        x, y = rows.data[start], rows.data[start + 1]
        u, v = rows.data[pair + 2], rows.data[pair + 3]
        self._squares = [np.append(a, b) for a, b in ((x * x, u * u), (x * y, u * v), (y * y, v * v))]
        x, y = x[self._is_pair], y[self._is_pair]
        self._products = [x * u, y * u, x * v, y * v]

    def _make_pattern(self) -> None:
        """Make the upper triangle of the matrix, by columns, for the present pairs of grains."""
        j, i = np.divmod(self._pairs, self._size)
        pairs = np.bincount(j, minlength=self._size)
        length = np.stack([2 * pairs + 1, 2 * pairs + 2], axis=1).ravel()
        start = np.concatenate([[0], np.cumsum(length)])
        above = 2 * (np.arange(len(j)) - (np.cumsum(pairs) - pairs)[j])
        left, right = start[2 * j] + above, start[2 * j + 1] + above
        self._blocks = [left, left + 1, right, right + 1]
        diagonal = start[1::2] - 1
        last = start[2::2] - 1
        self._diagonal = [diagonal, last - 1, last]
        line = np.empty(start[-1], np.int32)
        for place, row in zip(self._blocks, (2 * i, 2 * i + 1, 2 * i, 2 * i + 1), strict=True):
            line[place] = row
        own = 2 * np.arange(self._size)
        line[diagonal], line[last - 1], line[last] = own, own, own + 1
        shape = (2 * self._size, 2 * self._size)
        values = np.zeros(start[-1])
        self._matrix = sparse.csc_matrix((values, line, start.astype(np.int32)), shape=shape)
        self.solver = None

    def factor(self, d: FloatArray) -> None:
        """Factor I + A^T diag(d) A, for d of shape (m,)."""
        data, apart = self._matrix.data, d[self._is_pair]
        grain, weight = np.append(self._alone, self._second), np.append(d, apart)
        for place, square, one in zip(self._diagonal, self._squares, (1.0, 0.0, 1.0), strict=True):
            data[place] = one + np.bincount(grain, weight * square, self._size)
        for place, product in zip(self._blocks, self._products, strict=True):
            data[place] = np.bincount(self._place, apart * product, len(self._pairs))
        if self.solver is None:
            self.solver = qdldl.Solver(self._matrix, upper=True)
        else:
            self.solver.update(self._matrix, upper=True)

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the inverse of the factored matrix times a vector."""
        return self.solver.solve(right)
