"""The exact velocities of a step, by an independent library's interior point method, with an error bound.

Everything here is NumPy and independent of the kernels. A step is the convex problem (kernels/MODEL.md, eq.
10)

    min 1/2 (v - v*)^T M (v - v*)   subject to   J v <= b,   b = gap / dt,

with the free velocities v*, the contact masses M (eq. 17b), and a row of J for every pair of grains and for
every grain at every wall. In the scaled variable y = sqrt(M) (v - v*) / s, with s the largest entry of
sqrt(M) v*, and with rows of length 1, it is the projection of 0 onto a polyhedron: min 1/2 |y|^2 subject to A
y <= h. Any y that satisfies A y <= h and any multipliers z >= 0 bracket the minimum. Both functions are
strongly convex, so

    |y - y_exact|^2 <= |y + A^T z|^2 + 2 z^T (h - A y),

twice the duality gap (Boyd and Vandenberghe, Convex Optimization, 5.5.1 and 9.1.2). No other property of the
library's answer is trusted. To obtain a y that satisfies A y <= h to the last bit, the problem is solved
again with h reduced by slightly more than the violation of the first answer.

Coulomb's law is no convex problem, but it contains one (De Saxce and Feng 1998). Let s_c = mu |vt_c| be
frozen at the velocities that are to be checked. Then the velocities nearest to the free ones, in the mass
metric, with

    vn_c + mu |vt_c| <= gap_c / dt + s_c      for every contact c

are those that the checked velocities must be, if and only if these solve the step (eqs. 10 and 23). In the
plane every such constraint is two linear ones, vn_c +- mu vt_c <= gap_c / dt + s_c, so that the problem is
again a projection on a polyhedron. Unknowns are the velocities and the rim speed of every grain, with the
masses M, M and J / 2.
"""

from dataclasses import dataclass
from typing import NamedTuple

import clarabel
import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from warpgrains.base.arrays import FloatArray, IndexArray
from warpgrains.base.errors import SimulationError
from warpgrains.scene.scene import Scene
from warpgrains.scene.scheme import free_spin, free_velocity
from warpgrains.solver.exact.constraints import StepConstraints, every_wall
from warpgrains.solver.exact.projection import Projection, projection_of
from warpgrains.space.geometry import left_of

TOLERANCE = 1e-14  # requested from the library, which stops earlier if rounding prevents it
REGULARIZATION = 1e-12  # of the library's matrix; with the default, 1e-8, it stops at a gap of about 1e-6
ATTEMPTS = 5  # most attempts to find a point without violations
REACH = 1.5  # in known speeds: speed of a grain up to which the constraints are complete


@dataclass(frozen=True, eq=False)
class StepProblem:
    """Input of a step: its scene, and centers [m] and velocities [m/s] at its start, shape (n, 2)."""

    scene: Scene
    position: FloatArray
    velocity: FloatArray
    staggered: bool = False
    """Whether velocities are half a step behind the positions, see `State`."""
    spin: FloatArray | None = None
    """Angular velocities [rad/s], shape (n,); only with friction."""
    time: float = 0.0
    """Time of the start of the step [s]."""

    @property
    def free_velocity(self) -> FloatArray:
        """Velocities v* without contacts (eq. 2, or 16 and 17) [m/s], shape (n, 2)."""
        return free_velocity(self.scene, self.velocity, self.staggered, self.time)

    @property
    def free_rim(self) -> FloatArray:
        """Rim speeds u* without contacts (eq. 21) [m/s], shape (n,)."""
        spin = self.scene.spin if self.spin is None else self.spin
        return self.scene.radius * free_spin(self.scene, spin, self.staggered)

    def constraints(self, speed: FloatArray, sliding: FloatArray) -> StepConstraints:
        """Return the constraints J v <= b of all contacts that grains could close within the step.

        `speed` is an upper bound of the speed of each grain [m/s], shape (n,). The gaps at a round wall are
        those of grains that move with the velocities `sliding` [m/s], shape (n, 2) (eq. 18).
        """
        scene, position = self.scene, self.position
        pair = pairs_within(scene, position, scene.dt * speed)
        wall = every_wall(scene)
        every = StepConstraints.at(scene, (position, self.velocity), pair, wall, self.time)
        every = every.sliding(scene.dt * sliding)
        return every.only(every.gap_rate[len(pair) :] <= speed[every.wall[:, 0]])


def pairs_within(scene: Scene, position: FloatArray, reach: FloatArray) -> IndexArray:
    """Return the pairs i < j of grains whose gap is at most reach[i] + reach[j] [m], shape (m, 2)."""
    radius, places = scene.radius, scene.period.from_corner(position)
    around = cKDTree(places, boxsize=scene.period.lengths).query_ball_point(
        places, radius + radius.max() + 2.0 * reach
    )
    i = np.repeat(np.arange(len(position)), [len(found) for found in around])
    j = np.concatenate([np.array(found, dtype=np.int64) for found in around])
    pair = np.unique(np.sort(np.stack([i, j], axis=1)[i != j], axis=1), axis=0)
    i, j = pair.T
    return pair[scene.pair_frames(position, pair)[1] <= reach[i] + reach[j]]


class ExactStep(NamedTuple):
    """Exact velocities of a step, with a proven bound of their error."""

    velocity: FloatArray
    """Velocities [m/s], shape (n, 2); with friction, velocities and rim speed, shape (n, 3)."""
    error: float
    """Proven bound of the error of every component [m/s]."""


def solve_with_clarabel(projection: Projection) -> tuple[FloatArray, FloatArray]:
    """Solve a projection by clarabel; return its minimizer and its multipliers, negative ones set to 0."""
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


def solve_exactly(problem: StepProblem, motion: FloatArray) -> ExactStep:
    """Solve a step as a convex problem over all pairs and walls.

    `motion` is an estimate of the velocities, (n, 2), or with friction of velocities and rim speeds, (n, 3)
    [m/s]. It limits the search for pairs. Gaps at a round wall and the frozen slip follow from it, so that
    with these the result is exact only if it equals the estimate. Raises SimulationError if there is no
    solution, or clarabel finds none.
    """
    scene, velocity, free = problem.scene, motion[:, :2], problem.free_velocity
    known = free, velocity, problem.velocity  # contacts bounce by the last
    speed = REACH * np.max([np.hypot(*one.T) for one in known], axis=0)
    root = np.sqrt(scene.contact_mass)[:, np.newaxis]
    if scene.has_friction:
        root = np.column_stack([root, root, np.sqrt(0.5 * scene.rim_mass)])
        free = np.column_stack([free, problem.free_rim])
    while True:
        every = problem.constraints(speed, velocity)
        if scene.has_friction:
            step = projection_with_frozen_slip(every, motion, root, free)
        else:
            step = projection_of(every, free)
        scale = float(np.abs(step.free).max()) or float(root.max())
        bound = (step.bound - step.rows @ step.free) / scale
        y, error = _project(step.rows, bound)
        unit = scale / root
        exact = ExactStep(free + unit * y.reshape(free.shape), error * float(unit.max()))
        found = np.hypot(*exact.velocity[:, :2].T)
        if (found <= speed).all():  # grains without a constraint cannot reach one
            return exact
        speed = np.maximum(speed, REACH * found)


def _project(rows: sparse.csr_array, bound: FloatArray) -> tuple[FloatArray, float]:
    """Return a y that satisfies rows y <= bound and is nearly the shortest such y.

    The second result is a proven bound of the distance of the two. SimulationError if no y is found.
    """
    nothing = np.zeros(rows.shape[1])
    if not (bound < 0.0).any():
        return nothing, 0.0
    tightening = 0.0
    for _ in range(ATTEMPTS):
        y, z = solve_with_clarabel(Projection(rows, bound - tightening, nothing, np.ones_like(bound)))
        slack = bound - rows @ y
        # rounding of a sum of at most four products, and of a difference
        rounding = np.finfo(float).eps * (3.0 * abs(rows) @ abs(y) + abs(bound))
        short = np.max(rounding - slack)
        if short <= 0.0:
            gap = np.sum((y + rows.T @ z) ** 2) + 2.0 * z @ (slack + rounding)
            return y, float(np.sqrt(gap))
        tightening += 2.0 * short
    raise SimulationError("the exact velocities were not found: no solution satisfies every gap")


def projection_with_frozen_slip(
    step: StepConstraints, motion: FloatArray, root: FloatArray, free: FloatArray
) -> Projection:
    """Return the projection problem of a step, with slip frozen at that of `motion` (head of this module).

    `motion` and `free` hold velocities and rim speeds [m/s], and `root` the square roots of their masses,
    shape (n, 3) each. The unknown is y = root * (velocity, rim speed).
    """
    friction, surface = step.friction, step.surface_speed
    normal, slip = _rows(step, step.normal, 0.0), _rows(step, left_of(step.normal), 1.0)
    bound = step.gap_rate + friction * np.abs(slip @ motion.ravel() - surface)
    rough, moved = slip.multiply(friction[:, np.newaxis]), friction * surface
    both = sparse.vstack([normal + rough, normal - rough])
    rows = sparse.csr_array(both @ sparse.diags_array(1.0 / root.ravel()))
    unit = 1.0 / np.sqrt(rows.multiply(rows).sum(axis=1))
    scaled = sparse.csr_array(sparse.diags_array(unit) @ rows)
    return Projection(scaled, unit * np.append(bound + moved, bound - moved), (root * free).ravel(), unit)


def _rows(step: StepConstraints, along: FloatArray, rim: float) -> sparse.csr_array:
    """Return the matrix that maps velocities and rim speeds of all grains to contact velocities, (m, 3 n).

    Row c yields the relative velocity of contact c along the vector along[c], plus `rim` times the rim
    speeds.
    """
    contacts, pairs = len(step.first), len(step.second)
    own = np.column_stack([along, np.full(contacts, rim)])
    entry = np.concatenate([own, own[:pairs] * np.array([-1.0, -1.0, 1.0])])
    row = np.repeat(np.append(np.arange(contacts), np.arange(pairs)), 3)
    column = 3 * np.append(step.first, step.second)[:, np.newaxis] + np.arange(3)
    shape = (contacts, 3 * step.scene.n)
    return sparse.csr_array((entry.ravel(), (row, column.ravel())), shape=shape)
