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
    """J v <= b: of k pairs, (J v)_c = (v_i - v_j) . n; then, of grains and walls, v_i . n.

    Attributes
    ----------
    scene : Scene
    first, second : ndarray
        Grain i of every contact, shape (m,), and j of the pairs, shape (k,).
    normal : ndarray
        n, from i to j or into the wall, shape (m, 2).
    gap_rate : ndarray
        b = gap / dt [m/s], shape (m,).
    """

    scene: Scene
    first: Grains
    second: Grains
    normal: FloatArray
    gap_rate: FloatArray

    @classmethod
    def at(
        cls, scene: Scene, position: FloatArray, pair: Grains, wall: Grains, move: FloatArray | None = None
    ) -> Self:
        """Return those of some pairs, shape (k, 2), and of some grains and walls, shape (m - k, 2).

        Centres are at these positions [m], shape (n, 2); contacts with walls are in the order of the walls.

        For grains that move by so much in the step [m], shape (n, 2), a round wall has the gaps of eq. 18.
        """
        (i, j), (grain, number) = pair.T, wall.T
        gaps, normals = [pair_gaps(position, scene.radius, i, j)], [pair_normals(position, i, j)]
        for one in scene.wall_numbers:
            at_wall = grain[number == one]
            own = None if move is None else move[at_wall]
            side = scene.side(one, position[at_wall], scene.radius[at_wall], own)
            gaps.append(side.gap)
            normals.append(side.normal)
        return cls(
            scene=scene,
            first=np.concatenate([i, grain]),
            second=j,
            normal=np.concatenate(normals),
            gap_rate=np.concatenate(gaps) / scene.dt,
        )

    def only(self, at_walls: BoolArray) -> Self:
        """Return those of all pairs, and of the contacts with walls that are marked, shape (m - k,)."""
        kept = np.append(np.ones(len(self.second), bool), at_walls)
        return replace(
            self,
            first=self.first[kept],
            normal=self.normal[kept],
            gap_rate=self.gap_rate[kept],
        )

    @property
    def wall_grain(self) -> Grains:
        """Grain of every contact with a wall, shape (m - k,)."""
        return self.first[len(self.second) :]


def every_wall(scene: Scene, grain: Grains) -> Grains:
    """Return grains at all walls of a scene, in the order of the walls, shape (m, 2)."""
    walls = scene.wall_numbers
    return np.stack([np.tile(grain, len(walls)), np.repeat(walls, len(grain))], axis=1)
