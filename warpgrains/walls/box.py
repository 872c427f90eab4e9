"""A box as the domain of a scene: its sides are walls, or periodic."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from math import hypot
from typing import Any, ClassVar

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.described import Described, checked, described, described_fields, documented, fields_of
from warpgrains.base.errors import InputError
from warpgrains.space.geometry import Ends, Period
from warpgrains.space.region import Region
from warpgrains.walls.container import space_of
from warpgrains.walls.line import Line
from warpgrains.walls.motion import AT_REST
from warpgrains.walls.row import MOST_SHOWN, Row
from warpgrains.walls.wall import Wall

PERIODIC = ("", "x", "y", "xy")
SIDES = {"left": (0, 1.0), "right": (0, -1.0), "bottom": (1, 1.0), "top": (1, -1.0)}
"""For each side, the component (0 is x) and the sign of the direction from the side to the grains."""
_OF_LINES = [name for name in described_fields(Wall) if name not in ("angular_velocity", "pivot", "name")]
"""The keys that all kinds of walls have and that the table of a side may contain."""


def _roughness(field: str, value: Any) -> dict[str, float]:
    if not isinstance(value, Mapping) or set(value) != {"radius", "spacing"}:
        raise InputError(f"{field} is {checks.shown(value)}: it must be {{radius = ..., spacing = ...}}")
    return {key: checks.positive(f"{field}.{key}", given) for key, given in value.items()}


OF_SIDES = {key: Line.keys()[key].metadata["check"] for key in (*_OF_LINES, "mass")}
OF_SIDES |= {"pressure": checks.number, "roughness": _roughness}
"""The keys of a side, with their checks."""


def _side(field: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"{field} is {checks.shown(value)}: it must be a table of keys such as friction")
    for key in value:
        checks.one_of(f"key of {field}", key, OF_SIDES)
    given = {key: own for key, own in value.items() if own is not None}
    if len(given.keys() & {"pressure", "mass"}) == 1:
        missing = "pressure" if "mass" in given else "mass"
        raise InputError(
            f"{field}.{missing} is missing: a side that moves needs a pressure [N/m] and a mass [kg]"
        )
    return {key: OF_SIDES[key](f"{field}.{key}", own) for key, own in given.items()}


def _quoted(names: Sequence[str]) -> str:
    """Return names as text, such as "``a``, ``b`` and ``c``"."""
    *most, last = [f"``{name}``" for name in names]
    return f"{', '.join(most)} and {last}"


def _side_field(meaning: str) -> Any:
    return described(meaning, check=_side, default=None)


@dataclass(frozen=True)
class Box(Described):
    """A rectangle with sides along the axes, of which two opposite ones, or all, may be periodic.

    Grains that leave the box through a periodic side enter it through the opposite side. Positions in states
    are not wrapped: they continue beyond a periodic side.

    Parameters
    ----------
    {fields}

    Raises
    ------
    InputError
        A value is invalid.

    Examples
    --------
    >>> shear = wg.Box((0.0, 1.0), (0.0, 0.5), periodic="x", top={"velocity": (0.2, 0.0)})
    >>> scene = wg.Scene(position=[[0.1, 0.2]], radius=0.1, mass=0.1, domain=shear, friction=0.5)
    >>> scene.wall_names
    ('bottom', 'top')
    """

    kind: ClassVar[str] = "box"
    x: Ends = described("Where a box begins and ends along x [m].", check=checks.interval)  # noqa: RUF009
    y: Ends = described("The same along y [m].", check=checks.interval)  # noqa: RUF009
    periodic: str = described(
        'Directions in which a box is periodic: "x", "y" or "xy"; by default none.',
        check=lambda field, value: checks.one_of(field, value, PERIODIC),
        default="",
    )
    left: Mapping[str, Any] | None = _side_field(
        f"Left side of a box, unless it is periodic: a table of keys of a wall, {_quoted(_OF_LINES)};"
        " ``pressure``, in N/m, and ``mass``, in kg, of a side that moves under it; and ``roughness``, half"
        " discs on it, with ``radius`` and ``spacing``, in m."
    )
    right: Mapping[str, Any] | None = _side_field("Right side, as ``left``.")
    bottom: Mapping[str, Any] | None = _side_field("Lower side, as ``left``.")
    top: Mapping[str, Any] | None = _side_field("Upper side, as ``left``.")

    def __post_init__(self) -> None:
        for name, own in described_fields(type(self)).items():  # the sides come last
            value = getattr(self, name)
            if name in SIDES and value is not None and "xy"[SIDES[name][0]] in self.periodic:
                raise InputError(
                    f"domain.{name} is given, and domain.periodic is {self.periodic!r}: a periodic side has"
                    " no wall, so remove one of them"
                )
            vars(self)[name] = checked(f"domain.{name}", own, value)

    def __hash__(self) -> int:
        return hash((self.x, self.y, self.periodic))

    def __str__(self) -> str:
        beyond = f", periodic in {' and '.join(self.periodic)}" if self.periodic else ""
        return f"box of {self.lengths[0]:g} m by {self.lengths[1]:g} m{beyond}"

    @property
    def table(self) -> dict[str, Any]:
        """Keys and values of the box in a `[domain]` section, without defaults."""
        own = {name: getattr(self, name) for name in described_fields(type(self))}
        return {"kind": self.kind} | {name: value for name, value in own.items() if value not in ("", None)}

    @property
    def lengths(self) -> Ends:
        """Lengths of the sides along x and y [m]."""
        return self.x[1] - self.x[0], self.y[1] - self.y[0]

    @property
    def period(self) -> Period:
        """The periodic cell, whose images continue the scene."""
        return Period(self.x if "x" in self.periodic else None, self.y if "y" in self.periodic else None)

    @property
    def space(self) -> Region:
        """The space between the sides at the start, in which layouts place grains."""
        return space_of(tuple(self.walls), self.period, self.reach)

    @property
    def size(self) -> str:
        """Text that describes the size of the box. Error messages begin with it."""
        return f"domain is up to {self.reach / 2.0:g} m from the origin"

    @property
    def reach(self) -> float:
        """Upper bound of the distance of positions from the origin [m], the scale of rounding errors.

        It is twice the distance of the farthest corner, because sides may move outwards.
        """
        return 2.0 * hypot(*(max(map(abs, ends)) for ends in (self.x, self.y)))

    @property
    def widest(self) -> float:
        """Longest side of the box [m]."""
        return max(self.lengths)

    @property
    def walls(self) -> tuple[Wall, ...]:
        """The walls of all sides at the start."""
        return tuple(wall for own in self.sides.values() for wall in own)

    def require_fits(self, radius: FloatArray) -> None:
        """Raise InputError if the largest grain does not fit; radii [m], shape (n,).

        The box must be longer than its diameter, and in a periodic direction longer than twice that.
        """
        largest = int(radius.argmax())
        width = 2.0 * float(radius[largest])
        for name, length in zip("xy", self.lengths, strict=True):
            least = 2.0 * width if name in self.periodic else width
            if not length > least:
                raise InputError(
                    f"domain.{name} is {getattr(self, name)} m: it must be longer than {least} m for grain"
                    f" {largest} of radius {radius[largest]} m{', because it is periodic' * (least > width)}"
                )

    @cached_property
    def sides(self) -> dict[str, tuple[Wall, ...]]:
        """The walls of each side that is not periodic."""
        open_sides = [name for name, (component, _) in SIDES.items() if "xy"[component] not in self.periodic]
        return {name: self._walls_of(name, dict(getattr(self, name) or {})) for name in open_sides}

    def completed(
        self,
        walls: tuple[Wall, ...],
        was: Box | None = None,
        sides: Sequence[Wall] = (),
        time: float = 0.0,
    ) -> tuple[Wall, ...]:
        """Return `walls`, followed by the walls of all sides whose names no wall in `walls` has.

        Box `was` is the one that this box replaces at `time` [s], and `sides` are the walls of its sides at
        that time. Walls of sides that the new box does not change keep their places, as do rows whose discs
        it does not change. InputError if a wall has the name of a side but differs from its wall.
        """
        found = [*walls]
        for name in SIDES:
            own = self.sides.get(name, ())
            given = tuple(wall for wall in walls if wall.name == name)
            if not given:
                before = was.sides.get(name, ()) if was else ()
                present = (wall for wall in sides if wall.name == name)
                kept = [_continued(time, *each) for each in zip(own, before, present, strict=False)]
                found += (*kept, *own[len(kept) :])
            elif given != own and [*map(_at_start, given)] != [*map(_at_start, own)]:
                raise InputError(
                    f"walls[{walls.index(given[0])}] has the name {name}, that of a side of the box: choose"
                    f" another name, or give domain.{name} to change the side"
                )
        return tuple(found)

    def _walls_of(self, name: str, given: dict[str, Any]) -> tuple[Wall, ...]:
        component, sign = SIDES[name]
        length = self.lengths[1 - component]
        x, y = 0.5 * sum(self.x), 0.5 * sum(self.y)
        at = self.x if component == 0 else self.y
        own_place = at[0 if sign > 0.0 else 1]
        point = (own_place, y) if component == 0 else (x, own_place)
        normal = (sign, 0.0) if component == 0 else (0.0, sign)
        own = {key: given[key] for key in (*_OF_LINES, "mass") if key in given}
        try:
            line = Line(point, normal, length, name=name, pressure=given.get("pressure"), **own)
            return line, *(self._rows(line, **given["roughness"]) if "roughness" in given else ())
        except InputError as error:
            raise InputError(f"domain.{name}: {error}") from None

    def _rows(self, line: Line, radius: float, spacing: float) -> Iterator[Wall]:
        """Yield the half discs on a side as two rows of discs of the same radius [m], which alternate.

        `spacing` is the wanted distance of neighbors [m]. It is changed so that the side is a whole number of
        spacings of a row long.
        """
        largest = max(line.length, *map(abs, line.point))
        if spacing < (least := 2.0 * largest / MOST_SHOWN):
            raise InputError(f"roughness.spacing is {spacing} m: it must be at least {least:.3g} m")
        # a whole number of steps, so that the discs continue beyond periodic sides
        fewest = max(1, int(line.length / (2.0 * spacing)))
        steps = (line.length / count for count in (fewest, fewest + 1))
        step = min(steps, key=lambda step: abs(0.5 * step - spacing))
        if step < 2.0 * radius:
            rounded = "" if spacing < radius else f" ({0.5 * step:.6g} m, to divide the side)"
            raise InputError(
                f"roughness.spacing is {spacing} m{rounded}: it must be greater, because discs of radius"
                f" {radius} m would overlap"
            )
        common: dict[str, Any] = {own.name: getattr(line, own.name) for own in fields(Wall)}
        (x, y), (tx, ty) = line.point, line.along
        for way in (-0.25 * step, 0.25 * step):
            yield Row((x + way * tx, y + way * ty), (step * tx, step * ty), radius, line.length, **common)


documented(described_fields(Box).values())(Box)


def _continued(time: float, wall: Wall, before: Wall, present: Wall) -> Wall:
    """Return a wall of a side for `wall` of a new box, which replaces the same wall of the old box.

    The old wall was `before` at the start, and is `present` at `time` [s]. If nothing changes, `present` is
    returned. A row with the same discs but other settings is moved to the place of `present`.
    """
    if wall == before:
        return present
    if isinstance(wall, Row) and isinstance(present, Row) and wall.numbers == before.numbers:
        return replace(wall, point=present.at(time).point)
    return wall


def _at_start(wall: Wall) -> Wall:
    """Return a wall of a side with its motion and its `point` set to default values.

    Two walls that differ only in what time changes are then equal.
    """
    return replace(wall, **AT_REST | {"point": (0.0, 0.0)}) if hasattr(wall, "point") else wall


def checked_domain(field: str, value: Any) -> Box | None:
    """Return a box from a Box or the keys of a `[domain]` section; None for None, which means an annulus."""
    if value is None or isinstance(value, Box):
        return value
    if not isinstance(value, Mapping):
        raise InputError(f"{field} is {checks.shown(value)}: it must be a Box, or a table of its keys")
    own = {key: given for key, given in value.items() if key != "kind"}
    return Box(**fields_of(field, own, "a box", described_fields(Box)))
