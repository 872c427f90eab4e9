"""A step's convex problem, by a proximal interior point method that starts from given corrections.

In units of its own, u = sqrt(M) v and q = sqrt(mu_c) dv, a step is (kernels/MODEL.md, eq. 20)

    min 1/2 |u - u0|^2  subject to  A u <= b;     u = u0 - A^T q,   s = b - A u,   q, s >= 0,   q_c s_c = 0

with rows of length 1. The last equation is relaxed to q_c s_c = mu, and mu driven to 0 by Newton's steps,
with Mehrotra's predictor and corrector (1992). Each needs the factors of one matrix, I + A^T diag(q / (s + q
/ rho)) A. The proximal term rho (Rockafellar 1976) bounds it where contacts are more than a pile needs; it
changes the way, not its end. Corrections that sweeps have left are nearly right but on the border, from where
no long step is possible: the start is centred, moved to q_c s_c = mu with q - s as it is, and so is a point
from which a step turns out short.

Sums are NumPy's own, and factors those of qdldl, of one thread and without BLAS: the same bits every time.
"""

from typing import NamedTuple

import numpy as np
import qdldl
from scipy import sparse

from warpgrains.arrays import FloatArray, IndexArray

PROXIMITY = 1e9  # rho: without it the matrix grows to 1e13, and residuals stay at 1e-5 to 1e-7
FIRST = 30.0  # of the natural residual, whose square mu is at first
WIDER = 100.0  # times the mean of q s: mu after a short step, and by how much more after the next,
GROWTH = 3.0  # so that the way does not lead in a circle
SHORT = 0.2  # of a step, from which on the iteration starts anew with a wider mu
NEARLY = 0.999  # of the way to the border
MOST = 60  # factorizations
LONG, STUCK = (
    0.9,
    3,
)  # a step, and how many of them that leave A u + s - b as large: nothing satisfies the bounds
STALLED = 25  # steps that do not halve the residual, after which more are of no use
NEGLIGIBLE = 0.02  # of the tolerance: a correction of a contact that lets go


class Projection(NamedTuple):
    """min 1/2 |u - u0|^2 subject to A u <= b, with rows of length 1."""

    rows: sparse.csr_array
    """A, shape (m, 2 n)."""
    bound: FloatArray
    """b, shape (m,)."""
    free: FloatArray
    """u0, shape (2 n,)."""
    unit: FloatArray
    """What one m/s of a contact's correction is in q, shape (m,)."""

    def target(self, q: FloatArray) -> FloatArray:
        """Return q - s, whose positive part is q at the solution."""
        return q - self.bound + self.rows @ (self.free - self.rows.T @ q)

    def residual(self, q: FloatArray) -> float:
        """Return the natural residual (MODEL.md, eq. 12) [m/s]."""
        return float((np.abs(np.maximum(self.target(q), 0.0) - q) / self.unit).max(initial=0.0))


class Solution(NamedTuple):
    """The best corrections found."""

    q: FloatArray
    """Shape (m,)."""
    residual: float
    """[m/s]."""
    factorizations: int


class NormalMatrix:
    """I + A^T diag(d) A and its factors, for all A with nonzeros where this one has them.

    Its entries are a matrix times d, whose pattern is found once, and values for every A.

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
        entries = np.unique(np.concatenate([keys, np.arange(size) * (size + 1)]))
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
        self._factors = qdldl.Solver(self._matrix, upper=True)

    def fits(self, rows: sparse.csr_array) -> bool:
        """Whether another A has its nonzeros in the same places."""
        return np.array_equal(rows.indices, self._columns) and np.array_equal(rows.indptr, self._starts)

    def take(self, rows: sparse.csr_array) -> None:
        """Take the values of A."""
        self._map.data[:] = rows.data[self._left] * rows.data[self._right]

    def factor(self, diagonal: FloatArray) -> None:
        """Factor it for some d."""
        self._matrix.data[:] = self._identity + self._map @ diagonal
        self._factors.update(self._matrix, upper=True)

    def solve(self, right: FloatArray) -> FloatArray:
        """Return its inverse times a vector."""
        return self._factors.solve(right)


def _products(rows: sparse.csr_array) -> list[tuple[IndexArray, IndexArray, IndexArray, IndexArray]]:
    """Return all terms of A^T diag(d) A, upper triangle: place by columns, row of A, two entries of A."""
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


class _Iterate(NamedTuple):
    """A point on the way, q, s > 0, or a direction."""

    u: FloatArray
    q: FloatArray
    s: FloatArray

    def moved(self, a: float, way: "_Iterate") -> "_Iterate":
        """Return the point after a step."""
        return _Iterate(*(x + a * dx for x, dx in zip(self, way, strict=True)))

    def longest(self, way: "_Iterate") -> float:
        """Return the longest step, at most 1, that keeps q and s positive."""
        return float(1.0 / max(1.0, (-way.q / self.q).max(), (-way.s / self.s).max()))

    def centred(self, mu: float) -> "_Iterate":
        """Return the q, s > 0 with the same q - s, and q s = mu; the smaller one without cancellation."""
        t = self.q - self.s
        large = 0.5 * (np.sqrt(t * t + 4.0 * mu) + np.abs(t))
        small = mu / large
        return _Iterate(self.u, np.where(t > 0.0, large, small), np.where(t > 0.0, small, large))

    def gap(self) -> float:
        """Return the mean of q s."""
        return float((self.q * self.s).sum()) / len(self.q)


def _begin(problem: Projection, q: FloatArray) -> tuple[_Iterate, float]:
    """Return the point to start from, and its mu: the larger, the less q solves the step."""
    across = problem.rows.T
    t = problem.target(q)
    error = np.maximum(t, 0.0) - q
    spread = across @ error
    mu = FIRST**2 * float((error * error).sum() + (spread * spread).sum()) / len(q)
    return _Iterate(problem.free - across @ q, t, np.zeros_like(t)).centred(mu), mu


def _direction(problem: Projection, matrix: NormalMatrix, at: _Iterate) -> _Iterate:
    """Return Mehrotra's direction."""
    rows, b, free, _ = problem
    u, q, s = at
    rd, rp = u - free + rows.T @ q, rows @ u + s - b
    den = s + q / PROXIMITY
    matrix.factor(q / den)

    def newton(rc: FloatArray) -> _Iterate:
        du = matrix.solve(-rd - rows.T @ ((q * rp - rc) / den))
        dq = (q * (rows @ du + rp) - rc) / den
        return _Iterate(du, dq, -(rc + s * dq) / q)

    gap = at.gap()
    ahead = newton(q * s)
    centering = (at.moved(at.longest(ahead), ahead).gap() / gap) ** 3
    return newton(q * s + ahead.s * ahead.q - centering * gap)


def solve(problem: Projection, matrix: NormalMatrix, q: FloatArray, tolerance: float) -> Solution:
    """Solve a step from corrections that some sweeps have left, to a natural residual of the tolerance [m/s].

    Where the residual does not come down to it, the best corrections are returned; they may be those given.
    """
    rows, b, _, unit = problem
    matrix.take(rows)
    best, least = q, problem.residual(q)
    lowest = violation = np.inf
    stalled = stuck = 0
    at, mu = _begin(problem, q)
    count, wider = 0, WIDER
    while count < MOST:
        count += 1
        way = _direction(problem, matrix, at)
        a = at.longest(way)
        if a < SHORT:
            mu = wider * max(mu, at.gap())
            wider *= GROWTH
            at = at.moved(a, way).centred(mu)
            lowest, stalled, stuck = np.inf, 0, 0
            continue
        mu, a = 0.0, min(1.0, NEARLY * a)
        at = at.moved(a, way)
        kept = np.where((at.q < at.s) & (at.q < NEGLIGIBLE * tolerance * unit), 0.0, at.q)
        residual = problem.residual(kept)
        if residual < least:
            best, least = kept, residual
        last, violation = violation, float((np.abs(rows @ at.u + at.s - b) / unit).max())
        stuck = stuck + 1 if a > LONG and violation > max(tolerance, 0.5 * last) else 0
        stalled = 0 if residual <= 0.5 * lowest else stalled + 1
        lowest = min(lowest, residual)
        if least <= tolerance or stuck == STUCK or stalled == STALLED or not np.isfinite(residual):
            break
    return Solution(best, least, count)
