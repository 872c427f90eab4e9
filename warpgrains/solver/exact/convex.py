"""The host's part of the method "exact" without friction, for steps in which sweeps converge too slowly.

The contacts and their corrections are those at which the kernels stopped (listed.py). The solution of
`active_set`, or of `interior_point` if the first fails, replaces the corrections. The kernels then recompute
velocities, measure the residual and check the list (kernels/sweeps/residual.py).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from warpgrains.base.arrays import FloatArray
from warpgrains.kernels.record import HostRequest, Phase
from warpgrains.solver.exact import active_set, interior_point
from warpgrains.solver.exact.bordered import BorderedMatrix
from warpgrains.solver.exact.constraints import StepConstraints
from warpgrains.solver.exact.listed import ListedContacts
from warpgrains.solver.exact.projection import NormalMatrix, Projection, Solution, projection_of

if TYPE_CHECKING:
    from warpgrains.solver.records import SceneRecords

ASKED = 0.5  # requested residual, in tolerances; leaves a margin for rounding in the kernels
BETTER = 0.01  # residual that an answer must reach, in residuals after the sweeps
NEAR = 1e-3  # residual below which rounding makes interior point steps short, in residuals after the sweeps
MOST = 100  # number of factorizations of a step after which no other problem is begun


class Matrices(NamedTuple):
    """Matrices of the active-set method and of the interior point method, kept to reuse their memory."""

    active: BorderedMatrix
    interior: NormalMatrix


def solve(problem: Projection, matrices: Matrices, q: FloatArray, tolerance: float) -> Solution:
    """Solve a step, from the scaled corrections q of some sweeps (projection.py), by the active-set method.

    If it fails, the interior point method approaches the solution. If rounding stops that method too, as with
    very different masses, the active-set method continues from its result. Return the best result, which
    misses `tolerance` [m/s] if all of them do.
    """
    first = active_set.solve(problem, matrices.active, q, tolerance)
    if first.residual <= tolerance or problem.is_infeasible(first.q):
        return first
    before = problem.residual(q)
    start = first.q if first.residual < before else q
    inner = interior_point.solve(problem, matrices.interior, start, tolerance, NEAR * before)
    found = [first, inner]
    if tolerance < inner.residual <= BETTER * before:
        found.append(active_set.solve(problem, matrices.active, inner.q, tolerance))
    best = min(found, key=lambda one: one.residual)
    return best._replace(factorizations=sum(one.factorizations for one in found))


class ConvexSolver:
    """Host solver for the steps without friction of scene k."""

    def __init__(self, records: SceneRecords, k: int):
        self._records, self._k = records, k
        self._matrices = Matrices(BorderedMatrix(), NormalMatrix())

    def solve(self) -> None:
        """Replace the corrections of the waiting step if better ones are found, and let the kernels continue.

        The gaps of a round wall depend on the velocities (MODEL.md, eq. 18). Each problem takes the gaps of
        the last answer, until an answer satisfies the gaps for its own velocities.
        """
        contacts, record = ListedContacts(self._records, self._k), self._records.host[self._k]
        constraints = contacts.constraints
        free = self._records.array(self._k, "grains.free_velocity")[constraints.body]
        problem = projection_of(constraints, free)
        unit = problem.unit * constraints.compliance
        tolerance = ASKED * self._records.scenes[self._k].tolerance
        q = unit * np.maximum(contacts.read("dv"), 0.0)
        problem = _with_gaps_of(problem, constraints, q)
        before = left = problem.residual(q)
        while left > tolerance and record["step"]["factorizations"] < MOST:
            found = solve(problem, self._matrices, q, tolerance)
            record["step"]["factorizations"] += found.factorizations
            problem = _with_gaps_of(problem, constraints, found.q)
            last, residual = left, problem.residual(found.q)
            if residual < left:
                q, left = found.q, residual
            if found.residual > tolerance or residual > 0.5 * last:
                break
        is_better = before > tolerance and left <= max(BETTER * before, tolerance)
        if is_better:
            contacts.write("dv", q / unit)
        if left > tolerance or not is_better:
            record["step"]["host_request"] = HostRequest.NEVER  # another attempt would not improve the answer
        record["control"]["phase"], record["control"]["resuming"] = Phase.ANSWERED, not is_better


def _with_gaps_of(problem: Projection, constraints: StepConstraints, q: FloatArray) -> Projection:
    """Return the problem with the gaps at round walls that follow from corrections q.

    The gaps are those of grains that move with the velocities of these corrections.
    """
    u = (problem.free - problem.rows.T @ q).reshape(-1, 2)
    move = constraints.scene.dt * (u / np.sqrt(constraints.mass)[:, np.newaxis])
    return problem._replace(bound=problem.unit * constraints.sliding(move).gap_rate)
