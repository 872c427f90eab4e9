"""Velocities that solve a step with friction exactly, once the slip of its contacts is frozen.

Coulomb's law is no convex problem, but it contains one (De Saxce and Feng 1998). Let s_c = mu |vt_c| be
frozen at the velocities that are to be checked. Then the velocities nearest to the free ones, in the mass
metric, with

    vn_c + mu |vt_c| <= gap_c / dt + s_c      for every contact c

are those that the checked velocities must be, if and only if these solve the step (kernels/MODEL.md, eqs. 10
and 23). In the plane every such constraint is two linear ones, vn_c +- mu vt_c <= gap_c / dt + s_c, so that
the problem is a projection on a polyhedron, as without friction (exact_step.py). Unknowns are the velocities
and the rim speed of every grain, with the masses M, M and J / 2.
"""

import numpy as np
from scipy import sparse

from warpgrains.analysis.exact_step import REACH, ExactStep, StepProblem, Witness, solve_projection
from warpgrains.arrays import FloatArray, Indices
from warpgrains.solver.constraints import StepConstraints
from warpgrains.solver.projection import Projection


def solve_with_frozen_slip(problem: StepProblem, motion: FloatArray, witness: Witness) -> ExactStep:
    """Solve a step with friction, the slip of its contacts frozen at a motion.

    `motion` holds the velocities and rim speeds to be checked [m/s], shape (n, 3), as does the result.

    Raises
    ------
    SimulationError
        No velocities satisfy all constraints, or the library does not find any.
    """
    velocity, free = motion[:, :2], np.column_stack([problem.free_velocity, problem.free_rim])
    speed = REACH * np.maximum(np.hypot(*problem.free_velocity.T), np.hypot(*velocity.T))
    scene = problem.scene
    mass = np.column_stack([scene.contact_mass, scene.contact_mass, 0.5 * scene.rim_mass])
    while True:
        step = _projection(problem.constraints(speed, velocity), motion, np.sqrt(mass).ravel(), free.ravel())
        exact = solve_projection(step, np.sqrt(mass), free, witness)
        found = np.hypot(*exact.velocity[:, :2].T)
        if (found <= speed).all():
            return exact
        speed = np.maximum(speed, REACH * found)


def _projection(step: StepConstraints, motion: FloatArray, root: FloatArray, free: FloatArray) -> Projection:
    """Return the step as a projection onto a polyhedron, in y = sqrt(mass) (velocity, rim speed)."""
    scene, pairs = step.scene, len(step.second)
    n = len(motion)
    tangent = np.stack([-step.normal[:, 1], step.normal[:, 0]], axis=1)
    friction = np.append(np.full(pairs, scene.friction), np.array(scene.wall_frictions)[step.wall[:, 1]])
    surface = np.append(np.zeros(pairs), scene.wall_speeds(step.position, step.wall, step.time)[:, 1])
    normal, slip = _rows(step, step.normal, 0.0, n), _rows(step, tangent, 1.0, n)
    bound = step.gap_rate + friction * np.abs(slip @ motion.ravel() - surface)
    sides = [
        (normal + sign * slip.multiply(friction[:, np.newaxis]), sign * friction * surface)
        for sign in (1.0, -1.0)
    ]
    rows = sparse.csr_array(sparse.vstack([side for side, _ in sides]) @ sparse.diags_array(1.0 / root))
    unit = 1.0 / np.sqrt(rows.multiply(rows).sum(axis=1))
    scaled = sparse.csr_array(sparse.diags_array(unit) @ rows)
    return Projection(
        scaled, unit * np.concatenate([bound + offset for _, offset in sides]), root * free, unit
    )


def _rows(step: StepConstraints, along: FloatArray, rim: float, n: int) -> sparse.csr_array:
    """Return the matrix that takes (v, u) of all grains to velocities of contacts along some directions."""
    pairs, contacts = len(step.second), len(step.first)
    own, other = (
        np.hstack([along, np.full((contacts, 1), rim)]),
        np.hstack([-along[:pairs], np.full((pairs, 1), rim)]),
    )
    row = np.concatenate([np.repeat(np.arange(contacts), 3), np.repeat(np.arange(pairs), 3)])
    column = np.concatenate([_columns(step.first).ravel(), _columns(step.second).ravel()])
    return sparse.csr_array(
        (np.concatenate([own.ravel(), other.ravel()]), (row, column)), shape=(contacts, 3 * n)
    )


def _columns(grain: Indices) -> Indices:
    return 3 * grain[:, np.newaxis] + np.arange(3)
