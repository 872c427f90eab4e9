"""One step as a convex problem (SPEC.md, "Why it is hard"), in NumPy, apart from the kernels that solve it.

    min 1/2 (v - v*)^T M (v - v*)   subject to   J v <= b,   b = gap / dt,

v* the free velocities, a row of J for every pair of grains and for every grain at every wall.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.scene.scene import Scene


class LinearConstraints(NamedTuple):
    """Rows of J v <= b."""

    rows: sparse.csr_array
    """J, shape (m, 2 n): v_n of every contact, of velocities (x_0, y_0, x_1, ...) [m/s]."""
    bound: FloatArray
    """b = gap / dt [m/s], shape (m,)."""


@dataclass(frozen=True, eq=False)
class StepProblem:
    """A step from where it starts.

    Attributes
    ----------
    scene : Scene
    position, velocity : ndarray
        Where the step starts [m], [m/s], shape (n, 2).
    """

    scene: Scene
    position: FloatArray
    velocity: FloatArray

    @property
    def free_velocity(self) -> FloatArray:
        """v* = v + dt (g - drag / m v) [m/s], shape (n, 2)."""
        scene, v = self.scene, self.velocity
        return v + scene.dt * (np.array(scene.gravity) - (scene.drag / scene.mass)[:, np.newaxis] * v)

    def constraints(self, speed: FloatArray) -> LinearConstraints:
        """Return all constraints that velocities can violate, if no grain is faster than its speed.

        Parameters
        ----------
        speed : ndarray
            [m/s], shape (n,).
        """
        pairs = self._pairs(speed)
        sides = [self._wall(speed, outer=True)]
        if self.scene.radius_in > 0.0:
            sides.append(self._wall(speed, outer=False))
        rows = sparse.vstack([pairs.rows, *(side.rows for side in sides)], format="csr")
        return LinearConstraints(rows, np.concatenate([pairs.bound, *(side.bound for side in sides)]))

    def _pairs(self, speed: FloatArray) -> LinearConstraints:
        """Between grains (v_i - v_j) . n <= gap / dt."""
        scene, position = self.scene, self.position
        i, j = pairs_within(position, scene.radius, scene.dt * speed).T
        d = position[j] - position[i]
        distance = np.hypot(*d.T)
        normal = d / distance[:, np.newaxis]
        gap = distance - (scene.radius[i] + scene.radius[j])
        return LinearConstraints(_rows(scene.n, i, normal) - _rows(scene.n, j, normal), gap / scene.dt)

    def _wall(self, speed: FloatArray, outer: bool) -> LinearConstraints:
        """At the outer wall v . n <= gap / dt, at the inner one -v . n <= gap / dt."""
        scene, rho = self.scene, np.hypot(*self.position.T)
        gap = scene.radius_out - rho - scene.radius if outer else rho - scene.radius_in - scene.radius
        i = np.flatnonzero(gap <= scene.dt * speed).astype(np.int64)
        normal = (1.0 if outer else -1.0) * self.position[i] / rho[i, np.newaxis]
        return LinearConstraints(_rows(scene.n, i, normal), gap[i] / scene.dt)


def pairs_within(position: FloatArray, radius: FloatArray, reach: FloatArray) -> IndexArray:
    """Return the pairs i < j of discs whose gap is at most the sum of their reaches, shape (m, 2).

    Each is found from the disc that reaches further, so that one with a long reach costs only its own search.
    """
    around = cKDTree(position).query_ball_point(position, radius + radius.max() + 2.0 * reach)
    i = np.repeat(np.arange(len(position)), [len(found) for found in around])
    j = np.concatenate([np.array(found, dtype=np.int64) for found in around])
    pair = np.unique(np.sort(np.stack([i, j], axis=1)[i != j], axis=1), axis=0)
    i, j = pair.T
    gap = np.hypot(*(position[j] - position[i]).T) - (radius[i] + radius[j])
    return pair[gap <= reach[i] + reach[j]]


def _rows(n: int, grain: IndexArray, normal: FloatArray) -> sparse.csr_array:
    """Return the rows that take v_grain . normal, shape (m, 2 n)."""
    column = np.stack([2 * grain, 2 * grain + 1], axis=1).ravel()
    return sparse.csr_array(
        (normal.ravel(), column, 2 * np.arange(len(grain) + 1)), shape=(len(grain), 2 * n)
    )
