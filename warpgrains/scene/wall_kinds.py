"""The kinds of walls inside the annulus, and the check of the walls of a scene."""

from collections.abc import Mapping
from typing import Any

from warpgrains.errors import InputError
from warpgrains.scene import checks
from warpgrains.scene.arc import Arc
from warpgrains.scene.disc import Disc
from warpgrains.scene.obstacle import Obstacle, is_required
from warpgrains.scene.polyline import Polyline
from warpgrains.scene.segment import Segment
from warpgrains.scene.walls import LARGEST

WALL_KINDS: dict[str, type[Obstacle]] = {kind.kind: kind for kind in (Disc, Segment, Arc)}
"""The kinds by the name that `[[walls]]` tables give."""
WRITTEN_KINDS: dict[str, type[Obstacle]] = {**WALL_KINDS, Polyline.kind: Polyline}
"""The same, and those of which a scene makes several walls."""


def checked_walls(field: str, value: Any) -> tuple[Obstacle, ...]:
    """Return walls, each given as an object or by the keys of a `[[walls]]` table; polylines as segments."""
    if not isinstance(value, list | tuple):
        raise InputError(f"{field} is {checks.shown(value)}: it must be a list of walls")
    found: list[Obstacle] = []
    for k, given in enumerate(value):
        wall = _checked_wall(f"{field}[{k}]", given)
        parts = wall.segments(k) if isinstance(wall, Polyline) else (wall,)
        if (largest := max(abs(number) for part in parts for number in part.numbers)) > LARGEST:
            raise InputError(
                f"{field}[{k}] has the length or coordinate {largest} m: it must be at most {LARGEST:g} m,"
                " for squares of distances to be finite"
            )
        found += parts
    return tuple(found)


def _checked_wall(field: str, value: Any) -> Obstacle:
    if isinstance(value, Obstacle) and isinstance(value, tuple(WRITTEN_KINDS.values())):
        return value
    if not isinstance(value, Mapping):
        kinds = " or ".join(kind.__name__ for kind in WRITTEN_KINDS.values())
        raise InputError(f"{field} is {checks.shown(value)}: it must be a {kinds}, or a table of its keys")
    own = dict(value)
    kind = WRITTEN_KINDS[checks.one_of(f"{field}.kind", own.pop("kind", None), WRITTEN_KINDS)]
    keys = kind.keys()
    for key in own:
        if key not in keys:
            raise checks.unknown(f"key of {field}", key, ("kind", *keys))
    for key, found in keys.items():
        if key not in own and is_required(found):
            raise InputError(f"{field}.{key} is missing: {kind.one()} needs it")
    try:
        return kind(**{keys[key].name: given for key, given in own.items()})
    except InputError as error:
        raise InputError(f"{field}: {error}") from None
