"""The host's part of the method "exact": factorizations for steps in which sweeps converge too slowly.

The contacts and their corrections are those at which the kernels stopped. The solution of `active_set`, or of
`interior_point` if the first fails, replaces the corrections. The kernels then recompute velocities,
measure the residual and check the list (kernels/residual.py).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.kernels.record import Phase
from warpgrains.solver import active_set, interior_point
from warpgrains.solver.bordered import BorderedMatrix
from warpgrains.solver.constraints import StepConstraints
from warpgrains.solver.loading import listed_pairs, listed_walls
from warpgrains.solver.projection import NormalMatrix, Projection, Solution, projection_of

if TYPE_CHECKING:
    from warpgrains.solver.records import SceneRecords

ASKED = 0.5  # of the tolerance; leaves a margin for rounding in the kernels
BETTER = 0.01  # of the residual after the sweeps: an answer must be below
NEAR = 1e-3  # of that residual: below, rounding makes steps of the interior point method short
MOST = 100  # factorizations of a step after which no other problem is begun


class Matrices(NamedTuple):
    """Matrices of the two methods, whose memory is used again."""

    active: BorderedMatrix
    interior: NormalMatrix


def solve(problem: Projection, matrices: Matrices, q: FloatArray, tolerance: float) -> Solution:
    """Solve a step from the corrections of some sweeps by the active-set method.

    If it fails, the interior point method comes near, and where rounding stops that, as with masses that
    are far apart, the active-set method ends from there.
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


class ExactSolver:
    """Host solver for the steps of scene k of some records."""

    def __init__(self, records: SceneRecords, k: int):
        self._records, self._k = records, k
        self._matrices = Matrices(BorderedMatrix(), NormalMatrix())

    def solve(self) -> None:
        """Replace the corrections of the step if better ones are found, and let the kernels continue.

        The gaps of a round wall depend on the velocities (MODEL.md, eq. 18). They are iterated: each problem
        takes the gaps of the last answer, until an answer satisfies its own gaps.
        """
        contacts, record = FrozenContacts(self._records, self._k), self._records.host[self._k]
        tolerance, q = ASKED * self._records.scenes[self._k].tolerance, contacts.corrections()
        problem = contacts.problem_at(q)
        before = left = problem.residual(q)
        while left > tolerance and record["step"]["factorizations"] < MOST:
            found = solve(problem, self._matrices, q, tolerance)
            record["step"]["factorizations"] += found.factorizations
            problem = contacts.problem_at(found.q)
            last, residual = left, problem.residual(found.q)
            if residual < left:
                q, left = found.q, residual
            if found.residual > tolerance or residual > 0.5 * last:
                break
        is_better = before > tolerance and left <= max(BETTER * before, tolerance)
        if is_better:
            contacts.write(q)
        if left > tolerance:
            record["step"]["patience"] = 0  # the methods have done what they can
        record["control"]["phase"] = Phase.CORRECTED if is_better else Phase.DECLINED


class FrozenContacts:
    """The listed contacts of a step: pairs in lexicographic order, then wall contacts ordered by wall.

    Attributes
    ----------
    problem : Projection
        The step's problem, with the gaps at the start of the step.
    """

    def __init__(self, records: SceneRecords, k: int):
        (pair, self._place), self._dv = listed_pairs(records, k), records.array(k, "contacts.dv")
        (listed, index), scene = listed_walls(records, k), records.scenes[k]
        bodies = scene.bodies
        sides = [(number, bodies.of(np.array(number)) == listed[:, 1]) for number in scene.wall_numbers]
        self._at_wall = np.concatenate([index[own] for _, own in sides])
        grain = np.concatenate([listed[own, 0] for _, own in sides])
        wall = np.stack([grain, np.repeat(scene.wall_numbers, [own.sum() for _, own in sides])], axis=1)
        self._sign = bodies.sign(wall[:, 1])
        time = scene.time_after(int(records.host["steps"][k]) + 1)
        self._constraints = StepConstraints.at(scene, records.array(k, "grains.position"), pair, wall, time)
        self.problem = projection_of(self._constraints, records.array(k, "grains.free_velocity"))

    def problem_at(self, q: FloatArray) -> Projection:
        """Return the step's problem, with the wall gaps for the velocities that corrections q lead to."""
        rows, _, free, unit, _ = self.problem
        scene = self._constraints.scene
        velocity = (free - rows.T @ q).reshape(-1, 2) / np.sqrt(scene.contact_mass)[:, np.newaxis]
        return self.problem._replace(bound=unit * self._constraints.sliding(scene.dt * velocity).gap_rate)

    def corrections(self) -> FloatArray:
        """Return the corrections in the units of the problem."""
        walls = np.maximum(self._sign * self._dv[self._at_wall], 0.0)
        return self.problem.unit * np.concatenate([self._dv[self._place], walls])

    def write(self, q: FloatArray) -> None:
        """Write corrections, in the units of the problem, to the contacts."""
        pairs, walls = np.split(q / self.problem.unit, [len(self._place)])
        self._dv[self._place] = pairs
        self._dv[self._at_wall] = 0.0
        np.add.at(self._dv, self._at_wall, self._sign * walls)
