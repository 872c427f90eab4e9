"""A line of segments, written as its corners."""

from dataclasses import fields
from typing import ClassVar

import numpy as np

from warpgrains.described import described
from warpgrains.errors import InputError
from warpgrains.scene import checks
from warpgrains.scene.obstacle import Obstacle, kind_of_wall
from warpgrains.scene.segment import Segment
from warpgrains.scene.walls import SMALLEST


@kind_of_wall
class Polyline(Obstacle):
    """Segments from each of several points to the next, a way to write them.

    A scene holds the segments, as walls of one name: by default "polyline" and its place among the walls that
    are given.

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
    ('Outer', 'Inner', 'hopper', 'hopper', 'hopper')
    """

    kind: ClassVar[str] = "polyline"
    points: tuple[tuple[float, float], ...] = described("Two corners or more [m], two components each.")
    closed: bool = described("Whether a segment leads from the last corner to the first.", default=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        points = checks.vectors("points of a polyline", self.points, "corner")
        closed = checks.boolean("closed of a polyline", self.closed)
        if len(points) < 2 + closed:
            raise InputError(
                f"points of a polyline has {len(points)} corners: it must have {2 + closed} or more"
            )
        onward = np.roll(points, -1, axis=0) if closed else points[1:]
        if (same := np.hypot(*(onward - points[: len(onward)]).T) < SMALLEST).any():
            corner = checks.first_bad("points of a polyline", points, same, "corner")
            raise InputError(f"{corner}: the next one is the same")
        self._check(points=tuple(map(tuple, points.tolist())), closed=closed)

    @property
    def middle(self) -> tuple[float, float]:
        """Mean of the corners [m]."""
        x, y = np.mean(self.points, axis=0).tolist()
        return x, y

    def segments(self, number: int) -> tuple[Segment, ...]:
        """Return the segments of the polyline, the wall of this number among those that are given."""
        common = {own.name: getattr(self, own.name) for own in fields(Obstacle)}
        common["name"] = self.name or f"{self.kind}{number}"
        if self.angular_velocity != 0.0:
            common["pivot"] = self.motion.pivot
        onward = (*self.points[1:], self.points[0]) if self.closed else self.points[1:]
        return tuple(Segment(a, b, **common) for a, b in zip(self.points, onward, strict=False))
