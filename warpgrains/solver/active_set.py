"""Active-set method for a step's convex problem (projection.py), started from nearly correct corrections.

The dual problem is to minimize 1/2 |u0 - A^T q|^2 + b . q over q >= 0 (nonnegative least squares), solved by
the method of Lawson and Hanson (1974). The contacts W that carry a force meet their bounds as equations,

    u = u0 - A_W^T z,   A_W u = b_W + (z - q*) / rho,

where q* is the value of q when they last did (method of multipliers: it keeps the matrix regular if W has a
redundant contact). On the way from q to z some corrections become 0; their contacts leave W as long as the
dual decreases. At z, contacts with violated bounds join W. Every change lowers the dual, so that no W occurs
twice.

After sweeps, few of thousands of contacts are in the wrong set. One matrix is factored, for the first W. Each
change of W borders it with a column and a row, and costs one more solution, about 10 % of a factorization.
"""

import numpy as np
import qdldl
from scipy import sparse

from warpgrains.arrays import BoolArray, FloatArray
from warpgrains.solver.projection import PROXIMITY, NormalMatrix, Projection, Solution

KEPT = 100  # changes of W before a new factorization
CENTRES = 8  # most updates of q* for one W
MET = 0.1  # largest error of the bounds that are met, in tolerances
NEGLIGIBLE = 1e-12  # [m/s]: contacts with smaller corrections leave W


def most_changes(grains: int) -> int:
    """Return the number of contacts to add or remove that costs half as much as the interior point method."""
    return max(20, grains // 40)


class _Equations:
    """Solutions for a set W, obtained from the factors for another set, the base."""

    def __init__(self, problem: Projection, matrix: NormalMatrix):
        self._problem, self._matrix = problem, matrix
        self._columns = np.empty((KEPT, len(problem.bound)))  # A u of a force on each changed contact
        self.across = problem.rows.T
        self.factorizations = 0

    def slack(self, q: FloatArray) -> FloatArray:
        """Return s = b - A u."""
        rows, b, free, _ = self._problem
        return b - rows @ (free - self.across @ q)

    def factor(self, carrying: BoolArray) -> None:
        """Factor the matrix of a new base."""
        self.factorizations += 1
        self._matrix.factor(np.where(carrying, PROXIMITY, 0.0))
        self._base = self._carrying = carrying
        self._changed: list[int] = []

    def centre(self, q: FloatArray) -> None:
        """Set q* to q, and update the base's solution accordingly."""
        self._q, short = q, np.where(self._carrying, self.slack(q), 0.0)
        self._push = q - PROXIMITY * short
        du = self._matrix.solve(PROXIMITY * (self.across @ np.where(self._base, short, 0.0)))
        self._closing = self._problem.rows @ du

    def change(self, carrying: BoolArray) -> None:
        """Change W for the same q*. If a contact has joined, call `center` next."""
        wanted = carrying != self._base
        if wanted.sum() > KEPT:
            self.factor(carrying)
            self.centre(self._q)
            return
        self._carrying = carrying
        kept = [k for k, c in enumerate(self._changed) if wanted[c]]
        if len(kept) < len(self._changed):
            self._columns[: len(kept)] = self._columns[kept]
            self._changed = [self._changed[k] for k in kept]
        wanted[self._changed] = False
        for c in np.flatnonzero(wanted).tolist():
            self._columns[len(self._changed)] = self._column(c)
            self._changed.append(c)

    def _column(self, c: int) -> FloatArray:
        rows, force = self._problem.rows, np.zeros(len(self._problem.free))
        entries = slice(rows.indptr[c], rows.indptr[c + 1])
        force[rows.indices[entries]] = rows.data[entries]
        return rows @ self._matrix.solve(force)

    def solve(self) -> FloatArray:
        """Return z, 0 where no contact carries.

        A contact that has joined adds an equation for its z to those of the base. One that has left adds an
        unknown force that cancels its z.
        """
        changed, columns = self._changed, self._columns[: len(self._changed)]
        joined, push = ~self._base[changed], self._push
        if not changed:
            return np.where(self._carrying, push + PROXIMITY * self._closing, 0.0)
        small = columns[:, changed] + np.diag(np.where(joined, 1.0, -1.0) / PROXIMITY)
        own = push[changed] - np.where(joined, self._q[changed], 0.0)
        force = qdldl.Solver(sparse.csc_matrix(small)).solve(self._closing[changed] + own / PROXIMITY)
        closing = self._closing - np.einsum("k,km->m", force, columns)
        z = np.where(self._carrying, push + PROXIMITY * closing, 0.0)
        z[changed] = np.where(joined, self._q[changed] + force, 0.0)
        return z


def _lowest(equations: _Equations, q: FloatArray, z: FloatArray, a: float) -> FloatArray:
    """Return the point from q towards z, clipped at 0, where the dual stops falling.

    The first zero of a correction is at step a.
    """
    slack = equations.slack(q)

    def at(a: float) -> tuple[float, FloatArray]:
        there = np.maximum(q + a * (z - q), 0.0)
        spread = equations.across @ (there - q)
        return float(((there - q) * slack).sum() + 0.5 * (spread * spread).sum()), there

    here, further = at(a), at(2.0 * a)
    while further[0] < here[0] and a < 0.5:
        a *= 2.0
        here, further = further, at(2.0 * a)
    return here[1]


def solve(problem: Projection, matrix: NormalMatrix, q: FloatArray, tolerance: float) -> Solution:
    """Solve a step from the corrections of some sweeps, to a natural residual of `tolerance` [m/s].

    If too many contacts would have to change, the last corrections are returned.
    """
    unit = problem.unit
    matrix.take(problem.rows)
    carrying, equations = q > 0.0, _Equations(problem, matrix)
    equations.factor(carrying)
    equations.centre(q)
    changes = centres = 0
    most = most_changes(len(problem.free) // 2)
    while changes <= most:
        z = equations.solve()
        leaving = carrying & (z < -NEGLIGIBLE * unit)
        if leaving.any():
            q = _lowest(equations, q, z, float((q[leaving] / (q - z)[leaving]).min()))
            leaving &= q <= NEGLIGIBLE * unit
            q[leaving] = 0.0
            changes, carrying = changes + int(leaving.sum()), carrying & ~leaving
            equations.change(carrying)
            continue
        q = np.maximum(z, 0.0)
        slack = equations.slack(q) / unit
        if np.abs(slack[carrying]).max(initial=0.0) > MET * tolerance and centres < CENTRES:
            centres += 1
        else:
            joining = ~carrying & (slack < -tolerance)
            if not joining.any():
                break
            changes, centres, carrying = changes + int(joining.sum()), 0, carrying | joining
            equations.change(carrying)
        equations.centre(q)
    return Solution(q, problem.residual(q), equations.factorizations)
