"""`Scene`, the immutable and checked description of a simulation."""

import os
from collections.abc import Collection, Iterable, Mapping, Set
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self, Unpack

import numpy as np
from numpy.typing import ArrayLike

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray, Indices
from warpgrains.base.described import documented, fields_in_help
from warpgrains.base.errors import InputError, written_as
from warpgrains.base.shown import Shown, number_of
from warpgrains.scene.compatibility import (
    allowed_overlap,
    require_compatible_settings,
    require_valid_positions,
    require_valid_walls,
)
from warpgrains.scene.fields import (
    FIELDS,
    KEY_OF,
    OF_ANNULUS,
    SceneChanges,
    SceneFields,
    SceneOptions,
    boundary_of,
    checked_fields,
)
from warpgrains.scene.gravity import TurningGravity, upwards
from warpgrains.scene.reader import document_fields, scene_document
from warpgrains.scene.toml import read_text
from warpgrains.space.geometry import ROUNDING, Period, Side, distance, overlapping_pairs
from warpgrains.space.region import Region
from warpgrains.walls import container
from warpgrains.walls.annulus import Annulus
from warpgrains.walls.bodies import Bodies, Joints, joints_of, leaders_of, with_images
from warpgrains.walls.box import Box, checked_domain
from warpgrains.walls.kinds import checked_walls
from warpgrains.walls.line import Line
from warpgrains.walls.rim import Rim
from warpgrains.walls.wall import Drive, Wall


@fields_in_help
class Overlaps(NamedTuple):
    """Overlaps at the start of a scene, which the first step turns into speeds, see `separate`."""

    pairs: int
    """Number of pairs of grains that overlap."""
    walls: int
    """Number of grains that overlap a wall."""
    largest: float
    """Largest overlap [m]; 0 if there is none."""


@documented(FIELDS.values())
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Scene(SceneFields, Shown):
    """Rigid discs in an annulus centered on the origin or in a box, and the settings of their simulation.

    Arrays are copied and cannot be written to afterwards.

    Parameters
    ----------
    {fields}

    Raises
    ------
    InputError
        A value is invalid. The message names the field, the grain and the value.

    Examples
    --------
    >>> scene = wg.Scene(position=[[0.9, 0.1], [-0.8, 0.4]], radius=0.1, mass=0.1, radius_out=2.0)
    >>> scene.n, scene.radius.shape, scene.count_overlaps().pairs
    (2, (2,), 0)
    >>> scene.replace(drag=0.5).drag
    0.5
    >>> wg.Scene.load("annulus", ["physics.drag=0.1"]).drag
    0.1
    """

    if TYPE_CHECKING:  # callers may pass more types than those of the fields

        def __init__(
            self,
            *,
            position: ArrayLike,
            radius: ArrayLike,
            mass: ArrayLike,
            **options: Unpack[SceneOptions],
        ) -> None: ...

    def __post_init__(self) -> None:
        self._check(FIELDS.keys())
        with np.errstate(all="ignore"):
            require_valid_positions(self)

    @classmethod
    def made(cls, values: Mapping[str, Any], checked: Set[str] = FIELDS.keys()) -> Self:
        """Return a scene from the values of all fields; check only the fields that are named in "checked".

        Positions are not checked against walls, because in a later state both may be elsewhere.
        """
        scene = object.__new__(cls)
        vars(scene).update(values)
        scene._check(checked)
        return scene

    def _check(self, names: Set[str]) -> None:
        """Check the fields `names` and store them, with the walls, sources and sinks that follow from them.

        The other fields hold checked values already. Without names, do nothing.
        """
        if not names:
            return
        with np.errstate(all="ignore"):  # the checks report values that are not finite
            vars(self).update(checked_fields(self, names))
            if not names.isdisjoint(_OF_WALLS):
                walls = self.boundary.completed(self.written_walls)
                walls = tuple(wall.starting(self.time) for wall in walls)
                vars(self)["walls"] = with_images(walls, self.period, float(self.radius.max()))
                require_valid_walls(self)
            if not names.isdisjoint(("sources", "sinks", "time")):
                vars(self)["sources"] = tuple(source.starting(self.time) for source in self.sources)
                vars(self)["sinks"] = tuple(sink.starting(self.time) for sink in self.sinks)
            require_compatible_settings(self)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self).made, ({name: getattr(self, name) for name in FIELDS},)  # copies are read-only

    @classmethod
    def load(cls, name_or_path: str | os.PathLike[str], overrides: str | Iterable[str] = ()) -> Self:
        """Read a scene from a TOML file, or a shipped scene by its name.

        Parameters
        ----------
        name_or_path
            A file or the name of a shipped scene, such as "annulus".
        overrides
            Values that replace those of the file: a text "section.key=value", such as "physics.drag=0.1", or
            several.

        Raises
        ------
        InputError
            The scene does not exist, cannot be read, or is invalid.
        """
        if isinstance(overrides, str):
            overrides = (overrides,)
        elif not np.iterable(overrides) or isinstance(overrides, Mapping):
            given = checks.shown(overrides)
            raise InputError(f"overrides is {given}: it must be strings such as 'physics.drag=0.1'")
        texts = [checks.text(f"overrides[{k}]", override) for k, override in enumerate(overrides)]
        path = Path(checks.path("scene", name_or_path))
        document, own = scene_document(read_text(path, "scene"), path, texts)
        with written_as(KEY_OF, str(path)):
            return cls(**document_fields(document, path.parent), **own)

    def _valid(self, changes: Collection[str]) -> dict[str, Any]:
        """Return what a scene with these fields changed can take over, by name.

        These are the values of all fields and, unless `changes` names one of `_OF_BODIES`, those of cached
        properties.
        """
        own = vars(self)
        return own if _OF_BODIES.isdisjoint(changes) else {name: own[name] for name in FIELDS}

    def placed(self, driven: FloatArray | None, time: float | None = None, **grains: FloatArray) -> Self:
        """Return the scene with walls moved to their present places, and with other `grains`.

        `driven` holds the coordinates of all walls [m], see `State.driven`; with None, walls that forces
        drive stay. With a time [s], the scene starts at it, and walls with prescribed motion move there.
        """
        if driven is None and time is None and not grains:
            return self
        walls, changes = self.walls, dict[str, Any](grains)
        if driven is not None:
            walls = changes["walls"] = tuple(
                wall.driven_to(float(driven[leader]), drive.direction) if drive.inverse_mass else wall
                for wall, drive, leader in zip(walls, self.drives, self.leaders, strict=True)
            )
            outer = next((own for own in walls if isinstance(own, Rim) and own.inside), None)
            changes |= {} if outer is None else {"radius_out": outer.radius}
        if time is not None:
            text = self.text_after(("time", "walls", *grains))
            changes |= {"time": time, "walls": tuple(wall.at(time) for wall in walls), "text": text}
        else:
            changes |= {name: found for name, found in vars(self).items() if name in ("joints", "leaders")}
        return self.made(self._valid(changes) | changes, checked=set())

    def replace(self, **changes: Unpack[SceneChanges]) -> Self:
        """Return a copy of the scene with some fields changed and checked.

        Its `text` lists the changed fields.

        Raises
        ------
        InputError
            A field is unknown or a value is invalid.
        """
        for name in changes:
            checks.one_of("field of a scene", name, FIELDS)
        given: dict[str, Any] = {"text": self.text_after(changes), **changes}
        if "position" in changes and not self.has_friction:
            given.setdefault("spin", None)  # it is 0, for any number of grains
        scene = self.changed(given, changes.get("time", self.time))
        if "position" in changes or not _OF_WALLS.isdisjoint(changes):
            require_valid_positions(scene)
        return scene

    def changed(self, changes: dict[str, Any], time: float) -> Self:
        """Return a copy with some fields changed and checked. Positions are not checked against walls.

        Sides of a box that do not change continue from their present places. Other walls begin to move at
        `time` [s].
        """
        if not changes.keys().isdisjoint(("domain", "walls")):
            was = self.domain
            inside = [wall for wall in self.walls if not (was and wall.name in was.sides)]
            walls = checked_walls("walls", changes.get("walls", inside))
            box = checked_domain("domain", changes.get("domain", was))
            walls = box.completed(walls, was, self.walls, time) if box else walls
            changes = ({"radius_out": None} if "domain" in changes else {}) | changes
            changes["walls"] = [wall.starting(time) for wall in walls]
        return self.made(self._valid(changes) | changes, changes.keys())

    def summary(self) -> dict[str, str]:
        """Return texts that describe the scene, with units, by name, such as "radius" and "drag"."""
        turning = f", turning at {self.gravity_rate:g} rad/s" if self.gravity_rate else ""
        return {
            self.name: f"of {number_of(self.n, 'grain')}",
            "radius": f"{_range(self.radius)} m",
            "mass": f"{_range(self.mass)} kg",
            "walls": str(self.boundary),
            "gravity": f"({self.gravity[0]:g}, {self.gravity[1]:g}) m/s2{turning}",
            "drag": f"{self.drag:g} kg/s",
            "dt": f"{self.dt:g} s",
            "duration": f"{self.duration:g} s",
        }

    @property
    def n(self) -> int:
        """Number of grains."""
        return len(self.position)

    @property
    def exchanges_grains(self) -> bool:
        """True if the scene has sources or sinks, so that the number of grains changes."""
        return bool(self.sources or self.sinks)

    @cached_property
    def smallest_radius(self) -> float:
        """Radius of the smallest grain [m]."""
        return float(self.radius.min())

    @cached_property
    def typical_radius(self) -> float:
        """Median radius [m]. NumPy's median takes 20 us, which counts for thousands of scenes."""
        ascending, half = np.sort(self.radius), self.n // 2
        return 0.5 * float(ascending[half] + ascending[-half - 1])

    @cached_property
    def has_equal_masses(self) -> bool:
        """True if all grains have the same mass."""
        return bool((self.mass == self.mass[0]).all())

    def time_after(self, steps: int) -> float:
        """Return the time after a number of steps [s]."""
        return self.time + steps * self.dt

    @property
    def gravity_rate(self) -> float:
        """Angular velocity at which gravity turns, counterclockwise [rad/s]; 0 if it is constant."""
        return self.gravity.angular_velocity if isinstance(self.gravity, TurningGravity) else 0.0

    def gravity_at(self, time: float) -> tuple[float, float]:
        """Return the acceleration of gravity at a time [m/s2] (MODEL.md, eq. 31)."""
        return self.gravity.at(time) if isinstance(self.gravity, TurningGravity) else self.gravity

    def up_at(self, time: float) -> FloatArray:
        """Return the unit vector against gravity at a time [s], without its component along a period.

        If no component of gravity is left, it is (0, 1), or (1, 0) in a box that is periodic only along y.
        """
        return upwards(np.array(self.gravity_at(time)), self.period.repeats)

    @cached_property
    def has_friction(self) -> bool:
        """True if contacts have friction, so that grains rotate."""
        return self.friction > 0.0 or bool(self.at_walls["friction"].any())

    @cached_property
    def has_rolling_friction(self) -> bool:
        """True if contacts have rolling friction."""
        return self.rolling_friction > 0.0 or bool(self.at_walls["rolling_friction"].any())

    @cached_property
    def has_restitution(self) -> bool:
        """True if contacts bounce."""
        return self.restitution > 0.0 or bool(self.at_walls["restitution"].any())

    @cached_property
    def at_walls(self) -> dict[str, FloatArray]:
        """Coefficients at the walls 0, 1, 2, ..., by name, such as "friction", shape (walls,) each.

        A coefficient is `wall.NAME`, by default `wall_NAME` of the scene or, if this is None, `NAME`.
        """
        found = {}
        for name in _OF_CONTACT:
            at_walls = getattr(self, f"wall_{name}")
            common = getattr(self, name) if at_walls is None else at_walls
            own = [getattr(wall, name) for wall in self.walls]
            found[name] = np.array([common if value is None else value for value in own], np.float64)
        return found

    @cached_property
    def has_moving_walls(self) -> bool:
        """True if a wall has a prescribed motion."""
        return any(wall.moves for wall in self.walls)

    @cached_property
    def has_driven_walls(self) -> bool:
        """True if a force or a pressure drives a wall."""
        return any(wall.drive is not None for wall in self.walls)

    @cached_property
    def joints(self) -> Joints:
        """The joints of the walls."""
        return joints_of(self.walls, self.period)

    @cached_property
    def bodies(self) -> Bodies:
        """The walls as bodies of the device."""
        return Bodies(self)

    def text_after(self, changed: Collection[str]) -> str:
        """Return the text of the scene with a comment that lists changed fields; "" if there is no text."""
        line = f"\n# changed afterwards: {', '.join(changed)}"
        return self.text + line if self.text and any(changed) and not self.text.endswith(line) else self.text

    def wall_speeds(self, position: FloatArray, wall: Indices, time: float) -> FloatArray:
        """Return the speeds of walls along the normal and the tangent of each contact [m/s], shape (m, 2).

        `wall` holds the grain and the wall of each contact, shape (m, 2), `position` the centers of all
        grains [m], and `time` is the start of the step [s] (MODEL.md, eq. 26b).
        """
        found = np.zeros(wall.shape)
        for number in np.unique(wall[:, 1]).tolist():
            own, moving = wall[:, 1] == number, self.walls[number]
            if moving.moves or moving.surface_speed:
                x, radius = position[wall[own, 0]], self.radius[wall[own, 0]]
                normal, gap = self.side(number, x, radius, time=time)
                hollow = moving.hollow_radii(moving.places(x, self.period, time))
                touched, step = x + (radius + gap)[:, np.newaxis] * normal, (time, time + self.dt, self.dt)
                found[own] = moving.velocity_at_contacts(step, touched, hollow, normal)
        return found

    @property
    def inertia(self) -> FloatArray:
        """Moment of inertia of each grain, a disc, m r^2 / 2 [kg m2], shape (n,)."""
        return np.multiply(0.5 * self.mass * self.radius, self.radius)

    @property
    def rim_mass(self) -> FloatArray:
        """Mass M in the law of spins [kg], shape (n,) (MODEL.md, eq. 22).

        A tangential impulse p at the rim changes the speed of the rim by 2 p / M.
        """
        return self.mass if self.scheme == "euler" else self.mass + self.spin_drag * self.dt / self.radius**2

    @property
    def contact_mass(self) -> FloatArray:
        """Mass M in the law of contacts [kg], shape (n,) (MODEL.md, eq. 17b).

        An impulse p of a contact changes the velocity of the grain by p / M.
        """
        return self.mass if self.scheme == "euler" else self.mass + self.drag * self.dt / 2.0

    @cached_property
    def boundary(self) -> Annulus | Box:
        """The annulus or box, which defines the last of the walls and the period."""
        return boundary_of(self)

    @cached_property
    def period(self) -> Period:
        """The periodic cell, whose images continue the scene."""
        return self.boundary.period

    def walls_at(self, time: float) -> tuple[Wall, ...]:
        """Return the walls at their places at a time [s], with the motions that continue from there."""
        return tuple(wall.at(time) for wall in self.walls)

    def space_at(self, time: float) -> Region:
        """Return the space between circles and lines as they are at a time [s]."""
        walls = tuple(wall.at(time) for wall in self.walls if isinstance(wall, Line | Rim))
        return container.space_of(walls, self.period, self.reach)

    @cached_property
    def reach(self) -> float:
        """Upper bound of the distance of positions from the origin [m], the scale of rounding errors."""
        return self.boundary.reach

    @property
    def rounding(self) -> float:
        """Largest overlap with a wall that counts as a rounding error [m]."""
        return ROUNDING * self.reach

    @property
    def widest(self) -> float:
        """Diameter of the annulus, or longest side of the box [m]."""
        return self.boundary.widest

    @property
    def area(self) -> float:
        """Area between circles and lines at the start, minus that of walls that are discs [m2]."""
        return container.without_discs(self.space_at(self.time), self.walls_at(self.time)).area

    @cached_property
    def leaders(self) -> list[int]:
        """For each wall, the index of the wall with which it moves.

        A row moves with a driven line of the same name, an image with its wall. Every other wall has its own
        index.
        """
        return leaders_of(self.walls)

    @cached_property
    def drives(self) -> list[Drive]:
        """The drive of each wall. Its numbers are all 0 if no force acts on the wall."""
        return [self.walls[leader].drive or Drive() for leader in self.leaders]

    @cached_property
    def mobile_walls(self) -> dict[int, Wall]:
        """Walls with a prescribed motion or a drive, by number in `walls`."""
        each = enumerate(zip(self.walls, self.drives, strict=True))
        return {number: wall for number, (wall, drive) in each if wall.moves or drive.inverse_mass}

    @property
    def written_walls(self) -> tuple[Wall, ...]:
        """Walls that files list: all except images and the circles of an annulus, which have keys."""
        return tuple(wall for wall in self.walls if not (wall.image or isinstance(wall, Rim)))

    @property
    def wall_names(self) -> tuple[str, ...]:
        """Names of the walls 0, 1, 2, ...; several walls may share a name."""
        return tuple(wall.named(number) for number, wall in enumerate(self.walls))

    def side(
        self,
        number: int,
        position: FloatArray,
        radius: FloatArray,
        move: FloatArray | None = None,
        time: float = 0.0,
        free: float | None = None,
    ) -> Side:
        """Return normals and gaps of k grains at one wall, from positions [m], shape (k, 2), and radii [m].

        With the displacements `move` of a step [m], shape (k, 2), a round outer circle has the gaps of eq.
        18. A wall with prescribed motion is taken at `time` [s]. Where a joint with another wall allows no
        contact (eq. 8c), `free` [m], by default twice the `reach`, is added to the gap.
        """
        wall = self.walls[number]
        if self.joints.of(number):
            free = 2.0 * self.reach if free is None else free
            return self.joints.side(number, time, position, radius, free)
        if isinstance(wall, Rim):
            return wall.side(position, radius, move)
        return wall.side_at(time, position, radius, self.period)

    def pair_frames(self, position: FloatArray, pair: Indices) -> tuple[FloatArray, FloatArray]:
        """Return normals from i to j and gaps [m], shapes (m, 2) and (m,), of pairs (i, j), shape (m, 2).

        `position` holds the centers of all grains [m], shape (n, 2).
        """
        i, j = pair.T
        way = self.period.nearest(position[j] - position[i])
        apart = distance(way)
        return way / apart[:, np.newaxis], apart - (self.radius[i] + self.radius[j])

    def wall_frames(
        self,
        position: FloatArray,
        wall: Indices,
        move: FloatArray | None = None,
        time: float = 0.0,
        free: float | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Return normals and gaps [m], shapes (m, 2) and (m,), of wall contacts (grain, wall), shape (m, 2).

        `position` holds the centers of all grains [m], shape (n, 2). For the other arguments, see `side`.
        """
        normal, gap = np.zeros(wall.shape), np.zeros(len(wall))
        for number in np.unique(wall[:, 1]).tolist():
            at_wall = wall[:, 1] == number
            grain = wall[at_wall, 0]
            own = None if move is None else move[grain]
            side = self.side(number, position[grain], self.radius[grain], own, time, free)
            normal[at_wall], gap[at_wall] = side
        return normal, gap

    @property
    def stops_on(self) -> str:
        """Quantity that the tolerance bounds: `stop`, or the default of the method."""
        default = "zeta" if self.method == "gauss-seidel" else "residual"
        return default if self.stop == "default" else self.stop

    @property
    def steps(self) -> int:
        """Number of time steps in `duration`."""
        return self.steps_in(self.duration)

    def steps_in(self, duration: float) -> int:
        """Return the number of time steps nearest to a duration [s]; InputError if it is 0 or too large."""
        steps = _steps_in(checks.positive("duration", duration), self.dt)
        if steps == 0:
            raise InputError(
                f"duration is {duration} s: it must be at least one step, dt, which is {self.dt} s"
            )
        if steps > (most := checks.LARGEST_WHOLE_NUMBER):
            raise InputError(f"duration is {duration} s: it must be at most {most} steps of {self.dt} s")
        return steps

    @property
    def bounces_at_start(self) -> bool:
        """True if contacts may bounce in the first step, which then gains no energy (MODEL.md, eq. 35a)."""
        e = self.at_walls["restitution"].max(initial=self.restitution)
        before = self.position - e * self.dt * self.velocity
        at_rest = [k for k, wall in enumerate(self.walls) if not wall.moves]
        deepest = self.count_overlaps(before, at_rest).largest
        return deepest <= allowed_overlap(self) or deepest <= self.count_overlaps(walls=at_rest).largest

    def bouncing_speed(self, is_first: bool) -> float:
        """Return the closing speed above which contacts bounce in a step [m/s].

        In the first step, it is inf unless `bounces_at_start`.
        """
        return inf if is_first and not self.bounces_at_start else self.restitution_speed

    def count_overlaps(
        self, position: FloatArray | None = None, walls: Iterable[int] | None = None
    ) -> Overlaps:
        """Count the overlaps between grains and with the walls, and find the largest.

        Parameters
        ----------
        position : ndarray, optional
            Centers of the grains [m], shape (n, 2); by default those at the start.
        walls : iterable of int, optional
            Numbers of walls, by default of all.
        """
        where = self.position if position is None else position, self.radius
        pairs = overlapping_pairs(*where, self.period)
        gaps = [self.pair_frames(where[0], np.stack(pair, axis=1))[1] for pair in pairs]
        numbers = range(len(self.walls)) if walls is None else walls
        sides = [self.side(k, *where, time=self.time).gap for k in numbers]
        at_walls = np.min([np.full(self.n, np.inf), *sides], axis=0)
        gaps.append(at_walls[at_walls < -self.rounding])
        return Overlaps(
            sum(map(len, gaps[:-1])), len(gaps[-1]), -float(np.concatenate(gaps).min(initial=0.0))
        )


_OF_WALLS = {"walls", "domain", "time", "radius", "mass", *OF_ANNULUS}
"""Fields that determine the walls. Images depend on radii, and the mass of the outer circle on masses."""
_OF_CONTACT = ("friction", "rolling_friction", "restitution")
_OF_BODIES = {*_OF_WALLS, *_OF_CONTACT, *(f"wall_{name}" for name in _OF_CONTACT)}
"""Fields on which cached properties depend. If none of them changes, all cached values stay valid."""

SceneLike = Scene | str | os.PathLike[str]
"""A scene, or a file or name that `Scene.load` accepts."""


def as_scene(field: str, value: Any) -> Scene:
    """Return a scene, or read the file or shipped scene of that name. Raises InputError for anything else."""
    if isinstance(value, str | os.PathLike):
        return Scene.load(value)
    if not isinstance(value, Scene):
        raise InputError(f"{field} is {checks.shown(value)}: it must be a Scene, or the file or name of one")
    return value


def _range(values: FloatArray) -> str:
    low, high = values.min(), values.max()
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


@lru_cache(1024)
def _steps_in(duration: float, dt: float) -> int:
    """Return round(duration / dt) for the decimals as written, so that 0.3 s is three steps of 0.1 s."""
    return round(Fraction(str(duration)) / Fraction(str(dt)))
