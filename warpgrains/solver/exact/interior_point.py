"""Proximal interior point method for a step's convex problem (projection.py), from given corrections.

The solution satisfies

    u = u0 - A^T q,   s = b - A u,   q, s >= 0,   q_c s_c = 0.

The last equation is relaxed to q_c s_c = mu, and mu is driven to 0 by Newton steps with Mehrotra's predictor
and corrector (1992). Each step factors one matrix, I + A^T diag(q / (s + q / rho)) A. The proximal term rho
(Rockafellar 1976) bounds the matrix if contacts are redundant; it changes the path, but not the solution.
Corrections after sweeps are nearly right, but on the boundary, where only short steps are possible. The start
is therefore centered: q and s move to q_c s_c = mu with q - s unchanged. This is repeated after a short step.
"""

from typing import NamedTuple

import numpy as np

from warpgrains.base.arrays import FloatArray
from warpgrains.solver.exact.projection import PROXIMITY, NormalMatrix, Projection, Solution

FIRST = 30.0  # initial sqrt(mu), in natural residuals
WIDER = 100.0  # mu after the first short step, in means of q s
GROWTH = 3.0  # growth of WIDER after each further short step, so that the iteration cannot cycle
SHORT = 0.2  # step length below which the iteration restarts with a larger mu
NEARLY = 0.999  # longest step, as a fraction of the distance to the boundary
MOST = 100  # number of factorizations; a pile whose top is 10,000 times heavier has needed 51
STALLED = 25  # number of steps without halving the residual after which the method ends
NEGLIGIBLE = 0.02  # in tolerances: contacts with smaller corrections are open


class _Iterate(NamedTuple):
    """A point (u, q, s) of the iteration, with q, s > 0, or a direction (du, dq, ds)."""

    u: FloatArray
    q: FloatArray
    s: FloatArray

    def moved(self, a: float, way: "_Iterate") -> "_Iterate":
        """Return the point after a step of length a along the direction `way`."""
        return _Iterate(*(x + a * dx for x, dx in zip(self, way, strict=True)))

    def longest(self, way: "_Iterate") -> float:
        """Return the longest step <= 1 along the direction `way` that keeps q and s positive."""
        return float(1.0 / max(1.0, (-way.q / self.q).max(), (-way.s / self.s).max()))

    def centred(self, mu: float) -> "_Iterate":
        """Return the point with the same q - s for which q, s > 0 and q_c s_c = mu at every contact.

        The smaller one of q_c and s_c is computed as mu over the larger one, to avoid cancelation.
        """
        t = self.q - self.s
        large = 0.5 * (np.sqrt(t * t + 4.0 * mu) + np.abs(t))
        small = mu / large
        return _Iterate(self.u, np.where(t > 0.0, large, small), np.where(t > 0.0, small, large))

    def gap(self) -> float:
        """Return the mean of q_c s_c over all contacts."""
        return float((self.q * self.s).sum()) / len(self.q)


def _begin(problem: Projection, q: FloatArray) -> tuple[_Iterate, float]:
    """Return the start of the iteration, which is centered from scaled corrections q, and its mu.

    mu grows with the residual of q.
    """
    across = problem.rows.T
    t = problem.target(q)
    error = np.maximum(t, 0.0) - q
    spread = across @ error
    mu = FIRST**2 * float((error * error).sum() + (spread * spread).sum()) / len(q)
    return _Iterate(problem.free - across @ q, t, np.zeros_like(t)).centred(mu), mu


def _direction(problem: Projection, matrix: NormalMatrix, at: _Iterate) -> _Iterate:
    """Return Mehrotra's predictor-corrector direction at a point."""
    rows, b, free, *_ = problem
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


def solve(
    problem: Projection, matrix: NormalMatrix, q: FloatArray, tolerance: float, near: float = 0.0
) -> Solution:
    """Solve a step, from the scaled corrections q of some sweeps, to a natural residual of `tolerance` [m/s].

    For the scaling, see projection.py. If this residual is not reached, the best corrections are returned,
    which may be the given ones. Once the residual is at most `near` [m/s], a step shorter than `SHORT` ends
    the iteration. It also ends if all q_c s_c are 0.
    """
    unit = problem.unit
    matrix.take(problem.rows)
    best, least = q, problem.residual(q)
    lowest, stalled = np.inf, 0
    at, mu = _begin(problem, q)
    count, wider = 0, WIDER
    while count < MOST and at.gap() > 0.0 and not problem.is_infeasible(at.q):
        count += 1
        way = _direction(problem, matrix, at)
        a = at.longest(way)
        if a < SHORT:
            if least <= near:
                break
            mu = wider * max(mu, at.gap())
            wider *= GROWTH
            at = at.moved(a, way).centred(mu)
            lowest, stalled = np.inf, 0
            continue
        mu, a = 0.0, min(1.0, NEARLY * a)
        at = at.moved(a, way)
        kept = np.where((at.q < at.s) & (at.q < NEGLIGIBLE * tolerance * unit), 0.0, at.q)
        residual = problem.residual(kept)
        if residual < least:
            best, least = kept, residual
        stalled = 0 if residual <= 0.5 * lowest else stalled + 1
        lowest = min(lowest, residual)
        if least <= tolerance or stalled == STALLED or not np.isfinite(residual):
            break
    return Solution(best, least, count)
