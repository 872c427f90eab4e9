"""The fields of a scene, each written once: key in scene files, check, default, unit and meaning."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from functools import partial
from math import isfinite
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, dataclass_transform

import numpy as np
from numpy.typing import ArrayLike

from warpgrains.arrays import FloatArray
from warpgrains.described import described, described_fields
from warpgrains.errors import SceneError
from warpgrains.scene import checks
from warpgrains.scene.disc import Disc
from warpgrains.scene.geometry import require_distinct
from warpgrains.scene.scheme import SCHEMES
from warpgrains.scene.walls import Annulus

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

ORDERS = ("sequential", "color")
METHODS = ("gauss-seidel", "accelerated", "exact")
STOPS = ("default", "zeta", "residual")
UNCONVERGED = ("report", "raise")
WALL_KINDS = {kind.kind: kind for kind in (Disc,)}
MOST_RADII = 1e12  # of the smallest grain, in that of the outer wall: positions have no digits for more

Kind = TypeVar("Kind")
Held = TypeVar("Held", covariant=True)
Given = TypeVar("Given", contravariant=True)

if TYPE_CHECKING:

    class MadeOf(Protocol[Held, Given]):
        """A field that is given to the constructor in more forms than the one in which it is held."""

        def __get__(self, scene: object, kind: Any = None) -> Held: ...
        def __set__(self, scene: object, value: Given) -> None: ...

    Array = MadeOf[FloatArray, ArrayLike]
    OptionalArray = MadeOf[FloatArray, ArrayLike | None]
    Vector = MadeOf[tuple[float, float], Sequence[float] | FloatArray]
    Walls = MadeOf[tuple[Disc, ...], Sequence[Disc | Mapping[str, Any]]]
else:
    Array, OptionalArray, Vector = FloatArray, FloatArray | None, tuple[float, float]
    Walls = tuple[Disc, ...]


def _key(meaning: str, section: str = "", check: Any = None, *, default: Any = MISSING) -> Any:
    """Return a field of a scene.

    A field with a section is a key of that section of a scene file. The check is a function or a tuple of
    names; those of grains and walls have none, because `checked_grains` checks them together.
    """
    return described(meaning, section=section, check=check, default=default)


@dataclass_transform(eq_default=False, frozen_default=True, kw_only_default=True, field_specifiers=(_key,))
def _record(kind: type[Kind]) -> type[Kind]:
    return dataclass(frozen=True, eq=False, kw_only=True, repr=False)(kind)


def frozen(kind: type[Kind]) -> type[Kind]:
    """Freeze what inherits fields; mypy must not see how, or it loses their types, see `MadeOf`."""
    return _record(kind)


@_record
class SceneFields:
    """What a `Scene` holds."""

    position: Array = _key("Centres of the grains [m], shape (n, 2).")
    velocity: OptionalArray = _key(
        "Velocities at the start [m/s], shape (n, 2); by default all grains rest.", default=None
    )
    radius: Array = _key("Radius of every grain [m], shape (n,), or one number for all.")
    mass: Array = _key("Mass of every grain [kg], shape (n,), or one number for all.")
    spin: OptionalArray = _key(
        "Angular velocity of every grain at the start [rad/s], shape (n,), or one number for all; by default"
        " no grain rotates. Only with friction.",
        default=None,
    )
    radius_in: float = _key("Radius of the inner wall [m]; 0 means there is none.", "domain", default=0.0)
    radius_out: float = _key("Radius of the outer wall [m].", "domain")
    wall: str = _key(
        'What the outer wall is within a step: its "tangent", the text\'s, which a grain that slides along it'
        ' leaves by (v dt)^2 / (2 radius_out), or "round": it ends on the circle.',
        "domain",
        default="tangent",
    )
    angular_velocity_out: float = _key(
        "Angular velocity at which the outer wall rotates about the origin [rad/s]. Only with friction.",
        "domain",
        checks.number,
        default=0.0,
    )
    angular_velocity_in: float = _key(
        "The same of the inner wall [rad/s].", "domain", checks.number, default=0.0
    )
    walls: Walls = _key(
        'What stands inside the annulus, such as ``[{"kind": "disc", "center": (0, -1), "radius": 0.2}]``, or'
        " `Disc(center, radius)`: fixed discs that grains touch from outside.",
        check=lambda field, value: checked_walls(field, value),
        default=(),
    )
    gravity: Vector = _key(
        "Acceleration of gravity, two components [m/s2].", "physics", checks.vector, default=(0.0, -9.81)
    )
    drag: float = _key("Linear drag coefficient [kg/s].", "physics", checks.not_negative, default=0.0)
    spin_drag: float = _key(
        "Linear drag on the rotation of a grain, a moment by angular velocity [kg m2/s]. Only with friction.",
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
        "The same between grains and walls; by default that between grains.",
        "contact",
        lambda field, value: None if value is None else checks.not_negative(field, value),
        default=None,
    )
    dt: float = _key("Time step [s].", "time", checks.positive, default=0.01)
    duration: float = _key("Simulated time of a whole run [s].", "time", checks.positive, default=1.0)
    scheme: str = _key(
        'How velocities go on in time: "text", of first order in dt, or "leapfrog", of second order, whose'
        " velocities are those of the middle of a step (see `State`).",
        "time",
        SCHEMES,
        default="text",
    )
    tolerance: float = _key(
        "The contact iteration stops when no correction changes by more than this [m/s] ...",
        "solver",
        checks.not_negative,
        default=1e-6,
    )
    max_iterations: int = _key(
        "... or after so many iterations.", "solver", checks.whole_number, default=10_000
    )
    order: str = _key(
        'Order in which an iteration visits the contacts: "sequential" or "color".',
        "solver",
        ORDERS,
        default="sequential",
    )
    method: str = _key(
        'How the contact iteration proceeds: "gauss-seidel", the text\'s; "accelerated", with momentum; or'
        ' "exact", the same, and where that is slow an interior point method, with the extra ``[exact]``.',
        "solver",
        METHODS,
        default="gauss-seidel",
    )
    stop: str = _key(
        'What the tolerance is on: "zeta", the text\'s, or "residual", the error (see `StepReport`). By'
        ' default it is zeta for "gauss-seidel" and the residual for the others; for "exact" it is always the'
        " residual.",
        "solver",
        STOPS,
        default="default",
    )
    on_unconverged: str = _key(
        'What a step does that has not met its tolerance after `max_iterations`: "report" it and go on, or'
        ' "raise" `SimulationError` and leave the state as it was before the step.',
        "solver",
        UNCONVERGED,
        default="report",
    )
    name: str = _key("What the scene is called.", check=checks.text, default="scene")
    text: str = _key("The TOML text that the scene was read from, if any.", check=checks.text, default="")


FIELDS = described_fields(SceneFields)
SECTIONS: dict[str, list[str]] = {}
"""The sections of a scene file, but for its grains, and their keys."""
for _name, _field in FIELDS.items():
    if _field.metadata["section"]:
        SECTIONS.setdefault(_field.metadata["section"], []).append(_name)
_SETTINGS = {
    name: partial(checks.one_of, known=check) if isinstance(check, tuple) else check
    for name, field in FIELDS.items()
    if (check := field.metadata["check"]) is not None
}


def checked_walls(field: str, value: Any) -> tuple[Disc, ...]:
    """Return walls, each given as what it is or by the keys of a `[[walls]]` table."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise SceneError(f"{field} is {checks.shown(value)}: it must be a list of walls")
    return tuple(_checked_wall(f"{field}[{k}]", wall) for k, wall in enumerate(value))


def _checked_wall(field: str, value: Any) -> Disc:
    if isinstance(value, Disc):
        return value
    if not isinstance(value, Mapping):
        raise SceneError(f"{field} is {checks.shown(value)}: it must be a wall, or a table of its keys")
    own = dict(value)
    kind = WALL_KINDS[checks.one_of(f"{field}.kind", own.pop("kind", None), WALL_KINDS)]
    keys = [one.name for one in fields(kind)]
    for key in own:
        if key not in keys:
            raise checks.unknown(f"key of {field}", key, ("kind", *keys))
    for key in keys:
        if key not in own:
            raise SceneError(f"{field}.{key} is missing: a {kind.kind} needs it")
    try:
        return kind(**own)
    except SceneError as error:
        raise SceneError(f"{field}: {error}") from None


def checked_settings(scene: SceneFields, names: Iterable[str] = _SETTINGS) -> dict[str, Any]:
    """Return fields that are not of grains or walls, as a scene keeps them.

    Raises
    ------
    SceneError
        One is not what it must be.
    """
    return {name: _SETTINGS[name](name, getattr(scene, name)) for name in names}


def checked_grains(scene: SceneFields) -> dict[str, Any]:
    """Return the fields of grains and walls, as a scene keeps them.

    Raises
    ------
    SceneError
        One is not what it must be, or not of as many grains as the others.
    """
    position = checks.vectors("position", scene.position)
    velocity = np.zeros_like(position) if scene.velocity is None else scene.velocity
    velocity = checks.vectors("velocity", velocity)
    n = len(position)
    if len(velocity) != n:
        raise SceneError(f"velocity has shape {velocity.shape}: position has shape {position.shape}")
    return {
        "position": position,
        "velocity": velocity,
        "radius": checks.positive_per_grain("radius", scene.radius, n),
        "mass": checks.positive_per_grain("mass", scene.mass, n),
        "spin": checks.per_grain("spin", 0.0 if scene.spin is None else scene.spin, n),
        **Annulus.checked(scene.radius_in, scene.radius_out, scene.wall)._asdict(),
    }


def require_places(scene: "Scene") -> None:
    """Raise SceneError unless all grains are between the walls, apart, and in places that have digits."""
    _require_size(scene)
    scene.annulus.require_inside(scene.position, scene.radius)
    for k, wall in enumerate(scene.walls):
        inside = wall.side(scene.position, scene.radius).gap < -scene.radius
        if inside.any():
            grain = checks.of_grain("position", scene.position, inside)
            raise SceneError(f"{grain}: its center is inside walls[{k}], {wall}")
    require_distinct("position", scene.position)


def _require_size(scene: "Scene") -> None:
    """Raise SceneError unless positions have digits for a gap, and squares."""
    smallest = scene.smallest_radius
    if scene.radius_out / MOST_RADII >= smallest:
        raise SceneError(
            f"radius_out is {scene.radius_out} m: it must be less than {MOST_RADII:g} radii of"
            f" grain {int(np.argmin(scene.radius))}, {smallest} m, for positions to have digits for a gap"
        )
    scene.annulus.require_size()


def require_agreement(scene: "Scene") -> None:
    """Raise SceneError unless the settings suit each other, and the grains."""
    _require_short_step(scene)
    _require_friction(scene)
    if scene.method != "gauss-seidel" and scene.has_friction:
        raise SceneError(
            f"method is {scene.method!r}: it solves steps without friction only; use 'gauss-seidel'"
        )
    if scene.method == "exact" and scene.stop == "zeta":
        raise SceneError("stop is 'zeta': method 'exact' stops on the residual")


def _require_friction(scene: "Scene") -> None:
    """Raise SceneError if a field has no effect without friction, or a method knows none."""
    walls = ("angular_velocity_out", "angular_velocity_in")
    if scene.angular_velocity_in != 0.0 and scene.radius_in == 0.0:
        raise SceneError(f"angular_velocity_in is {scene.angular_velocity_in} rad/s: there is no inner wall")
    for name in walls:
        if getattr(scene, name) != 0.0 and scene.friction_at_walls == 0.0:
            raise SceneError(
                f"{name} is {getattr(scene, name)} rad/s: a wall without friction moves no grain; give"
                " wall_friction"
            )
        speed = getattr(scene, name) * scene.radius_out
        if not isfinite(speed):
            raise SceneError(f"{name} is {getattr(scene, name)} rad/s: the speed of the wall is not finite")
    if scene.has_friction:
        inertia = 0.5 * scene.mass * scene.radius**2
        lost = scene.spin_drag * scene.dt / inertia
        if scene.scheme == "text" and (lost >= 1.0).any():
            raise SceneError(
                f"spin_drag is {scene.spin_drag} kg m2/s: in a step of {scene.dt} s it would reverse the"
                f" rotation of grain {int(lost.argmax())}; dt must be less than"
                f' {float(inertia.min()) / scene.spin_drag} s, or scheme "leapfrog"'
            )
        with np.errstate(over="ignore"):
            too_fast = ~np.isfinite(scene.spin * scene.radius)
        if too_fast.any():
            grain = checks.of_grain("spin", scene.spin, too_fast)
            raise SceneError(f"{grain}: the speed of its rim is not finite")
        return
    if scene.spin.any():
        raise SceneError(
            f"{checks.of_grain('spin', scene.spin, scene.spin != 0.0)}: grains rotate only with friction"
        )
    if scene.spin_drag:
        raise SceneError(f"spin_drag is {scene.spin_drag} kg m2/s: grains rotate only with friction")


def _require_short_step(scene: "Scene") -> None:
    mass = scene.smallest_mass
    lost = scene.drag * scene.dt / mass  # of a velocity in a step of the text's scheme, as a share
    if lost < 1.0:
        return
    lightest = int(np.argmin(scene.mass))
    if scene.scheme == "text":
        raise SceneError(
            f"dt is {scene.dt} s: in one step, drag {scene.drag} kg/s would turn round grain {lightest}"
            f' of mass {mass} kg; dt must be less than {mass / scene.drag} s, or scheme "leapfrog"'
        )
    if not isfinite(lost):
        raise SceneError(
            f"drag is {scene.drag} kg/s: times dt, {scene.dt} s, it is no number in masses of"
            f" grain {lightest}, {mass} kg"
        )
