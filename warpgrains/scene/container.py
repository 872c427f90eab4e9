"""The container of the grains: the part of the space between the circles that straight walls leave to them.

A segment that has all centers on one side bounds the container along its whole line. That is right as long as
walls cover the border of the convex polygon that remains, but for gaps through which no grain passes. Under
gravity, the polygon may be open above: its mouth is the lowest point of the border that no wall covers. With
walls of other kinds, or a wall that cuts the polygon, the container is unknown.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.errors import NoAreaError
from warpgrains.scene.geometry import Circle
from warpgrains.scene.gravity import upwards
from warpgrains.scene.outline import Part, clip
from warpgrains.scene.region import Region, Side, sides_of
from warpgrains.scene.segment import Segment

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

ROUNDING = 1e-9  # of places of walls, in radii of the outer circle


@dataclass(frozen=True)
class Container:
    """The container of the grains at one time."""

    walled: Region
    """The space between the circles, without discs and what is beyond straight walls and their lines. Where
    the container is unknown, straight walls are left out."""
    up: tuple[float, float] = (0.0, 1.0)
    """Direction against gravity."""
    mouth: float = np.inf
    """Height up to which walls enclose the grains [m], from the origin; inf if they do all around."""
    is_known: bool = True

    @cached_property
    def region(self) -> Region:
        """The container up to its mouth."""
        return self.walled.cut((np.array(self.up), self.mouth)) if self.mouth < np.inf else self.walled

    def require_known(self, whose: str = "", takes_region: bool = True) -> None:
        """Raise NoAreaError, which begins with `whose`, if the container is unknown."""
        if not self.is_known:
            hint = ": give region, such as {'x': (-0.1, 0.1), 'y': (-0.2, 0.0)}" if takes_region else ""
            raise NoAreaError(f"{whose}the walls do not form a convex polygon around the grains{hint}")

    def closed(self, whose: str = "", takes_region: bool = True) -> Region:
        """Return the region that walls enclose all around. Raises NoAreaError if it is open or unknown."""
        self.require_known(whose, takes_region)
        if self.mouth < np.inf:
            hint = ": give region, such as {'below': 'surface'}" if takes_region else ""
            raise NoAreaError(f"{whose}the walls are open above a height of {self.mouth:g} m{hint}")
        return self.region


def container_of(scene: Scene, time: float, position: FloatArray) -> Container:
    """Return the container of grains at positions [m], shape (n, 2), at a time [s]."""
    borders = {wall: wall.border_at(time) for wall in scene.walls}
    discs = tuple(border for border in borders.values() if border is not None)
    space = Region(scene.annulus, discs=discs)
    unknown = Container(space, is_known=False)
    thin = [wall for wall, border in borders.items() if border is None]
    if not thin:
        return Container(space)
    if not all(isinstance(wall, Segment) for wall in thin):
        return unknown
    ends = np.array([wall.motion.pose(time).place(np.reshape(wall.numbers, (2, 2))) for wall in thin])
    sides, rounding = [_side(own, position) for own in ends], ROUNDING * scene.radius_out
    region = space.cut(*(side for side in sides if side is not None))
    inner = ends[[side is None for side in sides]]
    if not region.parts or any(_cuts(region.parts[0], own, rounding) for own in inner):
        return unknown
    (part,), width = region.parts, 2.0 * scene.smallest_radius
    free = np.concatenate([_uncovered(edge, ends, rounding, width, part.circles) for edge in part.edges])
    if not len(free):
        return Container(region)
    gravity = scene.gravity_at(time)
    up = upwards(gravity)
    container = Container(region, tuple(up.tolist()), float((free @ up).min()))
    return container if any(gravity) and container.region.area > 0.0 else unknown


def _side(ends: FloatArray, position: FloatArray) -> Side | None:
    """Return the half plane of a segment in which all centers lie; None if they are on both sides."""
    start, (x, y) = ends[0], (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
    normal = np.array([y, -x])
    beyond = position @ normal - start @ normal
    if (beyond < 0.0).all():
        return normal, float(start @ normal)
    return (-normal, float(-(start @ normal))) if (beyond > 0.0).all() else None


def _cuts(part: Part, line: FloatArray, rounding: float) -> bool:
    """Return whether a segment runs through the inside of a polygon."""
    for normal, level in sides_of(part.corner):
        line = clip(line, normal, level - rounding)
    return len(line) > 1


def _uncovered(
    line: FloatArray, others: FloatArray, rounding: float, gap: float, circles: tuple[Circle, ...]
) -> FloatArray:
    """Return the pieces of a line, wider than `gap`, that neither others nor what is beyond circles cover."""
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
