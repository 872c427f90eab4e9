"""The exact velocities of a step, by an interior point method of an independent library, and their error.

In NumPy, apart from the kernels, a step is the convex problem (kernels/MODEL.md, eq. 10)

    min 1/2 (v - v*)^T M (v - v*)   subject to   J v <= b,   b = gap / dt,

v* the free velocities, M the contact masses (eq. 17b), a row of J for every pair of grains and for every
grain at every wall. In units of its own, y = sqrt(M) (v - v*) / s with s the largest entry of sqrt(M) v*, and
with rows of length 1, it is the projection of 0 onto a polyhedron: min 1/2 |y|^2 subject to A y <= h. Any y
that satisfies A y <= h and any multipliers z >= 0 bracket the minimum; both functions are strongly convex, so

    |y - y_exact|^2 <= |y + A^T z|^2 + 2 z^T (h - A y),

twice the duality gap (Boyd and Vandenberghe, Convex Optimization, 5.5.1 and 9.1.2). This is all that is
believed of the library's answer. To have a y that satisfies A y <= h to the last bit, the problem is solved
again with an h that is smaller by a little more than what the first answer violates.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import clarabel
import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.errors import SimulationError
from warpgrains.scene.geometry import pair_gaps
from warpgrains.scene.scene import Scene
from warpgrains.scene.scheme import free_velocity
from warpgrains.solver import interior_point
from warpgrains.solver.constraints import StepConstraints, every_wall
from warpgrains.solver.projection import NormalMatrix, Projection, projection_of

TOLERANCE = 1e-14  # asked of the library, which stops where rounding does not let it go further
REGULARIZATION = 1e-12  # of its matrix: with its default, 1e-8, it stops at a gap of some 1e-6
ATTEMPTS = 5  # at a point that violates nothing
REACH = 1.5  # of the speeds that are known: how fast a grain may be before constraints must be added


@dataclass(frozen=True, eq=False)
class StepProblem:
    """A step from where it starts: centres [m] and velocities [m/s], shape (n, 2), and of which moment."""

    scene: Scene
    position: FloatArray
    velocity: FloatArray
    staggered: bool = False
    """As in `State`."""

    @property
    def free_velocity(self) -> FloatArray:
        """v* (eq. 2, or 16 and 17) [m/s], shape (n, 2)."""
        return free_velocity(self.scene, self.velocity, self.staggered)

    def projection(self, speed: FloatArray, sliding: FloatArray) -> Projection:
        """Return it with all constraints that can be violated if no grain is faster than its speed [m/s].

        Where the outer wall is round, its gaps are those of grains that slide with these velocities [m/s],
        shape (n, 2) (eq. 18).
        """
        scene, position = self.scene, self.position
        pair = pairs_within(position, scene.radius, scene.dt * speed)
        wall = every_wall(scene, np.arange(scene.n))
        every = StepConstraints.at(scene, position, pair, wall).sliding(scene.dt * sliding)
        near = every.only(every.gap_rate[len(pair) :] <= speed[every.wall_grain])
        return projection_of(near, self.free_velocity)


def pairs_within(position: FloatArray, radius: FloatArray, reach: FloatArray) -> IndexArray:
    """Return the pairs i < j of discs whose gap is at most the sum of their reaches, shape (m, 2).

    Each is found from the disc that reaches further, so that one with a long reach costs only its own search.
    """
    around = cKDTree(position).query_ball_point(position, radius + radius.max() + 2.0 * reach)
    i = np.repeat(np.arange(len(position)), [len(found) for found in around])
    j = np.concatenate([np.array(found, dtype=np.int64) for found in around])
    pair = np.unique(np.sort(np.stack([i, j], axis=1)[i != j], axis=1), axis=0)
    i, j = pair.T
    return pair[pair_gaps(position, radius, i, j) <= reach[i] + reach[j]]


class ExactStep(NamedTuple):
    """The velocities that a step has, as far as they can be proven."""

    velocity: FloatArray
    """[m/s], shape (n, 2)."""
    error: float
    """What no component of them is further than from the exact ones [m/s]."""


Witness = Callable[[Projection], tuple[FloatArray, FloatArray]]
"""What finds a point y near 0 that satisfies all constraints, and multipliers z >= 0."""


def solve_exactly(problem: StepProblem, velocity: FloatArray, witness: Witness | None = None) -> ExactStep:
    """Solve a step as a convex problem over all pairs and walls.

    Velocities that the exact ones are expected near spare a search [m/s], shape (n, 2). A round wall has the
    gaps that it leaves to these: they solve the step if they are what is found. The witness is clarabel, or
    another.

    Raises
    ------
    SimulationError
        No velocities satisfy all constraints, or the library finds none that do.
    """
    speed = REACH * np.maximum(np.hypot(*problem.free_velocity.T), np.hypot(*velocity.T))
    while True:
        exact = _solve(problem, problem.projection(speed, velocity), witness or _ask)
        found = np.hypot(*exact.velocity.T)
        if (found <= speed).all():  # whoever is not constrained is out of reach
            return exact
        speed = np.maximum(speed, REACH * found)


def _solve(problem: StepProblem, step: Projection, witness: Witness) -> ExactStep:
    root = np.sqrt(np.repeat(problem.scene.contact_mass, 2))
    scale = float(np.abs(step.free).max()) or float(root.max())
    bound = (step.bound - step.rows @ step.free) / scale
    y, error = _project(Projection(step.rows, bound, np.zeros_like(step.free), np.ones_like(bound)), witness)
    unit = scale / root
    velocity = problem.free_velocity + (unit * y).reshape(-1, 2)
    return ExactStep(velocity, error * float(unit.max()))


def _project(projection: Projection, witness: Witness) -> tuple[FloatArray, float]:
    """Return a point of the polyhedron, and how far it may be from the one nearest to 0."""
    rows, bound = projection.rows, projection.bound
    if not (bound < 0.0).any():
        return projection.free, 0.0
    tightening = 0.0
    for _ in range(ATTEMPTS):
        y, z = witness(projection._replace(bound=bound - tightening))
        slack = bound - rows @ y
        # of a sum of at most four products, and of a difference
        rounding = np.finfo(float).eps * (3.0 * abs(rows) @ abs(y) + abs(bound))
        short = np.max(rounding - slack)
        if short <= 0.0:
            gap = np.sum((y + rows.T @ z) ** 2) + 2.0 * z @ (slack + rounding)
            return y, float(np.sqrt(gap))
        tightening += 2.0 * short
    raise SimulationError("the exact velocities were not found: no solution satisfies every gap")


def _ask(projection: Projection) -> tuple[FloatArray, FloatArray]:
    """Return the library's y, and its z where it is not negative."""
    unknowns, rows = len(projection.free), sparse.csc_array(projection.rows)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TOLERANCE
    settings.equilibrate_enable = False  # every row has length 1
    settings.static_regularization_constant = REGULARIZATION
    square = sparse.csc_array(sparse.eye_array(unknowns))
    cone = [clarabel.NonnegativeConeT(len(projection.bound))]
    answer = clarabel.DefaultSolver(square, projection.free, rows, projection.bound, cone, settings).solve()
    if "Infeasible" in str(answer.status):
        raise SimulationError("no velocities satisfy every gap of the step: the grains do not fit")
    return np.array(answer.x), np.maximum(answer.z, 0.0)


def own_witness(projection: Projection) -> tuple[FloatArray, FloatArray]:
    """Return y and z by the interior point method of the package, from nothing."""
    nothing = np.zeros_like(projection.bound)
    z = interior_point.solve(projection, NormalMatrix(projection.rows), nothing, TOLERANCE).q
    return -(projection.rows.T @ z), z
