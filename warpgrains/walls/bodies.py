"""Bodies: the walls on the device (kernels/walls/walls.py), made from the walls of a scene.

Body 0 is the annulus; its two circles are the two sides of the body. Without an annulus, the outer circle is
out of reach. The other walls follow. With friction or a driven wall, the inner circle is body 1, a disc at
the origin, because each circle then needs its own friction and speed.

At a joint, an end of a wall lies on another wall (MODEL.md, eq. 8c).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from warpgrains.base.arrays import FloatArray, IntArray
from warpgrains.space.geometry import Period, Side, distance, left_of
from warpgrains.walls.line import Line
from warpgrains.walls.rim import Rim
from warpgrains.walls.row import Row
from warpgrains.walls.wall import Drive, Wall

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene


NO_CIRCLE = 1e100  # m, radius of the outer circle of the device where there is none
NONE = -1  # number of a wall that does not exist
CLOSE = 1e-9  # largest distance of an end from the other wall at a joint, relative to the larger wall
ACROSS = np.array([np.cos(1.0), np.sin(1.0)])  # direction in which ends are sorted, unusual for walls
FLUSH = 1e-9  # sine of the angle up to which faces at a joint count as one, as in kernels/walls/joints.py


Shift = tuple[float, float]
Joined = tuple[int, Shift]
"""A wall at a joint: its index in `Scene.walls`, and the displacement [m] to its image at the joint."""
HERE = (0.0, 0.0)


def with_images(walls: Sequence[Wall], period: Period, radius: float) -> tuple[Wall, ...]:
    """Return walls, followed by their periodic images that a grain can touch together with the wall itself.

    The radius of such a grain is at most `radius` [m].
    """
    every = enumerate(walls if period else ())
    return *walls, *(image for k, wall in every for image in wall.images(k, period, radius))


def image_ways(walls: Sequence[Wall], period: Period) -> FloatArray:
    """Return `Image.steps` of each wall as a displacement [m], shape (walls, 2).

    It is 0 for a wall that is not an image. If no wall is an image, the shape is (0, 2).
    """
    steps = [wall.image.steps if wall.image else (0, 0) for wall in walls]
    return period.lengths * np.array(steps if any(wall.image for wall in walls) else np.zeros((0, 2)))


class Joints:
    """The joints between walls of equal motion: an end of one wall lies on the other wall.

    Walls that a force drives have no joints.
    """

    def __init__(self, walls: tuple[Wall, ...], period: Period):
        self._every, self._period = walls, period
        self._walls = walls = tuple(wall for wall in walls if wall.image is None)
        found: list[list[Joined]] = [[] for _ in range(2 * len(walls))]
        of_walls = np.concatenate([np.zeros((0, 2)), *(wall.ends for wall in walls)])
        shifts = period.shifts if len(of_walls) else np.zeros((1, 2))
        ends = np.concatenate([of_walls - shift for shift in shifts])
        owner = np.tile(np.repeat(np.arange(len(walls)), [len(wall.ends) for wall in walls]), len(shifts))
        size = np.array([wall.circle[2] if len(wall.ends) > 0 else 0.0 for wall in walls])
        order = np.argsort(ends @ ACROSS)
        place = ends[order] @ ACROSS
        for other, wall in enumerate(walls if len(ends) > 0 else ()):
            x, y, reach = wall.circle
            reach += 2.0 * CLOSE * (size.max() + abs(x) + abs(y))
            first, last = np.searchsorted(place, (x, y) @ ACROSS + np.array([-reach, reach]))
            near = np.sort(order[first:last])
            off = np.abs(wall.side(ends[near], np.zeros(len(near))).gap)
            for end in near[off <= CLOSE * np.maximum(size[owner[near]], size[other])].tolist():
                own = walls[k := owner[end]]
                x, y = shift = tuple(shifts[end // len(of_walls)].tolist())
                if (
                    (k != other or shift != HERE)
                    and wall.takes_joints
                    and own.motion_numbers == wall.motion_numbers
                    and not (own.drive or wall.drive)
                ):
                    first = end % len(of_walls)
                    found[2 * k + (first > 0 and k == owner[first - 1])].append((other, (x, y)))
        self._others = [sorted(own) for own in found] if any(found) else []

    def __bool__(self) -> bool:
        return bool(self._others)

    def of(self, number: int) -> list[list[Joined]]:
        """Return two lists for the wall with this index: walls joined at its end 0, and at end 1; or []."""
        image = self._every[number].image
        first = 2 * (image.of if image else number)
        own = self._others[first : first + 2]
        return own if any(own) else []

    def side(self, number: int, time: float, position: FloatArray, radius: FloatArray, free: float) -> Side:
        """Return normals and gaps of grains at wall `number`, at its place at `time` [s].

        Where a joint allows no contact of a grain with this wall, `free` [m] is added to the gap (MODEL.md,
        eq. 8c).
        """
        wall, pose = self._every[number], self._every[number].pose(time)
        here = wall.image.of if wall.image else number, HERE
        x = wall.places(position, self._period, time)
        normal, gap = wall.side(x, radius)
        end = np.where(gap <= radius, wall.end_of(x), -1)
        for which, others in enumerate(self.of(number)):
            grain, known = np.flatnonzero(end == which), sorted([*others, here])
            if len(grain) == 0:
                continue
            places = [self._places(joined, here, position[grain], x[grain], time) for joined in known]
            each = zip(known, places, strict=True)
            gaps = np.array([self._walls[k].side(at, radius[grain]).gap for (k, _), at in each])
            nearest, least = gaps.argmin(axis=0), gaps.min(axis=0)
            for place, (other, way) in enumerate(known):
                own, k, y = grain[nearest == place], self._walls[other], places[place][nearest == place]
                if (other, way) != here and len(own) > 0:
                    along, p, at_end = wall.inwards[which], wall.ends[which], k.end_of(y)
                    sizes = wall.circle[2], k.circle[2]
                    rises = k.face_normals(p - way, y) @ along < -FLUSH
                    rises &= 2.0 * min(sizes) >= radius[own]
                    to_ends = np.append([np.inf] * (len(k.ends) == 0), distance(k.ends - (p - way)))
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

    def _places(
        self, joined: Joined, here: Joined, position: FloatArray, x: FloatArray, time: float
    ) -> FloatArray:
        """Return the positions of grains in the frame of wall `joined` at `time` [s], in [m], shape (n, 2).

        `position` are their positions in the scene, and x those in the frame of wall `here`. In a periodic
        scene, the images next to the joint are returned. Both walls of a joint get the same bits, so that
        they agree on which wall is nearer.
        """
        (other, way), period = joined, self._period
        if joined == here or not period:
            return x
        near, wanted = self._walls[other].places(position, period, time), x - way
        images = np.rint(np.divide(wanted - near, period.lengths, np.zeros_like(x), where=period.repeats))
        return near + period.lengths * images


@lru_cache(64)
def joints_of(walls: tuple[Wall, ...], period: Period) -> Joints:
    """Return the joints of walls in a periodic cell; equal walls share one object from the cache."""
    return Joints(walls, period)


def leaders_of(walls: Sequence[Wall]) -> list[int]:
    """Return, for each wall, the index of the wall with which it moves.

    A row moves with the line of the same name that a force drives, an image with its wall. Every other wall
    has its own index.
    """
    lines = {wall.name: k for k, wall in enumerate(walls) if isinstance(wall, Line) and wall.drive}
    own = [wall.image.of if wall.image else k for k, wall in enumerate(walls)]
    return [
        lines.get(wall.name, k) if isinstance(wall, Row) and wall.name else k
        for k, wall in zip(own, walls, strict=True)
    ]


class Bodies:
    """The bodies of a scene, which are its walls on the device, see the head of the module."""

    def __init__(self, scene: Scene):
        self._walls, self._period, walls = scene.walls, scene.period, scene.walls
        self._joints, self._leaders, self._at_walls = scene.joints, scene.leaders, scene.at_walls
        rims = {wall.inside: (k, wall.radius) for k, wall in enumerate(walls) if isinstance(wall, Rim)}
        (inner, near), (outer, far) = rims.get(False, (NONE, 0.0)), rims.get(True, (NONE, np.nan))
        self.two_circles = (scene.has_friction or scene.has_driven_walls) and inner != NONE
        self.circle_walls = inner, outer
        """Indices of the inner and the outer circle in `Scene.walls`; `NONE` for a circle that is missing."""
        self.radii = near, far
        """Radii of the inner and the outer circle [m]; 0 and NaN without them."""
        self._inner = NONE if self.two_circles else inner
        others = [k for k in range(len(walls)) if k not in self.circle_walls]
        self.walls = [outer, *([inner] if self.two_circles else []), *others]
        """Index in `Scene.walls` of the wall of each body; for body 0 of the outer circle, or `NONE`."""

    def __len__(self) -> int:
        return len(self.walls)

    @property
    def circles(self) -> tuple[float, float]:
        """Radii of the inner and the outer circle of body 0 [m]; 0 and `NO_CIRCLE` where it has none."""
        near, far = self.radii
        return 0.0 if self.two_circles else near, far if self.outer else NO_CIRCLE

    @property
    def outer(self) -> Rim | None:
        """The outer circle of the annulus; None in a box."""
        wall = self._walls[self.walls[0]] if self.walls[0] != NONE else None
        return wall if isinstance(wall, Rim) else None

    @property
    def is_round(self) -> bool:
        """True if a step uses the outer circle itself as the wall, instead of its tangent at each grain."""
        return self.outer is not None and self.outer.is_round

    @property
    def inside(self) -> tuple[Wall, ...]:
        """The walls of the bodies 1, 2, ..., called bodies inside."""
        return tuple(self._walls[k] for k in self.walls[1:])

    @property
    def joints(self) -> list[list[tuple[int, bool, Shift]]]:
        """Two lists for each body inside: the joints at its end 0, and at its end 1; [] without joints.

        A joint is (index of the other body inside, whether that body counts as nearer if the gaps are equal,
        displacement [m] from that body to its image at the joint).
        """
        joints = self._joints
        if not joints:
            return []
        place, found = {wall: k for k, wall in enumerate(self.walls[1:])}, []
        for number in self.walls[1:]:
            image = self._walls[number].image
            here = image.of if image else number, HERE
            for joined in joints.of(number) or ([], []):
                found.append([(place[other], (other, way) < here, way) for other, way in joined])
        return found

    @property
    def image_ways(self) -> FloatArray:
        """`Image.steps` of the bodies inside as displacements [m], see the function `image_ways`."""
        return image_ways(self.inside, self._period)

    def _of_bodies(self, *values: Sequence[float] | FloatArray) -> FloatArray:
        """Return lists of values by wall as columns of values by body, shape (bodies, lists).

        The values of body 0 are those of the outer circle, or 0 without one.
        """
        return np.stack([np.append(own, 0.0)[self.walls] for own in values], axis=1)  # NONE is the last one

    @property
    def surfaces(self) -> FloatArray:
        """Friction coefficient and surface speed [m/s] of each body, shape (bodies, 2)."""
        speeds = [wall.surface_speed for wall in self._walls]
        return self._of_bodies(self._at_walls["friction"], speeds)

    @property
    def rolling(self) -> FloatArray:
        """Coefficient of rolling friction and angular velocity in place [rad/s] of each body, (bodies, 2)."""
        spins = [wall.rotation for wall in self._walls]
        return self._of_bodies(self._at_walls["rolling_friction"], spins)

    @property
    def restitutions(self) -> FloatArray:
        """Coefficient of restitution of each body, shape (bodies,)."""
        return self._of_bodies(self._at_walls["restitution"])[:, 0]

    @property
    def drives(self) -> list[Drive]:
        """The drive of each body, with the body that it follows as `leader`.

        All numbers but `leader` are 0 if no force acts on the leader.
        """
        walls, leaders, bodies = self._walls, self._leaders, self.of_walls.tolist()
        drives = [(self.outer.drive if self.outer else None) or Drive()]
        for body, wall in enumerate(self.walls[1:], 1):
            drive = walls[leaders[wall]].drive or Drive()
            if leaders[wall] != wall:
                drive = drive._replace(force=0.0, pressure=0.0)
            elif drive.pressure:
                drive = drive._replace(between=self._between(body - 1))
            drives.append(drive._replace(leader=bodies[leaders[wall]]))
        return drives

    def _between(self, k: int) -> tuple[int, int]:
        """Return the bodies of the two opposite lines that bound the line of body 1 + k; (0, 0) without."""
        lines = {b: wall for b, wall in enumerate(self.inside, 1) if isinstance(wall, Line)}
        found = [b for b, other in lines.items() if other.bounds(lines[1 + k])]
        pairs = [(a, b) for a, b in pairwise(found) if np.dot(lines[a].normal, lines[b].normal) < 0.0]
        return pairs[0] if pairs else (0, 0)

    def pressed_length(self, line: Line) -> float:
        """Return the length of a line on which its pressure acts [m].

        It is the present distance of the two lines that bound the line, or else `Line.length`.
        """
        between = self._between(self.inside.index(line))
        if not any(between):
            return line.length
        walls = (self.inside[b - 1] for b in between)
        return -sum(float(np.dot(wall.point, wall.normal)) for wall in walls if isinstance(wall, Line))

    @property
    def of_walls(self) -> IntArray:
        """Body of each wall, shape (walls,)."""
        found = np.zeros(len(self._walls) + 1, np.int32)  # 0 remains for the inner side of body 0
        found[self.walls] = np.arange(len(self.walls))  # NONE is the last one
        return found[:-1]

    def sign(self, wall: IntArray) -> FloatArray:
        """Return the sign of the device's corrections at walls: -1 at the inner side of body 0, else 1."""
        return np.where(wall == self._inner, -1.0, 1.0)

    def carried(self, body: IntArray, correction: FloatArray) -> tuple[IntArray, FloatArray]:
        """Convert wall contacts from the device: return the indices in `Scene.walls`, and |correction| [m/s].

        `body` and `correction` [m/s] are those on the device, shapes (k,). Body 0 is both circles of an
        annulus, and a correction < 0 at body 0 means the inner circle.
        """
        wall = np.array(self.walls, np.int32)[body]
        return np.where((body == 0) & (correction < 0.0), self._inner, wall), np.abs(correction)
