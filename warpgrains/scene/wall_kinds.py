"""The kinds of walls inside the annulus, polylines, and the check of the walls of a scene."""

from collections.abc import Mapping
from dataclasses import MISSING, fields
from math import dist
from typing import Any, ClassVar

import numpy as np

from warpgrains.described import described
from warpgrains.errors import InputError
from warpgrains.scene import checks
from warpgrains.scene.annulus import LARGEST, SMALLEST
from warpgrains.scene.arc import Arc
from warpgrains.scene.disc import Disc
from warpgrains.scene.segment import Segment
from warpgrains.scene.wall import Wall, kind_of_wall


def _corners(field: str, value: Any) -> tuple[tuple[float, float], ...]:
    return tuple(map(tuple, checks.vectors(field, value, "corner").tolist()))


@kind_of_wall
class Polyline(Wall):
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
            raise InputError(f"points of a polyline has {len(points)} corners: it must have {least} or more")
        for k, (one, onward) in enumerate(zip(points, self._onward, strict=False)):
            if dist(one, onward) < SMALLEST:
                raise InputError(f"points of a polyline of corner {k} is {one}: the next one is the same")

    @property
    def _onward(self) -> tuple[tuple[float, float], ...]:
        return self.points[1:] + self.points[:1] * self.closed

    @property
    def middle(self) -> tuple[float, float]:
        x, y = np.mean(self.points, axis=0).tolist()
        return x, y

    def segments(self, number: int) -> tuple[Segment, ...]:
        """Return the segments of the polyline, the wall of this number among those that are given."""
        common = {own.name: getattr(self, own.name) for own in fields(Wall)}
        common["name"] = self.name or f"{self.kind}{number}"
        if self.angular_velocity != 0.0:
            common["pivot"] = self.motion.pivot
        return tuple(Segment(a, b, **common) for a, b in zip(self.points, self._onward, strict=False))


WALL_KINDS: dict[str, type[Wall]] = {kind.kind: kind for kind in (Disc, Segment, Arc)}
"""The kinds by the name that `[[walls]]` tables give."""
WRITTEN_KINDS: dict[str, type[Wall]] = {**WALL_KINDS, Polyline.kind: Polyline}
"""The same, and those of which a scene makes several walls."""


def checked_walls(field: str, value: Any) -> tuple[Wall, ...]:
    """Return walls, each given as an object or by the keys of a `[[walls]]` table; polylines as segments."""
    if not isinstance(value, list | tuple):
        raise InputError(f"{field} is {checks.shown(value)}: it must be a list of walls")
    found: list[Wall] = []
    walls = [_checked_wall(f"{field}[{k}]", given) for k, given in enumerate(value)]
    for k, wall in enumerate(walls):
        parts: tuple[Wall, ...] = (wall,)
        if isinstance(wall, Polyline):
            parts = wall.segments(k)
            if wall.name is None and any(parts[0].name == other.name for other in walls):
                raise InputError(f"{field}[{k}] has no name: give it one other than {parts[0].name}")
        if (largest := max(abs(number) for part in parts for number in part.numbers)) > LARGEST:
            raise InputError(
                f"{field}[{k}] has the length or coordinate {largest} m: it must be at most {LARGEST:g} m,"
                " for squares of distances to be finite"
            )
        found += parts
    return tuple(found)


def _checked_wall(field: str, value: Any) -> Wall:
    if isinstance(value, Wall) and isinstance(value, tuple(WRITTEN_KINDS.values())):
        return value
    if not isinstance(value, Mapping):
        kinds = " or ".join(kind.__name__ for kind in WRITTEN_KINDS.values())
        raise InputError(f"{field} is {checks.shown(value)}: it must be a {kinds}, or a table of its keys")
    own = dict(value)
    kind = WRITTEN_KINDS[checks.one_of(f"{field}.kind", own.pop("kind", None), WRITTEN_KINDS)]
    keys = kind.keys()
    for key in own:
        checks.one_of(f"key of {field}", key, ("kind", *keys))
    for key, found in keys.items():
        if key not in own and found.default is MISSING:
            raise InputError(f"{field}.{key} is missing: {kind.one()} needs it")
    try:
        return kind(**{keys[key].name: given for key, given in own.items()})
    except InputError as error:
        raise InputError(f"{field}: {error}") from None
