"""One step as a convex problem (kernels/MODEL.md, eq. 10), in NumPy, apart from the kernels that solve it.

    min 1/2 (v - v*)^T M (v - v*)   subject to   J v <= b,   b = gap / dt,

v* the free velocities, a row of J for every pair of grains and for every grain at every wall.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.scene.geometry import pair_gaps, pair_normals
from warpgrains.scene.scene import Scene
from warpgrains.scene.walls import Wall


class LinearConstraints(NamedTuple):
    """Rows of J v <= b."""

    rows: sparse.csr_array
    """J, shape (m, 2 n): v_n of every contact, of velocities (x_0, y_0, x_1, ...) [m/s]."""
    bound: FloatArray
    """b = gap / dt [m/s], shape (m,)."""


@dataclass(frozen=True, eq=False)
class StepProblem:
    """A step from where it starts: centres [m] and velocities [m/s], shape (n, 2)."""

    scene: Scene
    position: FloatArray
    velocity: FloatArray

    @property
    def free_velocity(self) -> FloatArray:
        """v* = v + dt (g - drag / m v) (eq. 2) [m/s], shape (n, 2)."""
        scene, v = self.scene, self.velocity
        return v + scene.dt * (np.array(scene.gravity) - (scene.drag / scene.mass)[:, np.newaxis] * v)

    def constraints(self, speed: FloatArray) -> LinearConstraints:
        """Return all constraints that velocities can violate if no grain is faster than its speed [m/s]."""
        walls = self.scene.walls.seen_from(self.position, self.scene.radius)
        parts = [self._pairs(speed), *(self._wall(wall, speed) for wall in walls)]
        rows = sparse.vstack([part.rows for part in parts], format="csr")
        return LinearConstraints(rows, np.concatenate([part.bound for part in parts]))

    def _pairs(self, speed: FloatArray) -> LinearConstraints:
        """Between grains (v_i - v_j) . n <= gap / dt."""
        scene, position = self.scene, self.position
        i, j = pairs_within(position, scene.radius, scene.dt * speed).T
        normal, gap = pair_normals(position, i, j), pair_gaps(position, scene.radius, i, j)
        return LinearConstraints(_rows(scene.n, i, normal) - _rows(scene.n, j, normal), gap / scene.dt)

    def _wall(self, wall: Wall, speed: FloatArray) -> LinearConstraints:
        """At a wall v . n <= gap / dt, n into it."""
        scene = self.scene
        i = np.flatnonzero(wall.gap <= scene.dt * speed)
        return LinearConstraints(_rows(scene.n, i, wall.normal[i]), wall.gap[i] / scene.dt)


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


def _rows(n: int, grain: IndexArray, normal: FloatArray) -> sparse.csr_array:
    """Return the rows that take v_grain . normal, shape (m, 2 n)."""
    column = np.stack([2 * grain, 2 * grain + 1], axis=1).ravel()
    return sparse.csr_array(
        (normal.ravel(), column, 2 * np.arange(len(grain) + 1)), shape=(len(grain), 2 * n)
    )
