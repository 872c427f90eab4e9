"""The constraints J v <= b of a step (kernels/MODEL.md, eqs. 10 and 15) for any set of contacts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from warpgrains.base.arrays import BoolArray, FloatArray, Indices
from warpgrains.walls.rim import Rim

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

Start = tuple[FloatArray, FloatArray]
"""Centers [m] and velocities [m/s] of all grains before a step, shape (n, 2)."""


@dataclass(frozen=True, eq=False)
class StepConstraints:
    """J v <= b of k pairs, with (J v)_c = (v_i - v_j) . n, then of wall contacts, with (J v)_c = v_i . n.

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
        b = gap / dt - `rebound`, plus the normal part of `wall_speed` at walls [m/s], shape (m,).
    rebound : ndarray
        Reduction of b at contacts that bounce (eq. 35) [m/s], shape (m,).
    wall_speed : ndarray
        Velocities of walls along normal and tangent of their contacts [m/s], shape (m - k, 2) (eq. 26b).
    time : float
        Time of the start of the step [s].
    mass : ndarray
        Contact masses (eq. 17b) of the n grains, then masses of the s walls that a force drives [kg], shape
        (n + s,).
    body : ndarray
        Indices of these grains and walls in the device's arrays by body, shape (n + s,).
    driver : ndarray
        Index into `mass` of the driven wall that is, or moves, the wall of a contact; or -1; shape (m - k,).
    lever : ndarray
        Velocity of the wall of a contact along normal and tangent if `driver` has speed 1 (eq. 28), shape
        (m - k, 2); 0 where `driver` is -1.
    """

    scene: Scene
    position: FloatArray
    wall: Indices
    first: Indices
    second: Indices
    normal: FloatArray
    gap_rate: FloatArray
    rebound: FloatArray
    wall_speed: FloatArray
    time: float
    mass: FloatArray
    body: Indices
    driver: Indices
    lever: FloatArray

    @classmethod
    def at(cls, scene: Scene, start: Start, pair: Indices, wall: Indices, time: float) -> Self:
        """Return the constraints of pairs, shape (k, 2), and of contacts (grain, wall), shape (m - k, 2).

        `time` is that of the start of the step [s].
        """
        (position, velocity), (i, j), (grain, _) = start, pair.T, wall.T
        between, apart = scene.pair_frames(position, pair)
        normal, gap = scene.wall_frames(position, wall, time=time)
        wall_speed = scene.wall_speeds(position, wall, time)
        drives, own = scene.bodies.drives, scene.bodies.of_walls[wall[:, 1]]
        driven = [k for k, drive in enumerate(drives) if drive.inverse_mass and drive.leader == k]
        numbers = {k: scene.n + place for place, k in enumerate(driven)}
        driver = np.array([numbers.get(drive.leader, -1) for drive in drives])[own]
        directions = np.array([drive.direction for drive in drives])[own]
        along = np.where((own == 0) & (driver >= 0), 1.0, (normal * directions).sum(axis=1))
        across = normal[:, 0] * directions[:, 1] - normal[:, 1] * directions[:, 0]
        body = np.append(np.arange(scene.n), np.array(driven, int) + scene.n)
        every = cls(
            scene=scene,
            position=position,
            wall=wall,
            first=np.concatenate([i, grain]),
            second=j,
            normal=np.concatenate([between, normal]),
            gap_rate=np.concatenate([apart / scene.dt, gap / scene.dt + wall_speed[:, 0]]),
            rebound=np.zeros(len(pair) + len(wall)),
            wall_speed=wall_speed,
            time=time,
            mass=np.append(scene.contact_mass, [1.0 / drives[k].inverse_mass for k in driven]),
            body=body,
            driver=driver,
            lever=np.stack([along, across], axis=1),
        )
        if not scene.has_restitution:
            return every
        rebound = every._rebound(velocity[body])
        return replace(every, gap_rate=every.gap_rate - rebound, rebound=rebound)

    def _rebound(self, velocity: FloatArray) -> FloatArray:
        """Return `rebound`, the reduction of gap / dt by restitution (eq. 35) [m/s], shape (m,).

        `velocity` holds velocities before the step, in the order of `normal_speed`.
        """
        scene, pairs = self.scene, len(self.second)
        surface = np.append(np.zeros(pairs), self.wall_speed[:, 0])
        vn, rate = self.normal_speed(velocity), self.sliding(scene.dt * velocity).gap_rate
        least = scene.bouncing_speed(self.time == scene.time)
        e = np.append(np.full(pairs, scene.restitution), scene.at_walls["restitution"][self.wall[:, 1]])
        bounces = (e > 0.0) & (vn > rate) & (vn - surface > least)
        return np.where(bounces, np.maximum(0.0, rate - (surface - e * (vn - surface))), 0.0)

    @property
    def compliance(self) -> FloatArray:
        """Change of J v by a correction of 1 m/s, shape (m,): K of eq. 28 at driven walls, otherwise 1."""
        grain, pairs = self.wall[:, 0], len(self.second)
        at_walls = self.lever[:, 0] ** 2 * self.mass[grain] / self.mass[self.driver]
        return np.append(np.ones(pairs), 1.0 + np.where(self.driver >= 0, at_walls, 0.0))

    def normal_speed(self, velocity: FloatArray) -> FloatArray:
        """Return J v [m/s], shape (m,).

        `velocity` holds velocities of the grains, followed by (speed, 0) of every driven wall [m/s], shape (n
        + s, 2).
        """
        relative, pairs = velocity[self.first], len(self.second)
        relative[:pairs] -= velocity[self.second]
        found: FloatArray = (relative * self.normal).sum(axis=1)
        found[pairs:] -= np.where(self.driver >= 0, self.lever[:, 0] * velocity[self.driver, 0], 0.0)
        return found

    def sliding(self, move: FloatArray) -> Self:
        """Return the constraints with the gaps at a round wall for grains that slide along it (eq. 18).

        `move` holds the displacements of the grains in the step [m], shape (n, 2).
        """
        _, gap = self.scene.wall_frames(self.position, self.wall, move, self.time)
        pairs = len(self.second)
        at_walls = gap / self.scene.dt + self.wall_speed[:, 0] - self.rebound[pairs:]
        return replace(self, gap_rate=np.append(self.gap_rate[:pairs], at_walls))

    @property
    def circle(self) -> FloatArray:
        """A / dt [m/s] of eq. 18 at contacts with a round outer wall, inf at other contacts, shape (m,).

        A is the radius of the circle on which the center of a grain lies if the grain touches the wall.
        """
        scene, found = self.scene, np.full(len(self.first), np.inf)
        for number, wall in enumerate(scene.walls):
            if isinstance(wall, Rim) and wall.is_round:
                at_wall = np.append(np.zeros(len(self.second), bool), self.wall[:, 1] == number)
                found[at_wall] = (wall.radius - scene.radius[self.first[at_wall]]) / scene.dt
        return found

    @property
    def friction(self) -> FloatArray:
        """Coefficients of friction, shape (m,)."""
        scene, pairs = self.scene, len(self.second)
        return np.append(np.full(pairs, scene.friction), scene.at_walls["friction"][self.wall[:, 1]])

    @property
    def surface_speed(self) -> FloatArray:
        """Speeds of the surfaces along the tangents of contacts [m/s], shape (m,); 0 for pairs."""
        return np.append(np.zeros(len(self.second)), self.wall_speed[:, 1])

    def only(self, at_walls: BoolArray) -> Self:
        """Return the constraints of all pairs and of the wall contacts in a mask of shape (m - k,)."""
        kept = np.append(np.ones(len(self.second), bool), at_walls)
        return replace(
            self,
            first=self.first[kept],
            normal=self.normal[kept],
            gap_rate=self.gap_rate[kept],
            rebound=self.rebound[kept],
            wall=self.wall[at_walls],
            wall_speed=self.wall_speed[at_walls],
            driver=self.driver[at_walls],
            lever=self.lever[at_walls],
        )


def every_wall(scene: Scene) -> Indices:
    """Return contacts (grain, wall) of all grains with all walls, ordered by wall, shape (m, 2)."""
    walls = np.arange(len(scene.walls))
    return np.stack([np.tile(np.arange(scene.n), len(walls)), np.repeat(walls, scene.n)], axis=1)
