"""The common base of all kinds of walls. Each kind has a file, such as disc.py."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import Field, dataclass, replace
from functools import cache
from itertools import product
from math import dist, inf
from typing import Any, ClassVar, NamedTuple, Self, TypeVar, dataclass_transform

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import BoolArray, FloatArray, Indices
from warpgrains.base.described import checked, described, described_fields, documented
from warpgrains.base.errors import InputError
from warpgrains.space.geometry import NOWHERE, Circle, Period, Side, left_of
from warpgrains.walls.band import Band
from warpgrains.walls.motion import Motion

Vector = tuple[float, float]

MOST_NUMBERS = 6  # largest count of numbers of a kind of wall, as on the device (kernels/types.py)
SHAPE = 1 + MOST_NUMBERS + 3  # length of a shape: the kind of wall, its numbers and a circle

_NAME = re.compile(r"[a-z][A-Za-z0-9_]*")  # valid in USD; default names of walls begin with a capital

Kind = TypeVar("Kind")


class Image(NamedTuple):
    """A periodic image of a wall, which a scene holds as a separate wall.

    It exists if a wall is so wide that a grain can touch it and its image at the same time.
    """

    of: int
    """Index in `Scene.walls` of the wall of which this is an image."""
    steps: tuple[int, int]
    """Displacement of this image from the wall's image nearest to a grain, in periods along x and y."""


class Drive(NamedTuple):
    """Mass, force and pressure that drive a wall (kernels/types.py, `Drive`)."""

    inverse_mass: float = 0.0
    """1 / mass [1/kg]; 0 if no force acts on the wall."""
    force: float = 0.0
    """Force along `direction` [N]."""
    pressure: float = 0.0
    """Pressure on the outer circle, or on the length of a line [N/m]."""
    length: float = 0.0
    """Length of a line on which the pressure acts [m]. It has no effect if two lines bound the line."""
    between: tuple[int, int] = (0, 0)
    """The bodies of the two lines that bound the length of the line; (0, 0) without them."""
    direction: tuple[float, float] = (0.0, 0.0)
    """Unit vector along which the force moves the wall; (0, 0) for the outer circle, whose radius changes."""
    leader: int = 0
    """The body whose speed and coordinate the wall takes, see `leaders_of` in bodies.py."""

    @property
    def given_force(self) -> float:
        """Force on a straight wall, if the pressure acts on the given `length` [N]."""
        return self.force + self.pressure * self.length


def checked_name(field: str, name: Any) -> str:
    """Return a name if USD and `--set` accept it; raise InputError otherwise."""
    if not _NAME.fullmatch(checks.text(field, name)):
        raise InputError(
            f"{field} is {checks.shown(name)}: it must be letters, digits and _, with a small letter first"
        )
    return str(name)


@dataclass(frozen=True, kw_only=True, repr=False)
class Wall(Motion):
    """A wall inside the domain, with the keys of its `[[walls]]` table as fields.

    A kind is a subclass with the decorator `kind_of_wall`. It defines `kind`, `kind_number`, `border` if it
    fills a disc, and the methods below that raise NotImplementedError. These methods describe the wall at
    its place before it moves.
    """

    kind: ClassVar[str]
    kind_number: ClassVar[int]
    """Number of the kind on the device (kernels/walls/shapes.py)."""
    takes_joints: ClassVar[bool] = True
    """Whether there is a joint where an end of another wall lies on a wall of this kind."""
    friction: float | None = described(
        "Coefficient of friction of the wall; by default that of the scene at walls.",
        check=checks.not_negative,
        default=None,
        mark="inherited",
    )
    rolling_friction: float | None = described(
        "Coefficient of rolling friction of the wall; by default that of the scene at walls.",
        check=checks.not_negative,
        default=None,
        mark="inherited",
    )
    restitution: float | None = described(
        "Coefficient of restitution of the wall; by default that of the scene at walls.",
        check=checks.fraction,
        default=None,
        mark="inherited",
    )
    name: str | None = described(
        "Name of the wall; forces on walls of one name are added up. By default each has its own, such as"
        " Segment0.",
        check=checked_name,
        default=None,
    )

    image: Image | None = None
    """The wall of which this wall is a periodic image; None if it is no image."""

    def __post_init__(self) -> None:
        for key, own in self.keys().items():
            vars(self)[own.name] = checked(f"{key} of {self.one()}", own, getattr(self, own.name))
        self.require_motion(self.one())

    def images(self, number: int, period: Period, radius: float) -> Iterator[Self]:
        """Yield the periodic images of the wall that a grain can touch together with the wall itself.

        The radius of such a grain is at most `radius` [m]. The wall has the given number in `Scene.walls`.
        There are images along a period if the wall plus four radii is wider than the period.
        """
        width = np.add(self.widths, 4.0 * radius)
        is_wide = period.repeats & (width < inf) & (width > period.lengths)
        for steps in product(*((0, 1, -1) if wide else (0,) for wide in is_wide.tolist())):
            if any(steps):
                yield replace(self, image=Image(number, (steps[0], steps[1])))

    @classmethod
    def one(cls) -> str:
        """Return the kind with its article, such as "an arc", for messages."""
        return f"a{'n' * (cls.kind[0] in 'aeiou')} {cls.kind}"

    @classmethod
    @cache
    def keys(cls) -> dict[str, Field[Any]]:
        """Return the described fields of this kind of wall, by their keys in a scene file."""
        return {own.metadata.get("key", own.name): own for own in _own_first(cls)}

    @property
    def table(self) -> dict[str, Any]:
        """Keys and values of the wall in a `[[walls]]` table of a scene file, without defaults."""
        return {"kind": self.kind} | {key: getattr(self, own.name) for key, own in self._given()}

    def __repr__(self) -> str:
        values = ", ".join(f"{own.name}={getattr(self, own.name)!r}" for _, own in self._given())
        return f"{type(self).__name__}({values})"

    def _given(self) -> list[tuple[str, Field[Any]]]:
        """Return (key in scene files, field) of every field whose value is not the default."""
        return [(key, own) for key, own in self.keys().items() if getattr(self, own.name) != own.default]

    @property
    def border(self) -> Circle | None:
        """Circle between the grains and the area that the wall fills; None for a wall that fills no area."""
        return None

    @property
    def drive(self) -> Drive | None:
        """Force and mass that drive the wall, or None if no force acts on it."""
        return None

    def changed(self, values: Mapping[str, Any]) -> Self:
        """Return the wall with some valid values replaced. Checks, which would be slow, are omitted."""
        wall = object.__new__(type(self))
        vars(wall).update({**vars(self), **values})
        return wall

    def driven_to(self, coordinate: float, direction: Vector) -> Self:
        """Return the wall displaced by a coordinate [m] along a unit vector, see `State.driven`."""
        x, y = coordinate * direction[0], coordinate * direction[1]
        return self.changed({name: (own[0] + x, own[1] + y) for name, own in self._places.items()})

    @property
    def coordinate(self) -> float:
        """Coordinate of a driven wall at the start, see `State.driven` [m]."""
        return 0.0

    @property
    def _places(self) -> dict[str, Any]:
        """The fields that are positions [m] and have a value, by name."""
        names = ("center", "point", "start", "end", "pivot")
        return {name: getattr(self, name) for name in names if getattr(self, name, None)}

    def starting(self, time: float) -> Self:
        """Return the wall with `start_time` set to `time` [s], if the wall moves and has none."""
        return self.changed({"start_time": time}) if self.moves and self.start_time is None else self

    def at(self, time: float) -> Self:
        """Return the wall at its place at `time` [s], with the motion that continues from there."""
        if not self.moves or time <= self.starts_at:
            return self
        pose = self.pose(time)
        places = pose.place(np.array([*self._places.values()])).tolist()
        moved: dict[str, Any] = dict(zip(self._places, map(tuple, places), strict=True))
        angles = ("from_angle", "to_angle")
        moved |= {name: getattr(self, name) + pose.angle for name in angles if hasattr(self, name)}
        return self.changed({**moved, **self.from_then(time)})

    @property
    def speed(self) -> float:
        """Largest speed at which the wall changes its place [m/s]; rotation in place does not count."""
        return self.largest_speed(self.farthest(self.about))

    def places(self, position: FloatArray, period: Period, time: float = -inf) -> FloatArray:
        """Transform points [m], shape (n, 2), into the frame of the wall, which moved until `time` [s].

        In a periodic scene, the image of a point that is nearest to the wall is returned. If this wall is
        itself a periodic image, that point is shifted by `image.steps` periods (kernels/walls/walls.py,
        `place_at`).
        """
        place = self.pose(time).to_frame(position) if self.moves else position
        if not period or self.circle[2] == inf:
            return place
        center = np.array(self.circle[:2])
        nearest = center + period.nearest(place - center)
        return nearest if self.image is None else nearest + period.lengths * self.image.steps

    def velocity_at_contacts(
        self, step: tuple[float, float, float], position: FloatArray, hollow: FloatArray, normal: FloatArray
    ) -> FloatArray:
        """Return the speeds of the wall along normal and tangent of contacts [m/s], shape (n, 2) (eq. 26b).

        `step` holds begin, end and length of the step [s], `position` the contact points [m], and `hollow`
        the radii of curvature of the wall there, see `hollow_radii`.
        """
        if not self.moves:
            return np.tile((0.0, self.surface_speed), (len(position), 1))
        begin, end, dt = step
        velocity = self.velocities(position - hollow[:, np.newaxis] * normal, begin, end, dt)
        turning = hollow * (self.angular_velocity * self.share(begin, end))
        return np.stack([(velocity * normal).sum(1), (velocity * left_of(normal)).sum(1) + turning], axis=1)

    @property
    def surface_speed(self) -> float:
        """Speed of the surface of a wall that rotates in place, along the tangent [m/s] (eq. 23)."""
        return 0.0

    @property
    def rotation(self) -> float:
        """Angular velocity of a wall that rotates in place [rad/s]."""
        return 0.0

    def side_at(
        self, time: float, position: FloatArray, radius: FloatArray, period: Period = NOWHERE
    ) -> Side:
        """Return normals and gaps of grains at the wall, at its place at a time [s], see `Scene.side`."""
        normal, gap = self.side(self.places(position, period, time), radius)
        return Side(self.pose(time).turn(normal) if self.moves else normal, gap)

    @property
    def shape(self) -> tuple[float, ...]:
        """Kind, numbers and circle of the wall: its `SHAPE` numbers on the device (kernels/types.py)."""
        assert len(self.numbers) <= MOST_NUMBERS, f"{self.one()} has {len(self.numbers)} numbers"
        unused = (0.0,) * (MOST_NUMBERS - len(self.numbers))
        return (float(self.kind_number), *self.numbers, *unused, *self.circle)

    @property
    def numbers(self) -> tuple[float, ...]:
        """Numbers that define the shape for the kernels, at most `MOST_NUMBERS` (kernels/types.py)."""
        raise NotImplementedError

    @property
    def circle(self) -> tuple[float, float, float]:
        """Center and radius of a circle about all points at which grains touch the wall [m]."""
        raise NotImplementedError

    @property
    def widths(self) -> tuple[float, float]:
        """Sides, along x and y, of a box about the wall [m]. The center of the box is that of `circle`."""
        return 2.0 * self.circle[2], 2.0 * self.circle[2]

    def farthest(self, point: tuple[float, float]) -> float:
        """Return the largest distance [m] from the pivot `point` to a part of the wall that turning moves."""
        raise NotImplementedError

    def side(self, position: FloatArray, radius: FloatArray) -> Side:
        """Return normals and gaps of grains at the wall, see `Scene.side`."""
        raise NotImplementedError

    @property
    def ends(self) -> FloatArray:
        """The ends 0 and 1 [m], shape (2, 2); shape (0, 2) for a wall without ends."""
        return np.zeros((0, 2))

    @property
    def inwards(self) -> FloatArray:
        """Unit vectors along the wall at its two ends, pointing away from the end, shape (2, 2)."""
        raise NotImplementedError

    def end_of(self, position: FloatArray) -> Indices:
        """Return which end of the wall is nearest to each position, shape (n,): 0, 1, or -1.

        -1 means that a point between the ends is nearer.
        """
        return np.full(len(position), -1)

    def hollow_radii(self, position: FloatArray) -> FloatArray:
        """Return radii of curvature of the wall where it is nearest to each position [m], shape (n,).

        They are > 0 on a hollow face, < 0 on a convex one, and 0 on a straight face or at an end.
        """
        return np.zeros(len(position))

    def face_normals(self, point: FloatArray, position: FloatArray) -> FloatArray:
        """Return the unit normal, at `point` of the wall, of the face towards each position, shape (n, 2).

        It points into the wall, and is 0 for a convex face.
        """
        raise NotImplementedError

    def covers(self, position: FloatArray) -> BoolArray:
        """Return which positions are in or on the wall, shape (n,)."""
        return ~(self.side(position, np.zeros(len(position))).gap > 0.0)

    def complaint(self, number: int) -> str:
        """Return the message for a grain with its center in this wall, which has this number in the scene."""
        return f"its center is inside walls[{number}], {self.named(number)}"

    def named(self, number: int) -> str:
        """Return the name of the wall; without one, its kind and its number, such as Segment0."""
        return self.name or f"{self.kind.title()}{self.image.of if self.image else number}"

    def drawn(self, thickness: float) -> Band:
        """Return the drawing of the wall, with this thickness [m], where it is before it moves."""
        raise NotImplementedError


class InfiniteWall(Wall):
    """A wall that continues without end on both sides of its `point`, and does not turn."""

    point: tuple[float, float]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.angular_velocity != 0.0:
            given = f"angular_velocity of {self.one()} is {self.angular_velocity} rad/s"
            raise InputError(f"{given}: it is infinite")

    @property
    def circle(self) -> tuple[float, float, float]:
        return (*self.point, inf)

    @property
    def middle(self) -> tuple[float, float]:
        return self.point

    def farthest(self, point: tuple[float, float]) -> float:
        return dist(self.point, point)


@dataclass(frozen=True, kw_only=True, repr=False)
class StraightWall(Wall):
    """A straight wall that a force may drive along `across`, its normal."""

    force: float | None = described(
        "Force that drives the wall along its normal [N], which is to the left of the way from one end to the"
        " other of a segment; by default no force does.",
        check=checks.number,
        default=None,
    )
    mass: float | None = described(
        "Mass of a wall that a force drives [kg].", check=checks.positive, default=None
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        has_force = self.force is not None or getattr(self, "pressure", None) is not None
        if has_force != (self.mass is not None):
            missing = "mass" if has_force else "force"
            told = "a wall that a force drives needs a force [N] and a mass [kg]"
            raise InputError(f"{missing} of {self.one()} is missing: {told}")

    @property
    def across(self) -> tuple[float, float]:
        """Unit vector along which the force drives the wall."""
        raise NotImplementedError

    @property
    def drive(self) -> Drive | None:
        if self.force is None or self.mass is None:
            return None
        return Drive(1.0 / self.mass, self.force, direction=self.across)


@dataclass_transform(frozen_default=True, field_specifiers=(described,))
def kind_of_wall(kind: type[Kind]) -> type[Kind]:
    """Turn a class into a frozen dataclass, and list its described fields in its docstring."""
    frozen = dataclass(frozen=True, repr=False)(kind)
    return documented(_own_first(frozen))(frozen)


def _own_first(kind: type) -> list[Field[Any]]:
    """Return the described fields of a kind of wall: first its own fields, then those of all walls."""
    return sorted(described_fields(kind).values(), key=lambda own: own.kw_only is True)
