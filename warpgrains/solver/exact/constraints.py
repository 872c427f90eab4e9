"""The constraints J v <= b of a step (kernels/MODEL.md, eqs. 10 and 15) for any set of contacts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from warpgrains.arrays import BoolArray, FloatArray, Indices
from warpgrains.scene.annulus import OUTER

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class StepConstraints:
    """J v <= b. First k pairs, (J v)_c = (v_i - v_j) . n, then wall contacts, (J v)_c = v_i . n.

    Attributes
    ----------
    scene : Scene
    position : ndarray
        Centers of the grains [m], shape (n, 2).
    wall : ndarray
        Grain and wall of every contact with a wall, shape (m - k, 2).
    first, second : ndarray
        Grain i of every contact, shape (m,), and j of the pairs, shape (k,).
    normal : ndarray
        Unit normals n from i to j or into the wall, shape (m, 2).
    gap_rate : ndarray
        b = gap / dt [m/s], shape (m,).
    time : float
        Time of the end of the step [s], at which walls that move are taken.
    """

    scene: Scene
    position: FloatArray
    wall: Indices
    first: Indices
    second: Indices
    normal: FloatArray
    gap_rate: FloatArray
    time: float

    @classmethod
    def at(cls, scene: Scene, position: FloatArray, pair: Indices, wall: Indices, time: float) -> Self:
        """Return the constraints of pairs, shape (k, 2), and of contacts (grain, wall), shape (m - k, 2).

        `position` holds the centers of all grains at the start of the step [m], shape (n, 2), and `time` is
        that of its end [s].
        """
        (i, j), (grain, _) = pair.T, wall.T
        between, apart = scene.pair_frames(position, pair)
        normal, gap = scene.wall_frames(position, wall, time=time)
        return cls(
            scene=scene,
            position=position,
            wall=wall,
            first=np.concatenate([i, grain]),
            second=j,
            normal=np.concatenate([between, normal]),
            gap_rate=np.concatenate([apart, gap]) / scene.dt,
            time=time,
        )

    def sliding(self, move: FloatArray) -> Self:
        """Return the constraints with round-wall gaps for displacements [m], shape (n, 2) (eq. 18)."""
        _, gap = self.scene.wall_frames(self.position, self.wall, move, self.time)
        return replace(self, gap_rate=np.append(self.gap_rate[: len(self.second)], gap / self.scene.dt))

    @property
    def circle(self) -> FloatArray:
        """A / dt of eq. 18 at a round outer wall, else inf [m/s], shape (m,)."""
        scene, found = self.scene, np.full(len(self.first), np.inf)
        if scene.wall == "round":
            at_wall = np.append(np.zeros(len(self.second), bool), self.wall[:, 1] == OUTER)
            found[at_wall] = (scene.radius_out - scene.radius[self.first[at_wall]]) / scene.dt
        return found

    @property
    def friction(self) -> FloatArray:
        """Coefficients of friction, shape (m,)."""
        scene, pairs = self.scene, len(self.second)
        return np.append(np.full(pairs, scene.friction), np.array(scene.wall_frictions)[self.wall[:, 1]])

    @property
    def surface_speed(self) -> FloatArray:
        """Speeds of the surfaces along the tangents of contacts [m/s], shape (m,); 0 for pairs."""
        at_walls = self.scene.wall_speeds(self.position, self.wall, self.time)[:, 1]
        return np.append(np.zeros(len(self.second)), at_walls)

    def only(self, at_walls: BoolArray) -> Self:
        """Return the constraints of all pairs and of the selected wall contacts, mask of shape (m - k,)."""
        kept = np.append(np.ones(len(self.second), bool), at_walls)
        return replace(
            self,
            first=self.first[kept],
            normal=self.normal[kept],
            gap_rate=self.gap_rate[kept],
            wall=self.wall[at_walls],
        )


def every_wall(scene: Scene) -> Indices:
    """Return contacts (grain, wall) of all grains with all walls, ordered by wall, shape (m, 2)."""
    walls = scene.wall_numbers
    return np.stack([np.tile(np.arange(scene.n), len(walls)), np.repeat(walls, scene.n)], axis=1)
