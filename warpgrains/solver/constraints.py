"""The constraints J v <= b of a step (kernels/MODEL.md, eqs. 10 and 15), of whichever contacts are wanted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from warpgrains.arrays import BoolArray, FloatArray
from warpgrains.scene.geometry import pair_gaps, pair_normals

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

Grains = NDArray[np.integer[Any]]


@dataclass(frozen=True, eq=False)
class StepConstraints:
    """J v <= b: of k pairs, (J v)_c = (v_i - v_j) . n; then, wall after wall, v_i . n of grains at it.

    Attributes
    ----------
    scene : Scene
    position : ndarray
        Centres of the grains [m], shape (n, 2).
    first, second : ndarray
        Grain i of every contact, shape (m,), and j of the pairs, shape (k,).
    normal : ndarray
        n, from i to j or into the wall, shape (m, 2).
    gap_rate : ndarray
        b = gap / dt [m/s], shape (m,).
    sign : ndarray
        Sign of the corrections dv_b at the wall of each contact with a wall, shape (m - k,).
    """

    scene: Scene
    position: FloatArray
    first: Grains
    second: Grains
    normal: FloatArray
    gap_rate: FloatArray
    sign: FloatArray

    @classmethod
    def at(cls, scene: Scene, position: FloatArray, pair: Grains, grain: Grains) -> Self:
        """Return those of some pairs, shape (k, 2), and of some grains at all walls, at these positions."""
        i, j = pair.T
        walls = scene.walls.seen_from(position[grain], scene.radius[grain])
        gaps = [pair_gaps(position, scene.radius, i, j), *(wall.gap for wall in walls)]
        return cls(
            scene=scene,
            position=position,
            first=np.concatenate([i, *[grain] * len(walls)]),
            second=j,
            normal=np.concatenate([pair_normals(position, i, j), *(wall.normal for wall in walls)]),
            gap_rate=np.concatenate(gaps) / scene.dt,
            sign=np.repeat([wall.sign for wall in walls], len(grain)),
        )

    def sliding(self, move: FloatArray) -> Self:
        """Return them for grains with these moves [m], shape (n, 2), along a round wall (eq. 18)."""
        scene, grain = self.scene, self.wall_grain
        walls = scene.walls.seen_from(self.position[grain], scene.radius[grain], move[grain])
        gap = np.select([self.sign == wall.sign for wall in walls], [wall.gap for wall in walls])
        return replace(self, gap_rate=np.append(self.gap_rate[: len(self.second)], gap / scene.dt))

    def only(self, at_walls: BoolArray) -> Self:
        """Return those of all pairs, and of the contacts with walls that are marked, shape (m - k,)."""
        kept = np.append(np.ones(len(self.second), bool), at_walls)
        return replace(
            self,
            first=self.first[kept],
            normal=self.normal[kept],
            gap_rate=self.gap_rate[kept],
            sign=self.sign[at_walls],
        )

    @property
    def wall_grain(self) -> Grains:
        """Grain of every contact with a wall, shape (m - k,)."""
        return self.first[len(self.second) :]
