"""The kinds of walls inside the domain, and the check of the walls of a scene."""

from collections.abc import Mapping
from typing import Any

from warpgrains.base import checks
from warpgrains.base.described import fields_of
from warpgrains.base.errors import InputError
from warpgrains.space.geometry import LARGEST
from warpgrains.walls.arc import Arc
from warpgrains.walls.disc import Disc
from warpgrains.walls.line import Line
from warpgrains.walls.polyline import Polyline
from warpgrains.walls.row import Row
from warpgrains.walls.segment import Segment
from warpgrains.walls.wall import Wall

WALL_KINDS: dict[str, type[Wall]] = {kind.kind: kind for kind in (Disc, Segment, Arc, Line, Row)}
"""The classes of walls by the key `kind` of `[[walls]]` tables."""
WRITTEN_KINDS: dict[str, type[Wall]] = {**WALL_KINDS, Polyline.kind: Polyline}
"""`WALL_KINDS` and the class of polylines. A scene splits a polyline into several walls."""


def checked_walls(field: str, value: Any) -> tuple[Wall, ...]:
    """Return walls, each from an object or the keys of a `[[walls]]` table; polylines become segments."""
    if not isinstance(value, list | tuple):
        raise InputError(f"{field} is {checks.shown(value)}: it must be a list of walls, [[walls]] in a file")
    found: list[Wall] = []
    walls = [_checked_wall(f"{field}[{k}]", given) for k, given in enumerate(value)]
    for k, wall in enumerate(walls):
        parts: tuple[Wall, ...] = (wall,)
        if isinstance(wall, Polyline):
            parts = wall.segments(k)
            if wall.name is None and any(parts[0].name == other.name for other in walls):
                raise InputError(f"{field}[{k}] has no name: give it one other than {parts[0].name}")
        lengths = [abs(number) for part in parts for number in (*part.numbers, getattr(part, "length", 0.0))]
        if (largest := max(lengths)) > LARGEST:
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
    if "kind" not in own:
        raise InputError(f"{field}.kind is missing: give one of {', '.join(WRITTEN_KINDS)}")
    kind = WRITTEN_KINDS[checks.one_of(f"{field}.kind", own.pop("kind", None), WRITTEN_KINDS)]
    fields = fields_of(field, own, kind.one(), kind.keys())
    try:
        return kind(**fields)
    except InputError as error:
        raise InputError(f"{field}: {error}") from None
