"""The kinds of walls inside the annulus, and the check of the walls of a scene."""

from collections.abc import Mapping, Sequence
from typing import Any

from warpgrains.errors import InputError
from warpgrains.scene import checks
from warpgrains.scene.arc import Arc
from warpgrains.scene.disc import Disc
from warpgrains.scene.obstacle import MOST_NUMBERS, Obstacle, is_required
from warpgrains.scene.segment import Segment

WALL_KINDS: dict[str, type[Obstacle]] = {kind.kind: kind for kind in (Disc, Segment, Arc)}
"""The kinds by the name that `[[walls]]` tables give."""


def checked_walls(field: str, value: Any) -> tuple[Obstacle, ...]:
    """Return walls, each given as an object or by the keys of a `[[walls]]` table."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise InputError(f"{field} is {checks.shown(value)}: it must be a list of walls")
    walls = tuple(_checked_wall(f"{field}[{k}]", wall) for k, wall in enumerate(value))
    for k, wall in enumerate(walls):
        if len(wall.numbers) > MOST_NUMBERS:
            raise InputError(f"{field}[{k}].numbers is {wall.numbers}: a wall has at most {MOST_NUMBERS}")
    return walls


def _checked_wall(field: str, value: Any) -> Obstacle:
    if isinstance(value, Obstacle):
        return value
    if not isinstance(value, Mapping):
        raise InputError(f"{field} is {checks.shown(value)}: it must be a wall, or a table of its keys")
    own = dict(value)
    kind = WALL_KINDS[checks.one_of(f"{field}.kind", own.pop("kind", None), WALL_KINDS)]
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
