"""Active-set method for a step's convex problem (projection.py), started from nearly correct corrections.

The dual problem is to minimize 1/2 |u0 - A^T q|^2 + b . q over q >= 0 (nonnegative least squares), solved by
the method of Lawson and Hanson (1974). The contacts W that carry a force meet their bounds as equations,

    u = u0 - A_W^T z,   A_W u = b_W + (z - q*) / rho,

where q* is the value of q at which they were last met (method of multipliers: the term with rho keeps the
matrix regular if W has a redundant contact). On the way from q to z some corrections become 0; their contacts
leave W as long as the dual decreases. At z, contacts with violated bounds join W. Every change lowers the
dual, so that no W occurs twice.

After sweeps, only a few of thousands of contacts are in the wrong set. So one matrix is factored, for the
first W, and later changes of W are borders of this matrix (bordered.py).
"""

from math import sqrt

import numpy as np
from scipy import sparse

from warpgrains.base.arrays import BoolArray, FloatArray
from warpgrains.base.host_kernels import launch, share
from warpgrains.kernels.exact import dual as kernels
from warpgrains.solver.exact.bordered import BorderedMatrix
from warpgrains.solver.exact.projection import PROXIMITY, Projection, Solution

CENTRES = 8  # largest number of updates of q* for one W
MET = 0.1  # largest error of a bound that counts as met, in tolerances
NEGLIGIBLE = 1e-12  # [m/s]: contacts with smaller corrections leave W


def most_solutions(grains: int) -> int:
    """Return how often the equations can be solved in the time that the interior point method takes."""
    return 20 + round(5.0 * sqrt(grains))


class _Dual:
    """The dual problem (head of this module) at a point q, which `move` and `descend` change in place.

    Attributes
    ----------
    q, slack : ndarray
        q and s = b - A u, shape (m,).
    across : csc_array
        A^T.
    """

    def __init__(self, problem: Projection, q: FloatArray):
        self._problem, self.across = problem, problem.rows.T
        self.q, self.slack, self._target = q.copy(), np.empty_like(q), np.empty_like(q)
        self._arrays: kernels.Dual | None = None
        self.move(q)

    def _shared(self) -> kernels.Dual:
        """Return the record of arrays that the kernel `descend` uses."""
        arrays, rows, free = kernels.Dual(), self._problem.rows, self._problem.free
        start, column = (part.astype(np.int32, copy=False) for part in (rows.indptr, rows.indices))
        share(arrays, {"start": start, "column": column, "entry": rows.data, "target": self._target})
        share(arrays, {"q": self.q, "slack": self.slack})
        share(arrays, {name: np.empty_like(free) for name in ("ahead", "spread")})
        return arrays

    def move(self, q: FloatArray) -> None:
        """Set q to the given point, and compute the slack there."""
        rows, b, free, *_ = self._problem
        self.q[:] = q
        self.slack[:] = b - rows @ (free - self.across @ q)

    def descend(self, z: FloatArray, a: float) -> None:
        """Move q toward z, shape (m,), to q(a) = max(0, q + a (z - q)), and update the slack.

        The step is the given a, doubled as long as that lowers the dual further and a < 1/2.
        """
        self._target[:] = z
        self._arrays = self._arrays or self._shared()
        launch(kernels.descend, [self._arrays, a])


class _Equations:
    """The equations A_W u = b_W + (z - q*) / rho of a set W of contacts (head of this module).

    If `matrix` has factors for the same A, from a problem with other bounds, they are reused.
    """

    def __init__(self, rows: sparse.csr_array, matrix: BorderedMatrix, dual: _Dual):
        self._rows, self._matrix, self._carrying = rows, matrix, dual.q > 0.0
        self._across = dual.across
        self.factorizations = 0
        if not (matrix.fits(rows) and matrix.change(self._carrying)):
            self._factor()
        self.centre(dual.q, dual.slack)

    def _factor(self) -> None:
        self.factorizations += 1
        self._matrix.factor(self._rows, self._carrying)

    def centre(self, q: FloatArray, slack: FloatArray) -> None:
        """Set the center q* of the term (z - q*) / rho, and the slack b - A u at q*."""
        self._q, self._slack = q.copy(), slack.copy()
        short = np.where(self._carrying, slack, 0.0)
        self._push = q - PROXIMITY * short
        self._matrix.take(PROXIMITY * (self._across @ np.where(self._matrix.base, short, 0.0)))

    def change(self, carrying: BoolArray) -> None:
        """Set W to the mask `carrying`, shape (m,), for the same q*.

        If a contact has joined W, `centre` must be called before `solve`.
        """
        self._carrying = carrying
        if not self._matrix.change(carrying):
            self._factor()
            self.centre(self._q, self._slack)

    def solve(self) -> FloatArray:
        """Return the solution z of the equations, shape (m,), which is 0 for contacts outside W.

        A contact in W, but not in the base of the matrix, adds an equation for its z. A contact in the base,
        but not in W, adds an unknown force that cancels its z.
        """
        changed = self._matrix.changed
        joined, push = ~self._matrix.base[changed], self._push
        own = push[changed] - np.where(joined, self._q[changed], 0.0)
        force, du = self._matrix.solve(own / PROXIMITY)
        z = np.where(self._carrying, push + PROXIMITY * (self._rows @ du), 0.0)
        z[changed] = np.where(joined, self._q[changed] + force, 0.0)
        return z


def solve(problem: Projection, matrix: BorderedMatrix, q: FloatArray, tolerance: float) -> Solution:
    """Solve a step, from the scaled corrections q of some sweeps, to a natural residual of `tolerance` [m/s].

    For the scaling, see projection.py. If the method must solve the equations too often, or the step has no
    solution, it returns the last q, whose residual may be larger.
    """
    unit, carrying = problem.unit, q > 0.0
    dual = _Dual(problem, q)
    equations = _Equations(problem.rows, matrix, dual)
    centres = 0
    for _ in range(most_solutions(len(problem.free) // 2)):
        z = equations.solve()
        leaving = carrying & (z < -NEGLIGIBLE * unit)
        if leaving.any():
            dual.descend(z, float((dual.q[leaving] / (dual.q - z)[leaving]).min()))
            leaving &= dual.q <= NEGLIGIBLE * unit
            dual.q[leaving] = 0.0
            carrying = carrying & ~leaving  # a new array, because `equations` stores the last one
            equations.change(carrying)
            continue
        dual.move(np.maximum(z, 0.0))
        slack = dual.slack / unit
        if np.abs(slack[carrying]).max(initial=0.0) > MET * tolerance and centres < CENTRES:
            centres += 1
        else:
            joining = ~carrying & (slack < -tolerance)
            if not joining.any() or problem.is_infeasible(dual.q):
                break
            centres, carrying = 0, carrying | joining
            equations.change(carrying)
        equations.centre(dual.q, dual.slack)
    return Solution(dual.q, problem.residual(dual.q), equations.factorizations)
