"""A polyline: segments from corner to corner, written as one wall."""

from collections.abc import Sequence
from dataclasses import fields
from math import dist
from typing import Any, ClassVar

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.described import described
from warpgrains.base.errors import InputError
from warpgrains.base.shown import number_of
from warpgrains.space.geometry import SMALLEST
from warpgrains.walls.segment import Segment
from warpgrains.walls.wall import Wall, kind_of_wall


def closed_corners(field: str, name: str, walls: Sequence[Wall]) -> FloatArray:
    """Return the corners [m], shape (k, 2), of the closed polyline `name`, from its segments in `walls`.

    InputError, which names `field`, if there is no closed polyline of this name.
    """
    closed = dict[str, FloatArray]()
    for one in dict.fromkeys(wall.name for wall in walls if wall.name):
        ends = [(wall.start, wall.end) for wall in walls if isinstance(wall, Segment) and wall.name == one]
        starts, stops = [start for start, _ in ends], [end for _, end in ends]
        if len(ends) > 2 and stops == starts[1:] + starts[:1]:
            closed[one] = np.array(starts)
    if not closed:
        raise InputError(f"{field} is {name!r}: it must be a table, because no wall is a closed polyline")
    return closed[checks.one_of(field, name, closed)]


def _corners(field: str, value: Any) -> tuple[tuple[float, float], ...]:
    return tuple(map(tuple, checks.vectors(field, value, "corner").tolist()))


@kind_of_wall
class Polyline(Wall):
    """A short form of segments from each of several points to the next.

    A scene holds the segments as walls that share a name, by default "polyline" and the index of the polyline
    in `walls`.

    Parameters
    ----------
    {fields}

    Raises
    ------
    InputError
        A value is invalid, or a point is the same as the one before.

    Examples
    --------
    >>> hopper = wg.Polyline([(-0.8, 0.5), (-0.1, -0.5), (0.1, -0.5), (0.8, 0.5)], name="hopper")
    >>> grain = {"position": [[0.0, 0.5]], "radius": 0.1, "mass": 0.1}
    >>> scene = wg.Scene(**grain, radius_out=2.0, walls=[hopper])
    >>> scene.walls[0]
    Segment(start=(-0.8, 0.5), end=(-0.1, -0.5), name='hopper')
    >>> scene.wall_names
    ('hopper', 'hopper', 'hopper', 'Outer')
    """

    kind: ClassVar[str] = "polyline"
    points: tuple[tuple[float, float], ...] = described(
        "Two corners or more [m], two components each.", check=_corners
    )
    closed: bool = described(
        "Whether a segment leads from the last corner to the first.", check=checks.boolean, default=False
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        points, least = self.points, 2 + self.closed
        if len(points) < least:
            corners = number_of(len(points), "corner")
            raise InputError(f"points of a polyline has {corners}: it must have {least} or more")
        for k, (one, onward) in enumerate(zip(points, self._onward, strict=False)):
            if dist(one, onward) < SMALLEST:
                onward_of = (k + 1) % len(points)
                raise InputError(f"corners {k} and {onward_of} of a polyline are both {one}: remove one")

    @property
    def _onward(self) -> tuple[tuple[float, float], ...]:
        return self.points[1:] + self.points[:1] * self.closed

    @property
    def middle(self) -> tuple[float, float]:
        x, y = np.mean(self.points, axis=0).tolist()
        return x, y

    def segments(self, number: int) -> tuple[Segment, ...]:
        """Return the segments of the polyline, which has this index among the given walls."""
        common = {own.name: getattr(self, own.name) for own in fields(Wall)}
        common["name"] = self.name or f"{self.kind}{number}"
        if self.angular_velocity != 0.0:
            common["pivot"] = self.about
        return tuple(Segment(a, b, **common) for a, b in zip(self.points, self._onward, strict=False))
