"""The exact velocities of a step, by an interior point method of an independent library, and their error.

In units of its own, y = sqrt(M) (v - v*) / s with s the largest entry of sqrt(M) v*, and with rows of length
1, a step is the projection of 0 onto a polyhedron: min 1/2 |y|^2 subject to A y <= h. Any y that satisfies
A y <= h and any multipliers z >= 0 bracket the minimum; both functions are strongly convex, so

    |y - y_exact|^2 <= |y + A^T z|^2 + 2 z^T (h - A y),

twice the duality gap (Boyd and Vandenberghe, Convex Optimization, 5.5.1 and 9.1.2). This is all that is
believed of the library's answer. To have a y that satisfies A y <= h to the last bit, the problem is solved
again with an h that is smaller by a little more than what the first answer violates.
"""

from typing import NamedTuple

import clarabel
import numpy as np
from scipy import sparse

from warpgrains.analysis.problem import LinearConstraints, StepProblem
from warpgrains.arrays import FloatArray
from warpgrains.errors import SimulationError

TOLERANCE = 1e-14  # asked of the library, which stops where rounding does not let it go further
REGULARIZATION = 1e-12  # of its matrix: with its default, 1e-8, it stops at a gap of some 1e-6
ATTEMPTS = 5  # at a point that violates nothing
REACH = 1.5  # of the speeds that are known: how fast a grain may be before constraints must be added


class ExactStep(NamedTuple):
    """The velocities that a step has, as far as they can be proven."""

    velocity: FloatArray
    """[m/s], shape (n, 2)."""
    error: float
    """What no component of them is further than from the exact ones [m/s]."""


class _Projection(NamedTuple):
    """min 1/2 |y|^2 subject to A y <= h."""

    rows: sparse.csc_array
    bound: FloatArray

    def slack(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return h - A y, and its rounding: of a sum of at most four products, and of a difference."""
        eps = np.finfo(float).eps
        return self.bound - self.rows @ y, eps * (3.0 * abs(self.rows) @ abs(y) + abs(self.bound))


def solve_exactly(problem: StepProblem, velocity: FloatArray) -> ExactStep:
    """Solve a step as a convex problem over all pairs and walls.

    Velocities that the exact ones are expected near spare a search [m/s], shape (n, 2).

    Raises
    ------
    SimulationError
        No velocities satisfy all constraints, or the library finds none that do.
    """
    speed = REACH * np.maximum(np.hypot(*problem.free_velocity.T), np.hypot(*velocity.T))
    while True:
        exact = _solve(problem, problem.constraints(speed))
        found = np.hypot(*exact.velocity.T)
        if (found <= speed).all():  # whoever is not constrained is out of reach
            return exact
        speed = np.maximum(speed, REACH * found)


def _solve(problem: StepProblem, constraints: LinearConstraints) -> ExactStep:
    """Solve a step for given constraints."""
    root = np.sqrt(np.repeat(problem.scene.mass, 2))
    free = problem.free_velocity.ravel()
    scale = float(np.abs(root * free).max()) or float(root.max())
    rows = constraints.rows @ sparse.diags_array(1.0 / root)
    length = sparse.linalg.norm(rows, axis=1)
    rows = sparse.csc_array(sparse.diags_array(1.0 / length) @ rows)
    bound = (constraints.bound - constraints.rows @ free) / (length * scale)
    y, error = _project(_Projection(rows, bound))
    unit = scale / root
    return ExactStep((free + unit * y).reshape(-1, 2), error * float(unit.max()))


def _project(projection: _Projection) -> tuple[FloatArray, float]:
    """Return a point of the polyhedron, and how far it may be from the one nearest to 0."""
    if not (projection.bound < 0.0).any():
        return np.zeros(projection.rows.shape[1]), 0.0
    tightening = 0.0
    for _ in range(ATTEMPTS):
        y, z = _ask(projection._replace(bound=projection.bound - tightening))
        slack, rounding = projection.slack(y)
        short = np.max(rounding - slack)
        if short <= 0.0:
            gap = np.sum((y + projection.rows.T @ z) ** 2) + 2.0 * z @ (slack + rounding)
            return y, float(np.sqrt(gap))
        tightening += 2.0 * short
    raise SimulationError("the exact velocities were not found: no answer of clarabel satisfies every gap")


def _ask(projection: _Projection) -> tuple[FloatArray, FloatArray]:
    """Return the library's y, and its z where it is not negative."""
    unknowns = projection.rows.shape[1]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TOLERANCE
    settings.equilibrate_enable = False  # every row has length 1
    settings.static_regularization_constant = REGULARIZATION
    square = sparse.csc_array(sparse.eye_array(unknowns))
    cone = [clarabel.NonnegativeConeT(len(projection.bound))]
    answer = clarabel.DefaultSolver(
        square, np.zeros(unknowns), projection.rows, projection.bound, cone, settings
    ).solve()
    if "Infeasible" in str(answer.status):
        raise SimulationError("no velocities satisfy every gap of the step: the grains do not fit")
    return np.array(answer.x), np.maximum(answer.z, 0.0)
