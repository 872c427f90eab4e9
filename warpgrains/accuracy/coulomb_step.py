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

from warpgrains.arrays import FloatArray
from warpgrains.scene.geometry import left_of
from warpgrains.solver.constraints import StepConstraints
from warpgrains.solver.projection import Projection


def projection_with_frozen_slip(
    step: StepConstraints, motion: FloatArray, root: FloatArray, free: FloatArray
) -> Projection:
    """Return the step as a projection onto a polyhedron, in y = root (velocity, rim speed).

    `motion` holds the velocities and rim speeds to be checked, and `free` those before contacts act [m/s].
    Their shape is that of the roots of the masses, (n, 3).
    """
    scene, pairs = step.scene, len(step.second)
    friction = np.append(np.full(pairs, scene.friction), np.array(scene.wall_frictions)[step.wall[:, 1]])
    surface = np.append(np.zeros(pairs), scene.wall_speeds(step.position, step.wall, step.time)[:, 1])
    normal, slip = _rows(step, step.normal, 0.0), _rows(step, left_of(step.normal), 1.0)
    bound = step.gap_rate + friction * np.abs(slip @ motion.ravel() - surface)
    rough, moved = slip.multiply(friction[:, np.newaxis]), friction * surface
    both = sparse.vstack([normal + rough, normal - rough])
    rows = sparse.csr_array(both @ sparse.diags_array(1.0 / root.ravel()))
    unit = 1.0 / np.sqrt(rows.multiply(rows).sum(axis=1))
    scaled = sparse.csr_array(sparse.diags_array(unit) @ rows)
    return Projection(scaled, unit * np.append(bound + moved, bound - moved), (root * free).ravel(), unit)


def _rows(step: StepConstraints, along: FloatArray, rim: float) -> sparse.csr_array:
    """Return the matrix that takes (v, u) of all grains to velocities of contacts along some directions."""
    contacts, pairs = len(step.first), len(step.second)
    own = np.column_stack([along, np.full(contacts, rim)])
    entry = np.concatenate([own, own[:pairs] * np.array([-1.0, -1.0, 1.0])])
    row = np.repeat(np.append(np.arange(contacts), np.arange(pairs)), 3)
    column = 3 * np.append(step.first, step.second)[:, np.newaxis] + np.arange(3)
    shape = (contacts, 3 * step.scene.n)
    return sparse.csr_array((entry.ravel(), (row, column.ravel())), shape=shape)
