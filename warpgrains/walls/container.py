"""The space of the grains between circles and lines, and their container, a part of the space.

Segments bound the container. A segment with all centers on one side bounds it along the whole line of the
segment. That is right if walls cover the border of the convex polygon that remains, except for gaps through
which no grain passes. Under gravity, the polygon may be open above. Its mouth is the lowest point of the
border that no wall covers. With walls of other kinds, or a wall that cuts the polygon, the container is
unknown.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import NoAreaError
from warpgrains.space.geometry import Circle, Period
from warpgrains.space.outline import Part, clip
from warpgrains.space.region import Region, Side, rectangle, sides_of
from warpgrains.walls.line import Line
from warpgrains.walls.rim import Rim
from warpgrains.walls.row import Row
from warpgrains.walls.segment import Segment
from warpgrains.walls.wall import Wall

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

ROUNDING = 1e-9  # rounding error of places of walls, relative to `Scene.reach`


@dataclass(frozen=True)
class Container:
    """The container of the grains at one time."""

    walled: Region
    """The space minus discs and minus the half planes beyond straight walls. If the container is unknown,
    segments are ignored."""
    up: FloatArray
    """Unit vector against gravity, see `Scene.up_at`, shape (2,)."""
    mouth: float = np.inf
    """Height above the origin up to which walls enclose the grains [m]; inf without an opening."""
    is_known: bool = True

    @cached_property
    def region(self) -> Region:
        """The part of the container below its mouth."""
        return self.walled.cut((self.up, self.mouth)) if self.mouth < np.inf else self.walled

    def require_known(self, whose: str = "", takes_region: bool = True) -> None:
        """Raise NoAreaError, which begins with `whose`, if the container is unknown.

        If `takes_region`, the message proposes to give a region.
        """
        if not self.is_known:
            hint = ": give region, such as {'x': (-0.1, 0.1), 'y': (-0.2, 0.0)}" if takes_region else ""
            raise NoAreaError(f"{whose}the walls do not form a convex polygon around the grains{hint}")

    def closed(self, whose: str = "", takes_region: bool = True) -> Region:
        """Return the region of a closed container; NoAreaError if the container is open or unknown.

        The message begins with `whose` and, if `takes_region`, proposes to give a region.
        """
        self.require_known(whose, takes_region)
        if self.mouth < np.inf:
            hint = ": give region, such as {'below': 'surface'}" if takes_region else ""
            raise NoAreaError(f"{whose}the walls are open above a height of {self.mouth:g} m{hint}")
        return self.region


@lru_cache(64)  # walls at rest leave the same space at every step
def space_of(walls: tuple[Wall, ...], period: Period, reach: float) -> Region:
    """Return the space between the lines and circles among walls, inside coordinates of +-2 `reach` [m]."""
    circles, sides = list[Circle](), list[Side]()
    for wall in walls:
        if isinstance(wall, Line):
            normal = np.array(wall.normal)
            sides.append((-normal, -float(wall.point @ normal)))
        elif isinstance(wall, Rim):
            circles.append(wall.border)
    whole = -2.0 * reach, 2.0 * reach
    return Region((rectangle(period.x or whole, period.y or whole),), tuple(circles), period).cut(*sides)


def container_of(scene: Scene, time: float, position: FloatArray) -> Container:
    """Return the container of grains at positions [m], shape (n, 2), at a time [s]."""
    up, walls = scene.up_at(time), scene.walls_at(time)
    space = without_discs(space_of(walls, scene.period, scene.reach), walls)
    unknown = Container(space, up, is_known=False)
    thin = [wall for wall in walls if not (wall.border or wall.image or isinstance(wall, Line | Row))]
    if not thin:
        return Container(space, up)
    if not all(isinstance(wall, Segment) for wall in thin):
        return unknown
    ends = np.array([wall.ends for wall in thin])
    middle = ends.mean(axis=1, keepdims=True)
    ends += space.period.wrapped(middle) - middle
    position = space.period.wrapped(position)
    sides, rounding = [_side(own, position) for own in ends], ROUNDING * scene.reach
    region = space.cut(*(side for side in sides if side is not None))
    inner = ends[[side is None for side in sides]]
    if not region.parts or any(_cuts(region.parts[0], own, rounding) for own in inner):
        return unknown
    (part,), width = region.parts, 2.0 * scene.smallest_radius
    own_sides = [*sides_of(space.parts[0].corner)]
    edges = [edge for edge in part.edges if not _is_on(own_sides, edge, rounding)]
    free = np.concatenate(
        [np.empty((0, 2, 2)), *(_uncovered(edge, ends, rounding, width, part.circles) for edge in edges)]
    )
    if not len(free):
        return Container(region, up)
    container = Container(region, up, float((free @ up).min()))
    return container if any(scene.gravity_at(time)) and container.region.area > 0.0 else unknown


def without_discs(space: Region, walls: Iterable[Wall]) -> Region:
    """Return a space minus the walls that are discs."""
    discs = list[Circle]()
    low, high = space.outer_box
    for wall in walls:
        if wall.image:
            continue
        if isinstance(wall, Row):
            centers = wall.discs_about(0.5 * (low + high))
            discs += (Circle(x, y, wall.radius, False) for x, y in centers.tolist())
        elif (border := wall.border) is not None and not isinstance(wall, Rim):
            around = space.period.shifts if not border.keeps_inside else np.zeros((1, 2))
            around = around + space.period.wrapped(np.array([border[:2]]))
            discs += (border._replace(x=x, y=y) for x, y in around.tolist())
    return replace(space, discs=space.discs + tuple(discs)) if discs else space


def _side(ends: FloatArray, position: FloatArray) -> Side | None:
    """Return the half plane, bounded by the line through a segment, that contains all centers.

    None if there are centers on both sides. `ends` and `position` are in m, shapes (2, 2) and (n, 2).
    """
    start, (x, y) = ends[0], (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
    normal = np.array([y, -x])
    beyond = position @ normal - start @ normal
    if (beyond < 0.0).all():
        return normal, float(start @ normal)
    return (-normal, float(-(start @ normal))) if (beyond > 0.0).all() else None


def _is_on(sides: list[Side], edge: FloatArray, rounding: float) -> bool:
    """Return whether an edge, (2, 2), lies on the border of a half plane in `sides`, up to `rounding` [m]."""
    return any((np.abs(edge @ normal - level) <= rounding).all() for normal, level in sides)


def _cuts(part: Part, line: FloatArray, rounding: float) -> bool:
    """Return whether a segment, shape (2, 2), has points in the polygon of `part`, off its border."""
    for normal, level in sides_of(part.corner):
        line = clip(line, normal, level - rounding)
    return len(line) > 1


def _uncovered(
    line: FloatArray, others: FloatArray, rounding: float, gap: float, circles: tuple[Circle, ...]
) -> FloatArray:
    """Return the pieces of segment `line` that no wall covers and that are wider than `gap` [m], (k, 2, 2).

    Segments `others` (ends, shape (m, 2, 2)) that lie on `line` up to `rounding` [m] cover parts of it. So do
    `circles`, where `line` is on their side without grains.
    """
    start, length = line[0], np.hypot(*(line[1] - line[0]))
    if length == 0.0:
        return np.empty((0, 2, 2))
    along = (line[1] - start) / length
    across = np.array([-along[1], along[0]])
    on_line = others[(np.abs((others - start) @ across) <= rounding).all(axis=1)]
    covered = np.sort((on_line - start) @ along, axis=1).tolist()
    for *center, radius, keeps_inside in circles:
        to = np.array(center) - start
        half = np.sqrt(max(radius**2 - (to @ across) ** 2, 0.0))
        low, high = to @ along - half, to @ along + half
        covered += [[-np.inf, low], [high, np.inf]] if keeps_inside else [[low, high]]
    free, reached = [], -0.5 * gap
    for begin, end in [*sorted(covered), [np.inf, np.inf]]:
        begin = min(begin, length + 0.5 * gap)
        if begin - reached > max(gap, rounding):
            free.append(np.clip([reached, begin], 0.0, length))
        reached = max(reached, end)
    return start + np.reshape(free, (-1, 2, 1)) * along
