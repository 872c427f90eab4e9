"""Checks that the fields of a scene are compatible with each other and with the grains."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from math import inf, isfinite, pi
from typing import TYPE_CHECKING
from warnings import warn

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import InputError
from warpgrains.scene import sources
from warpgrains.scene.energy import TOLERANCES
from warpgrains.space.geometry import LARGEST, MOST_RADII, SMALLEST, require_distinct, require_squares
from warpgrains.walls.line import Line
from warpgrains.walls.rim import Rim
from warpgrains.walls.row import Row

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.scene.state import State

LEAST_WARNED = 1e-6  # smaller overlaps at the start [smallest radii] cause no warning
ROUNDED = 1e-9  # tolerance of the number of steps of a row in a period, and of widths in periods
MOST_STEPS = 1e12  # bound of the start time, in steps
FARTHEST = 1e6  # largest distance of a periodic box from the origin [smallest radii]; beyond, digits are lost


def require_valid_positions(scene: Scene) -> None:
    """Raise InputError unless centers are between the walls, no two coincide, and float64 resolves gaps."""
    require_size(scene)
    require_clear(scene, range(len(scene.walls)), scene.position, scene.radius, scene.time)
    require_distinct("position", scene.period.wrapped(scene.position))


def require_clear(
    scene: Scene,
    numbers: Collection[int],
    position: FloatArray,
    radius: FloatArray,
    time: float,
    of: str = "grain",
) -> None:
    """Raise InputError if a center lies in a wall, or a grain touches a wall where its normal is undefined.

    `position` holds the centers [m], shape (n, 2), and `radius` the radii [m]. `numbers` are the indices in
    `scene.walls` of the walls to check, at their places at `time` [s]. Messages call each grain `of`.
    """
    for number in numbers:
        wall = scene.walls[number]
        if (covered := wall.covers(wall.places(position, scene.period, time))).any():
            grain = checks.first_bad("position", position, covered, of)
            raise InputError(f"{grain}: {wall.complaint(number)}")
    for number in numbers:
        undefined = scene.side(number, position, radius, time=time).without_normal()
        if undefined.any():
            grain, name = checks.first_bad("position", position, undefined, of), scene.wall_names[number]
            raise InputError(f"{grain}: it touches {name}, which has no normal there")


def require_size(scene: Scene) -> None:
    """Raise InputError if the domain is too small for the grains, or too large for gaps in float64."""
    smallest = scene.smallest_radius
    if scene.reach / MOST_RADII >= smallest:
        raise InputError(
            f"{scene.boundary.size}: it must be less than {MOST_RADII:g} radii of"
            f" grain {int(np.argmin(scene.radius))}, {smallest} m, because"
            " float64 positions could not resolve gaps"
        )
    require_squares(scene.boundary.size, scene.reach)
    scene.boundary.require_fits(scene.radius)
    if scene.period and scene.reach > 2.0 * FARTHEST * smallest:
        raise InputError(
            f"{scene.boundary.size}: a periodic box must be within {FARTHEST:g} radii of the smallest grain,"
            f" {smallest} m, from the origin"
        )


def require_valid_walls(scene: Scene) -> None:
    """Raise InputError unless walls are valid in the scene.

    A wall must not be too large for float64 to resolve gaps, and must fit the period. A row needs a second
    row with discs in its gaps, and at most one driven line may have its name.
    """
    periods = scene.period.lengths.tolist()
    period = min((own for own in periods if own > 0.0), default=inf)
    smallest = scene.smallest_radius
    driven = [wall.name for wall in scene.walls if isinstance(wall, Line) and wall.drive is not None]
    for k, wall in enumerate(scene.walls):
        if wall.image or isinstance(wall, Rim):
            continue
        if (largest := max(map(abs, wall.numbers))) >= MOST_RADII * smallest:
            raise InputError(
                f"walls[{k}] has the length or coordinate {largest} m: it must be less than {MOST_RADII:g}"
                f" radii of {smallest} m, because float64 could not resolve gaps"
            )
        if isinstance(wall, Row) and not any(wall.fills_gaps_of(other) for other in scene.walls):
            raise InputError(
                f"walls[{k}] is a row: another row must have its discs in the middle between these"
            )
        if isinstance(wall, Row) and wall.name and driven.count(wall.name) > 1:
            raise InputError(
                f"walls[{k}], a row, has the name of several driven lines, {wall.name}: name these apart"
            )
        which = f"walls[{k}], {wall.one()}, in a periodic box:"
        if isinstance(wall, Line) and any(way and own for way, own in zip(wall.normal, periods, strict=True)):
            raise InputError(
                f"{which} its normal is {wall.normal}: it must be at a right angle to that direction"
            )
        if isinstance(wall, Row):
            for own, along, across in zip(periods, wall.spacing, wall.spacing[::-1], strict=True):
                if own and (across != 0.0 or abs(own / along - round(own / along)) > ROUNDED):
                    told = f"the period, {own} m, must be a whole number of spacings"
                    raise InputError(f"{which} its spacing is {wall.spacing}: {told}")
        if wall.angular_velocity != 0.0 and period < inf:
            raise InputError(
                f"{which} angular_velocity is {wall.angular_velocity} rad/s: no wall can turn there"
            )
        for own, width in zip(periods, wall.widths, strict=True):
            if own and own * (1.0 + ROUNDED) < width < inf:
                raise InputError(f"{which} it is {width} m wide: it must be at most the period, {own} m")


def require_compatible_settings(scene: Scene) -> None:
    """Raise InputError unless the settings are compatible with each other and with the grains."""
    _require_steps(scene)
    _require_friction(scene)
    _require_options(scene)
    sources.require_compatible(scene)


def _require_steps(scene: Scene) -> None:
    """Raise InputError if dt is too long, or values overflow or lose digits."""
    dt, smallest, lightest = scene.dt, scene.smallest_radius, int(scene.mass.argmin())
    mass, heaviest = float(scene.mass[lightest]), float(scene.mass.max())
    lost = scene.drag * dt / mass  # fraction of a velocity that one step of the text's scheme removes
    if lost >= 1.0 and scene.scheme == "euler":
        raise InputError(
            f"dt is {dt} s: in one step, drag {scene.drag} kg/s would reverse grain {lightest}"
            f' of mass {mass} kg; dt must be less than {mass / scene.drag} s, or scheme "leapfrog"'
        )
    if not isfinite(lost):
        raise InputError(
            f"drag is {scene.drag} kg/s: drag dt / m is not finite for dt {dt} s and"
            f" grain {lightest} of mass {mass} kg"
        )
    if mass < SMALLEST or heaviest > LARGEST:
        too_extreme = (scene.mass < SMALLEST) | (scene.mass > LARGEST)
        raise InputError(
            f"{checks.first_bad('mass', scene.mass, too_extreme)}: it must be between {SMALLEST:g} and"
            f" {LARGEST:g} kg, for products of masses to be finite"
        )
    if not isfinite(heaviest * scene.reach / dt / dt):
        raise InputError(
            f"dt is {dt} s: forces of {heaviest} kg that moves {scene.reach} m in a step are not finite"
        )
    if abs(scene.time) >= MOST_STEPS * dt:
        raise InputError(
            f"time is {scene.time} s: it must be less than {MOST_STEPS:g} steps of {dt} s, because"
            " float64 times could not resolve them"
        )
    for k, wall in enumerate(scene.walls):
        path = abs(wall.angular_velocity) * wall.farthest(wall.about) * dt
        if not path < smallest:
            raise InputError(
                f"angular_velocity of walls[{k}]: the {wall.kind} turns by {path:.3g} m in a step of {dt} s;"
                f" it must be less than the smallest radius, {smallest} m"
            )
    if not abs(scene.gravity_rate) * dt < pi:
        raise InputError(
            f"gravity.angular_velocity is {scene.gravity_rate} rad/s: in a step of {dt} s gravity turns by"
            f" half a turn or more; dt must be less than {pi / abs(scene.gravity_rate)} s"
        )


def _require_friction(scene: Scene) -> None:
    """Raise InputError if a field needs friction that the scene lacks, or a rotation is invalid.

    Rotations are those of circles and of grains, and spin drag must not reverse them in a step.
    """
    if scene.angular_velocity_in != 0.0 and scene.radius_in == 0.0:
        raise InputError(f"angular_velocity_in is {scene.angular_velocity_in} rad/s: there is no inner wall")
    for wall, friction in zip(scene.walls, scene.at_walls["friction"], strict=True):
        if isinstance(wall, Rim) and wall.rotation != 0.0:
            name = "angular_velocity_out" if wall.inside else "angular_velocity_in"
            given = f"{name} is {wall.rotation} rad/s"
            if friction == 0.0:
                raise InputError(f"{given}: a wall without friction moves no grain; give wall_friction")
            if not isfinite(wall.surface_speed):
                raise InputError(f"{given}: the speed of the wall is not finite")
    if not scene.has_friction:
        if scene.spin.any():
            grain = checks.first_bad("spin", scene.spin, scene.spin != 0.0)
            raise InputError(f"{grain}: grains rotate only with friction; give friction")
        if scene.spin_drag:
            raise InputError(
                f"spin_drag is {scene.spin_drag} kg m2/s: grains rotate only with friction; give friction"
            )
        if scene.has_rolling_friction:
            raise InputError(f"{_rolling_friction(scene)}: grains rotate only with friction; give friction")
        return
    lost = scene.spin_drag * scene.dt / scene.inertia
    if scene.scheme == "euler" and (lost >= 1.0).any():
        raise InputError(
            f"spin_drag is {scene.spin_drag} kg m2/s: in a step of {scene.dt} s it would reverse the"
            f" rotation of grain {int(lost.argmax())}; dt must be less than"
            f' {float(scene.inertia.min()) / scene.spin_drag} s, or scheme "leapfrog"'
        )
    with np.errstate(over="ignore"):
        too_fast = ~np.isfinite(scene.spin * scene.radius)
    if too_fast.any():
        raise InputError(
            f"{checks.first_bad('spin', scene.spin, too_fast)}: the speed of its rim is not finite"
        )


def _rolling_friction(scene: Scene) -> str:
    """Return the first nonzero coefficient of rolling friction as "NAME is VALUE". There must be one."""
    given = {name: getattr(scene, name) for name in ("rolling_friction", "wall_rolling_friction")}
    given |= {f"walls[{k}].rolling_friction": one.rolling_friction for k, one in enumerate(scene.walls)}
    return next(f"{name} is {value}" for name, value in given.items() if value)


def _require_options(scene: Scene) -> None:
    """Raise InputError if options of contacts, of the outer wall or of the method contradict each other."""
    if scene.restitution_speed != 0.0 and not scene.has_restitution:
        raise InputError(
            f"restitution_speed is {scene.restitution_speed} m/s: no contact bounces; give restitution"
        )
    if scene.wall_mass is not None and scene.pressure is None:
        raise InputError(f"wall_mass is {scene.wall_mass} kg: the outer wall is fixed; give pressure")
    if scene.has_driven_walls and scene.wall == "round":
        which = "pressure" if scene.pressure is not None else "force of a wall"
        raise InputError(f"{which} is given and wall is 'round': use 'tangent'")
    if scene.method == "exact" and scene.stops_on != "residual":
        raise InputError(f"stop is {scene.stop!r}: method 'exact' stops on the residual")


def allowed_overlap(scene: Scene) -> float:
    """Return the largest initial overlap that causes no warning [m]."""
    return max(TOLERANCES * scene.tolerance * scene.dt, LEAST_WARNED * scene.smallest_radius)


def warn_of_state_overlaps(state: State, scene: Scene) -> None:
    """Warn if grains of a state overlap more deeply than one step can cause.

    The limit is `allowed_overlap` + path^2 / (smallest radius). Here path [m] is the longest way of a grain
    in a step, plus the longest way of a wall in a step.
    """
    walls = None if state.driven is None else state.driven[:, 0]
    now = scene.placed(walls, scene.time_after(state.steps), position=state.position)
    speeds = [wall.speed + abs(wall.angular_velocity) * wall.farthest(wall.about) for wall in scene.walls]
    speeds += [] if state.driven is None else np.abs(state.driven[:, 1]).tolist()
    path = scene.dt * (float(np.hypot(*state.velocity.T).max()) + max(speeds, default=0.0))
    overlap = now.count_overlaps().largest
    if overlap > allowed_overlap(scene) + path * path / scene.smallest_radius:
        warn(
            f"grains of the state overlap by up to {overlap:.1e} m, which the next step turns into"
            f" {overlap / scene.dt:.1e} m/s",
            stacklevel=3,
        )


def warn_of_start(scenes: Sequence[Scene]) -> None:
    """Warn if grains overlap at the start, or if no contact of a scene with restitution can bounce yet.

    Of several scenes, the warnings name the one with the worst overlap, and the first one without bounces.
    """
    shut = [k for k, scene in enumerate(scenes) if scene.has_restitution and not scene.bounces_at_start]
    if shut:
        where = f"scene {shut[0]}: " if len(scenes) > 1 else ""
        warn(
            f"{where}grains that part at the start are closer than a step takes them: nothing bounces in the"
            " first step, which loses energy; a shorter dt loses less",
            stacklevel=3,
        )
    of_start: dict[tuple[object, ...], float] = {}  # many scenes of a batch have the same start
    overlap = []
    for scene in scenes:
        key = scene.boundary, scene.time, scene.walls, scene.position.tobytes(), scene.radius.tobytes()
        if key not in of_start:
            of_start[key] = scene.count_overlaps().largest
        overlap.append(of_start[key])
    limit = [allowed_overlap(scene) for scene in scenes]
    k = int(np.argmax(np.divide(overlap, limit)))
    if overlap[k] > limit[k]:
        where = f"scene {k}: " if len(scenes) > 1 else ""
        warn(
            f"{where}grains overlap by up to {overlap[k]:.1e} m at the start, which the first step turns into"
            f" {overlap[k] / scenes[k].dt:.1e} m/s: warpgrains.separate, or run --separate, moves them apart",
            stacklevel=3,
        )
