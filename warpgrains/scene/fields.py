"""The fields of a scene.

Each field is declared with its section in scene files, check, default, unit and meaning. Its name and type
are repeated in `SceneChanges`, because type checkers derive no TypedDict from a class.
"""

from collections.abc import Mapping, Sequence, Set
from dataclasses import MISSING, dataclass
from functools import partial
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.described import Described, checked, described, described_fields
from warpgrains.base.errors import InputError
from warpgrains.scene.gravity import EARTH, TurningGravity, checked_gravity
from warpgrains.scene.scheme import SCHEMES
from warpgrains.scene.sources import Sink, Source, checked_list
from warpgrains.walls.annulus import KEYS as OF_ANNULUS
from warpgrains.walls.annulus import WALLS as OUTER_WALLS
from warpgrains.walls.annulus import Annulus
from warpgrains.walls.box import Box, checked_domain
from warpgrains.walls.kinds import WRITTEN_KINDS, checked_walls
from warpgrains.walls.wall import Wall

ORDERS = ("sequential", "color")
METHODS = ("gauss-seidel", "accelerated", "exact")
STOPS = ("default", "zeta", "residual")
UNCONVERGED = ("report", "raise")


def _key(
    meaning: str, section: str = "", check: Any = None, *, default: Any = MISSING, mark: str = "absent"
) -> Any:
    """Declare a field of a scene, with its meaning, and its section in scene files.

    `check` is a function that checks a value, or a tuple of the valid names. If the field has no default,
    tables of keys show `mark` in its place.
    """
    known = partial(checks.one_of, known=check) if isinstance(check, tuple) else check
    return described(meaning, section=section, check=known, default=default, mark=mark)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class SceneFields(Described):
    """Data and settings that define a scene."""

    position: FloatArray = _key("Centers of the grains [m], shape (n, 2).")
    velocity: FloatArray = _key(
        "Velocities at the start [m/s], shape (n, 2); by default all grains rest.", default=None
    )
    radius: FloatArray = _key("Radius of every grain [m], shape (n,), or one number for all.")
    mass: FloatArray = _key("Mass of every grain [kg], shape (n,), or one number for all.")
    spin: FloatArray = _key(
        "Angular velocity of every grain at the start [rad/s], shape (n,), or one number for all; by default"
        " no grain rotates. Only with friction.",
        default=None,
    )
    radius_in: float = _key(
        "Radius of the inner wall [m]; 0 means there is none.", "domain", checks.not_negative, default=0.0
    )
    radius_out: float = _key(
        "Radius of the outer wall [m], unless the domain is a box.",
        "domain",
        checks.positive,
        default=None,
        mark="required",
    )
    domain: Box | None = _key(
        "A `Box` that contains the grains, instead of the annulus.", check=checked_domain, default=None
    )
    wall: str = _key(
        'Outer wall in a step: "tangent", the tangent at the grain, as in the course text, on which a grain'
        ' leaves the circle by (v dt)^2 / (2 (radius_out - radius)); or "round", the circle itself.',
        "domain",
        OUTER_WALLS,
        default="tangent",
    )
    pressure: float | None = _key(
        "Pressure on the outer wall [N/m], which then moves: its radius changes by pressure and contacts. By"
        " default the wall is fixed.",
        "domain",
        checks.number,
        default=None,
    )
    wall_mass: float | None = _key(
        "Mass of the outer wall under a pressure [kg]; by default that of all grains.",
        "domain",
        checks.positive,
        default=None,
        mark="inherited",
    )
    angular_velocity_out: float = _key(
        "Angular velocity at which the outer wall rotates about the origin [rad/s]. Only with friction.",
        "domain",
        checks.number,
        default=0.0,
    )
    angular_velocity_in: float = _key(
        "Angular velocity of the inner wall [rad/s]. Only with friction.",
        "domain",
        checks.number,
        default=0.0,
    )
    walls: tuple[Wall, ...] = _key(
        'Walls inside the domain, such as ``[{"kind": "disc", "center": (0, -1), "radius": 0.2}]``, or of'
        f" these classes: {', '.join(kind.__name__ for kind in WRITTEN_KINDS.values())}.",
        check=checked_walls,
        default=(),
    )
    sources: tuple[Source, ...] = _key(
        "Regions in which grains appear, each a `Source` or a table of its keys.",
        check=partial(checked_list, kind=Source),
        default=(),
    )
    sinks: tuple[Sink, ...] = _key(
        "Regions from which grains are taken, each a `Sink` or a table of its keys.",
        check=partial(checked_list, kind=Sink),
        default=(),
    )
    gravity: tuple[float, float] | TurningGravity = _key(
        "Acceleration of gravity, two components [m/s2]; or"
        " ``{vector = [0.0, -9.81], angular_velocity = 0.05}``, gravity that turns: ``vector`` at time 0, by"
        " default that of the Earth, and its angular velocity, counterclockwise [rad/s].",
        "physics",
        checked_gravity,
        default=EARTH,
    )
    drag: float = _key("Linear drag coefficient [kg/s].", "physics", checks.not_negative, default=0.0)
    spin_drag: float = _key(
        "Linear drag on the rotation of a grain, torque per angular velocity [kg m2/s]. Only with friction.",
        "physics",
        checks.not_negative,
        default=0.0,
    )
    friction: float = _key(
        "Coefficient of Coulomb friction between grains; 0 means that grains slide freely and do not rotate.",
        "contact",
        checks.not_negative,
        default=0.0,
    )
    wall_friction: float | None = _key(
        "Coefficient of friction between grains and walls; by default that between grains.",
        "contact",
        checks.not_negative,
        default=None,
        mark="inherited",
    )
    rolling_friction: float = _key(
        "Coefficient of rolling friction between grains: the largest moment against their relative rotation,"
        " in units of the normal force times r_i r_j / (r_i + r_j), or r_i at a wall. Only with friction.",
        "contact",
        checks.not_negative,
        default=0.0,
    )
    wall_rolling_friction: float | None = _key(
        "Coefficient of rolling friction between grains and walls; by default that between grains.",
        "contact",
        checks.not_negative,
        default=None,
        mark="inherited",
    )
    restitution: float = _key(
        "Coefficient of restitution between grains, from 0 to 1: the speed at which they part, in speeds at"
        " which they met; 0 means that they do not bounce.",
        "contact",
        checks.fraction,
        default=0.0,
    )
    wall_restitution: float | None = _key(
        "Coefficient of restitution between grains and walls; by default that between grains.",
        "contact",
        checks.fraction,
        default=None,
        mark="inherited",
    )
    restitution_speed: float = _key(
        "Speed up to which grains meet without bouncing [m/s].",
        "contact",
        checks.not_negative,
        default=0.0,
    )
    time: float = _key(
        "Time at the start [s], which concerns walls that move and gravity that turns.",
        "time",
        checks.number,
        default=0.0,
    )
    dt: float = _key("Time step [s].", "time", checks.positive, default=0.01)
    duration: float = _key("Simulated time of a whole run [s].", "time", checks.positive, default=1.0)
    scheme: str = _key(
        'Time integration: "euler", the semi-implicit Euler scheme of the course text, of first order in'
        ' dt, or "leapfrog", of second order, whose'
        " velocities are those of the middle of a step (see `State`).",
        "time",
        SCHEMES,
        default="euler",
    )
    tolerance: float = _key(
        "Bound at which the contact iteration stops [m/s], see `stop`.",
        "solver",
        checks.not_negative,
        default=1e-6,
    )
    max_iterations: int = _key(
        "Largest number of iterations in a step.", "solver", checks.whole_number, default=10_000
    )
    order: str = _key(
        'Order in which an iteration visits the contacts: "sequential" or "color".',
        "solver",
        ORDERS,
        default="sequential",
    )
    method: str = _key(
        'Method of the contact iteration: "gauss-seidel", as in the course text; "accelerated", the same with'
        ' momentum; or "exact", which solves steps directly where these converge slowly (extra ``[exact]``).',
        "solver",
        METHODS,
        default="gauss-seidel",
    )
    stop: str = _key(
        'Quantity that the tolerance bounds: "zeta", the last change of a correction, or "residual", an error'
        ' bound. The default is zeta for "gauss-seidel" and the residual for the others.',
        "solver",
        STOPS,
        default="default",
    )
    exact_budget: float | None = _key(
        'Most time that method "exact" takes for a step with friction besides its iterations, in units of the'
        " time of `max_iterations` iterations; by default 500.",
        "solver",
        checks.positive,
        default=None,
    )
    on_unconverged: str = _key(
        'Reaction to a step above its tolerance after `max_iterations`: "report" it and continue, or'
        ' "raise" `SimulationError` and leave the state as it was before the step.',
        "solver",
        UNCONVERGED,
        default="report",
    )
    name: str = _key("Name of the scene.", check=checks.unicode_text, default="scene")
    text: str = _key(
        "The TOML text that the scene was read from, if any.", check=checks.unicode_text, default=""
    )


class SceneOptions(TypedDict, total=False):
    """Fields of a scene that have a default, in the types that callers may pass."""

    radius_out: float
    domain: Box | Mapping[str, Any] | None
    velocity: ArrayLike | None
    spin: ArrayLike | None
    radius_in: float
    wall: str
    pressure: float | None
    wall_mass: float | None
    angular_velocity_out: float
    angular_velocity_in: float
    walls: Sequence[Wall | Mapping[str, Any]]
    sources: Sequence[Source | Mapping[str, Any]]
    sinks: Sequence[Sink | Mapping[str, Any]]
    gravity: Sequence[float] | FloatArray | Mapping[str, Any]
    drag: float
    spin_drag: float
    friction: float
    wall_friction: float | None
    rolling_friction: float
    wall_rolling_friction: float | None
    restitution: float
    wall_restitution: float | None
    restitution_speed: float
    time: float
    dt: float
    duration: float
    scheme: str
    tolerance: float
    max_iterations: int
    order: str
    method: str
    stop: str
    exact_budget: float | None
    on_unconverged: str
    name: str
    text: str


class SceneChanges(SceneOptions, total=False):
    """All fields of a scene, in the types that callers may pass."""

    position: ArrayLike
    radius: ArrayLike
    mass: ArrayLike


FIELDS = described_fields(SceneFields)
SECTIONS: dict[str, list[str]] = {}
"""The sections of a scene file and their keys, except `[grains]`."""
for _name, _field in FIELDS.items():
    if _field.metadata["section"]:
        SECTIONS.setdefault(_field.metadata["section"], []).append(_name)
OF_GRAINS = ("position", "velocity", "radius", "mass", "spin")
KEY_OF = {
    name: f"{section}.{name}"
    for section, names in {**SECTIONS, "grains": OF_GRAINS}.items()
    for name in names
}
"""Key of each field in scene files: "time.dt" for dt."""


def checked_fields(scene: SceneFields, names: Set[str]) -> dict[str, Any]:
    """Check the named fields of a scene, and return them by name, converted to their types in a scene.

    If one of the arrays of the grains is named, all are checked.
    """
    found = {} if names.isdisjoint(OF_GRAINS) else checked_grains(scene)
    own = {name: FIELDS[name] for name in names if FIELDS[name].metadata["check"]}
    return found | {name: checked(name, field, getattr(scene, name)) for name, field in own.items()}


def boundary_of(scene: SceneFields) -> Annulus | Box:
    """Return the annulus or the box of a scene; InputError without one, or if fields of both are given."""
    own = {name: getattr(scene, name) for name in OF_ANNULUS}
    if scene.domain is not None:
        for name, given in own.items():
            if given != FIELDS[name].default:
                raise InputError(f"{name} is {given!r}: it concerns the annulus, and domain is a box")
        return scene.domain
    if scene.radius_out is None:
        raise InputError("radius_out is missing: give it, or domain")
    if scene.pressure is not None and scene.wall_mass is None:
        own["wall_mass"] = float(scene.mass.sum())
    return Annulus(**own)


def checked_grains(scene: SceneFields) -> dict[str, Any]:
    """Check position, velocity, radius, mass and spin; return them as arrays with a value for each grain."""
    position = checks.vectors("position", scene.position)
    velocity = np.zeros_like(position) if scene.velocity is None else scene.velocity
    velocity = checks.vectors("velocity", velocity)
    n = len(position)
    if len(velocity) != n:
        raise InputError(
            f"velocity has shape {velocity.shape}: it must be that of position, {position.shape}: give both"
        )
    return {
        "position": position,
        "velocity": velocity,
        "radius": checks.positive_per_grain("radius", scene.radius, n),
        "mass": checks.positive_per_grain("mass", scene.mass, n),
        "spin": checks.per_grain("spin", 0.0 if scene.spin is None else scene.spin, n),
    }
