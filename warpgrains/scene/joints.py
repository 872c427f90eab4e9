"""Joints of walls inside the annulus. This is the host's side; kernels/walls.py is the device's.

At a joint, an end of a wall lies on another wall (kernels/MODEL.md, eq. 8c).
"""

from functools import lru_cache

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.scene.geometry import distance, left_of
from warpgrains.scene.obstacle import Obstacle
from warpgrains.scene.walls import Side

CLOSE = 1e-9  # how far an end may be off the other wall, as a part of the size of the larger one
FLUSH = 1e-9  # sine of the angle up to which faces at a joint count as one, as in kernels/walls.py


class Joints:
    """The joints of walls that move alike. Walls that a force drives have none.

    Attributes
    ----------
    others : list of list of int
        The walls that are joined at ends 0 and 1 of each wall, by number: two lists a wall, or none at all.
    """

    def __init__(self, walls: tuple[Obstacle, ...]):
        self._walls = walls
        found: list[list[int]] = [[] for _ in range(2 * len(walls))]
        ends = np.concatenate([np.zeros((0, 2)), *(wall.ends for wall in walls)])
        owner = np.repeat(np.arange(len(walls)), [len(wall.ends) for wall in walls])
        size = np.array([wall.size for wall in walls])[owner]
        for other, wall in enumerate(walls if len(ends) > 0 else ()):
            off = np.abs(wall.side(ends, np.zeros(len(ends))).gap)
            for end in np.flatnonzero(off <= CLOSE * np.maximum(size, wall.size)).tolist():
                own = walls[k := owner[end]]
                if k != other and own.path == wall.path and not (own.drive or wall.drive):
                    found[2 * k + (end > 0 and k == owner[end - 1])].append(other)
        self.others = found if any(found) else []

    def of(self, number: int) -> list[list[int]]:
        """Return the walls that are joined at the ends of a wall; [] if none are."""
        own = self.others[2 * number : 2 * number + 2]
        return own if any(own) else []

    def side(self, number: int, time: float, position: FloatArray, radius: FloatArray, free: float) -> Side:
        """Return normals and gaps of grains at a wall with joints as it is at a time [s], see `Scene.side`.

        To the gap of a contact that does not exist, `free` is added [m].
        """
        wall, pose = self._walls[number], self._walls[number].pose(time)
        x = pose.to_frame(position) if wall.moves else position
        normal, gap = wall.side(x, radius)
        end = np.where(gap <= radius, wall.end_of(x), -1)
        for which, others in enumerate(self.of(number)):
            grain, known = np.flatnonzero(end == which), sorted([*others, number])
            gaps = np.array([self._walls[k].side(x[grain], radius[grain]).gap for k in known])
            nearest, least = gaps.argmin(axis=0), gaps.min(axis=0)
            for place, other in enumerate(known):
                own, k = grain[nearest == place], self._walls[other]
                if other != number and len(own) > 0:
                    along, p, at_end = wall.inwards[which], wall.ends[which], k.end_of(x[own])
                    sizes = wall.circle[2], k.circle[2]
                    rises = k.face_normals(p, x[own]) @ along < -FLUSH
                    rises &= 2.0 * min(sizes) >= radius[own]
                    to_ends = np.append([np.inf] * (len(k.ends) == 0), distance(k.ends - p))
                    is_apart = to_ends[at_end] > 2.0 * FLUSH * max(sizes)
                    left = left_of(along[np.newaxis])
                    height = (left * (x[own] - p)).sum(axis=1)
                    line = np.where(height > 0.0, -1.0, 1.0)[:, np.newaxis] * left
                    tangent = np.maximum(np.abs(height) - radius[own], least[nearest == place])
                    takes_tangent = rises & (at_end < 0)
                    normal[own] = np.where(takes_tangent[:, np.newaxis], line, normal[own])
                    gap[own] += np.where(rises & is_apart, 0.0, free)
                    gap[own] = np.where(takes_tangent, tangent, gap[own])
        return Side(pose.turn(normal) if wall.moves else normal, gap)


@lru_cache(64)
def joints_of(walls: tuple[Obstacle, ...]) -> Joints:
    """Return the joints of walls."""
    return Joints(walls)
