"""Sources and sinks: regions of a scene in which grains appear, and from which grains are taken."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import floor, inf
from typing import TYPE_CHECKING, Any, NamedTuple, Self, TypeVar

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import BoolArray, FloatArray
from warpgrains.base.described import (
    Described,
    checked,
    described,
    described_fields,
    documented,
    fields_in_help,
    fields_of,
)
from warpgrains.base.errors import InputError
from warpgrains.scene.layouts import MOST_GRAINS, fitting_radius
from warpgrains.scene.radii import drawn_radii
from warpgrains.space.geometry import distance
from warpgrains.space.region import RANGES, Region, ranges_of, region_of
from warpgrains.walls.wall import checked_name

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

ROUNDED = 1e-9  # tolerance of a number of grains, and of a time in intervals
Kind = TypeVar("Kind", bound="Exchange")


@fields_in_help
class Inflow(NamedTuple):
    """Numbers of grains of a source so far.

    Examples
    --------
    >>> fed = wg.Source(region={"y": (0.0, 1.0)}, radius=0.05, density=10.0, count=3)
    >>> filled = wg.Simulation(simulation.scene, sources=[fed])
    >>> report = filled.step()
    >>> filled.inflow
    [Inflow(due=3, entered=3, missed=0, waiting=0)]
    """

    due: int
    """Grains that should have appeared according to `count` and `rate`."""
    entered: int
    """Grains that appeared, including those that sinks fed."""
    missed: int
    """Due grains for which there was no room. They never appear."""
    waiting: int
    """Grains that sinks fed and that have not appeared yet. They appear when there is room."""


@fields_in_help
class Outflow(NamedTuple):
    """Grains that a sink has taken so far.

    Examples
    --------
    >>> right = wg.Sink(region={"x": (0.0, 2.0)})
    >>> drained = wg.Simulation(simulation.scene, sinks=[right])
    >>> report = drained.step()
    >>> drained.outflow[0].grains
    9
    """

    grains: int
    """Number of grains."""
    mass: float
    """Mass of these grains [kg]."""


def _number(field: str, value: Any) -> int:
    return checks.whole_number(field, value, least=0, most=MOST_GRAINS)


def _radius(field: str, value: Any) -> Any:
    if isinstance(value, Mapping):
        value = dict(value)
    else:
        value = checks.vector(field, value) if np.iterable(value) else checks.positive(field, value)
    with radius_named(field):
        drawn_radii(value, np.random.default_rng(0))
    return value


@contextmanager
def radius_named(field: str) -> Iterator[None]:
    """Replace "grains.radius", which checks of layouts name, by `field` in the message of an InputError."""
    try:
        yield
    except InputError as error:
        raise InputError(str(error).replace("grains.radius", field)) from None


@dataclass(frozen=True, kw_only=True)
class Exchange(Described):
    """The keys that sources and sinks share: a region, and the times at which grains are exchanged."""

    region: Mapping[str, Any] = described(
        "Ranges ``x``, ``y`` and ``distance`` from the origin [m], such as {x = [-0.1, 0.1]}.",
        check=ranges_of,
        such=", such as {x = [-1.0, 0.0]}",
    )
    interval: float = described(
        "Time between two exchanges [s], rounded to whole steps.", check=checks.positive, default=0.05
    )
    start_time: float | None = described(
        "Time at which it begins [s]; by default the start of the scene.", check=checks.number, default=None
    )
    end_time: float | None = described(
        "Time at which it ends [s]; by default it does not.", check=checks.number, default=None
    )

    def __post_init__(self) -> None:
        for name, own in described_fields(type(self)).items():
            vars(self)[name] = checked(name, own, getattr(self, name))
        if self.end_time is not None and self.start_time is not None and self.end_time <= self.start_time:
            raise InputError(
                f"end_time of a {type(self).__name__.lower()} is {self.end_time} s: it must be later than"
                f" start_time, {self.start_time} s"
            )

    @property
    def table(self) -> dict[str, Any]:
        """Keys and values of the table in a scene file, without those that are defaults."""
        own = described_fields(type(self)).items()
        return {name: value for name, one in own if (value := getattr(self, name)) != one.default}

    @property
    def begin(self) -> float:
        """Time at which the exchange begins [s]."""
        return self.start_time or 0.0

    @property
    def end(self) -> float:
        """Time at which the exchange ends [s]; inf if it does not end."""
        return inf if self.end_time is None else self.end_time

    def starting(self, time: float) -> Self:
        """Return a copy whose exchange begins at `time` [s], or self if `start_time` is given."""
        return replace(self, start_time=time) if self.start_time is None else self

    def steps(self, dt: float) -> int:
        """Return the number of steps of `dt` [s] between two exchanges."""
        return max(1, round(self.interval / dt))


@dataclass(frozen=True, kw_only=True)
class Source(Exchange):
    """A region in which grains appear where there is room, as `Simulation.pour` places them.

    Parameters
    ----------
    {fields}

    Raises
    ------
    InputError
        A value is invalid.

    Examples
    --------
    >>> above = wg.Source(region={"y": (0.5, 0.9)}, radius=(0.02, 0.03), density=80.0, rate=100.0)
    >>> grain = {"position": [[0.3, 0.0]], "radius": 0.1, "mass": 0.1}
    >>> poured = wg.Simulation(wg.Scene(**grain, radius_out=2.0, sources=[above]))
    >>> summary = poured.run(duration=0.5)
    >>> poured.scene.n, poured.inflow[0].entered
    (46, 45)
    """

    radius: Any = described(  # noqa: RUF009
        "Radii as in the layout ``random`` [m]: one number, the smallest and the largest, or a table.",
        check=_radius,
    )
    density: float = described("Mass by area [kg/m2].", check=checks.positive)
    count: int = described("Number of grains that appear when it begins.", check=_number, default=0)
    rate: float = described(
        "Number of grains that appear per time [1/s].", check=checks.not_negative, default=0.0
    )
    velocity: tuple[float, float] = described(
        "Velocity with which grains appear [m/s].", check=checks.vector, default=(0.0, 0.0)
    )
    seed: int = described("Seed of the places and radii.", check=_number, default=0)
    name: str | None = described("Name by which a sink feeds it.", check=checked_name, default=None)

    def due(self, time: float) -> int:
        """Return how many grains should have appeared by a time [s], according to `count` and `rate`."""
        passed = min(time, self.end) - self.begin
        if passed < -ROUNDED * self.interval:
            return 0
        return self.count + floor(self.rate * max(passed, 0.0) + ROUNDED)


@dataclass(frozen=True, kw_only=True)
class Sink(Exchange):
    """A region from which grains are taken when their centers lie in it. The last grain of a scene stays.

    Parameters
    ----------
    {fields}

    Raises
    ------
    InputError
        A value is invalid.

    Examples
    --------
    >>> below = wg.Sink(region={"y": (-2.0, -1.0)}, into="top")
    >>> above = wg.Source(region={"y": (1.0, 1.8)}, radius=0.1, density=10.0, name="top")
    >>> cycle = wg.Simulation(wg.Scene.load("annulus").replace(sources=[above], sinks=[below]))
    >>> summary = cycle.run(duration=4.0)
    >>> cycle.scene.n, cycle.outflow[0].grains == cycle.inflow[0].entered > 0
    (15, True)
    """

    into: str | None = described(
        "Name of a source in which as many grains appear as soon as there is room.",
        check=checked_name,
        default=None,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.region:
            raise InputError("region of a sink is empty: give ranges x, y or distance [m]")

    def is_open(self, time: float) -> bool:
        """Return whether the sink takes grains at a time [s]."""
        rounded = ROUNDED * self.interval
        return self.begin - rounded <= time <= self.end + rounded

    def contains(self, position: FloatArray) -> BoolArray:
        """Return which points [m], shape (n, 2), lie in the region, shape (n,)."""
        along = dict(zip(RANGES, (*position.T, distance(position)), strict=True))
        inside = np.ones(len(position), bool)
        for name, (low, high) in self.region.items():
            inside &= (low <= along[name]) & (along[name] <= high)
        return inside


for _kind in (Source, Sink):
    documented(described_fields(_kind).values())(_kind)


def checked_list(field: str, value: Any, kind: type[Kind]) -> tuple[Kind, ...]:
    """Return sources or sinks, each given as an object or by the keys of its table in a scene file."""
    if not isinstance(value, list | tuple):
        raise InputError(f"{field} is {checks.shown(value)}: it must be a list of {kind.__name__} or tables")
    return tuple(_checked_one(f"{field}[{k}]", given, kind) for k, given in enumerate(value))


def _checked_one(field: str, value: Any, kind: type[Kind]) -> Kind:
    if isinstance(value, kind):
        return value
    if not isinstance(value, Mapping):
        raise InputError(
            f"{field} is {checks.shown(value)}: it must be a {kind.__name__}, or a table of its keys"
        )
    own = fields_of(field, value, f"a {kind.__name__.lower()}", described_fields(kind))
    try:
        return kind(**own)
    except InputError as error:
        raise InputError(f"{field}: {error}") from None


def space_of(now: Scene, region: Any, radius: float, field: str = "region") -> Region:
    """Return the part of the space of a scene that `region` selects.

    InputError, which names `field`, if the region is invalid or no grain of `radius` [m] fits in it.
    """
    space = region_of(now.space_at(now.time), region, field)
    fitting_radius(space, radius)
    return space


def require_compatible(scene: Scene) -> None:
    """Raise InputError unless names, rates and regions of sources and sinks are valid."""
    names = [source.name for source in scene.sources if source.name]
    for k, sink in enumerate(scene.sinks):
        region_of(scene.space_at(scene.time), sink.region, f"sinks[{k}].region")
        if sink.into is not None and not names:
            raise InputError(
                f"sinks[{k}].into is {sink.into!r}: no source has a name: give one the name {sink.into!r}"
            )
        if sink.into is not None:
            checks.one_of(f"sinks[{k}].into", sink.into, names)
    fed = {sink.into for sink in scene.sinks} - {None}
    for k, source in enumerate(scene.sources):
        if names.count(source.name or "") > 1:
            raise InputError(f"sources[{k}].name is {source.name!r}: another source has it")
        if not (source.count or source.rate or source.name in fed):
            raise InputError(
                f"sources[{k}] has no count, no rate, and no sink that feeds it: give one of them"
            )
        with radius_named(f"sources[{k}].radius"):
            largest = drawn_radii(source.radius, np.random.default_rng(0))[1]
            space_of(scene, source.region, largest, f"sources[{k}].region")


def require_closed(scene: Scene, what: str) -> None:
    """Raise InputError, which begins with `what`, if the scene has sources or sinks."""
    if scene.exchanges_grains:
        raise InputError(f"{what}: the scene has sources or sinks, which only `run` and Simulation take")


def steps_to_exchange(scene: Scene, steps: int) -> int:
    """Return the number of steps, at least 1, from step `steps` to the next exchange of a source or a sink.

    It is `checks.LARGEST_WHOLE_NUMBER` in a scene without sources and sinks.
    """
    every = (one.steps(scene.dt) for one in (*scene.sources, *scene.sinks))
    return min((own - steps % own for own in every), default=checks.LARGEST_WHOLE_NUMBER)
