"""Checks of a whole scene: fields must not contradict each other, or the grains."""

from __future__ import annotations

from math import isfinite, pi
from typing import TYPE_CHECKING

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.errors import InputError
from warpgrains.scene import checks
from warpgrains.scene.geometry import require_distinct
from warpgrains.scene.walls import INNER, INSIDE, OUTER

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

MOST_STEPS = 1e12  # start time, in steps
MOST_RADII = 1e12  # radius of the outer wall, in smallest grain radii; beyond it doubles cannot resolve a gap


def require_valid_positions(scene: Scene) -> None:
    """Raise InputError unless grains lie between the walls, do not coincide, and have resolvable gaps."""
    require_size(scene)
    scene.annulus.require_inside(scene.position, scene.radius)
    require_clear(scene, scene.wall_numbers, scene.position, scene.time)
    require_distinct("position", scene.position)


def require_clear(scene: Scene, numbers: list[int], position: FloatArray, time: float) -> None:
    """Raise InputError if a grain is in one of these walls at a time [s], or touches it without a normal."""
    for number, wall in scene.numbered_walls.items():
        if number in numbers and (covered := wall.at(time).covers(position)).any():
            grain = checks.first_bad("position", position, covered)
            raise InputError(f"{grain}: its center is inside walls[{number - INSIDE}], {wall}")
    for number in numbers:
        undefined = scene.is_without_normal(number, position, scene.radius, time=time)
        if undefined.any():
            grain = checks.first_bad("position", position, undefined)
            raise InputError(f"{grain}: it touches wall {number}, which has no normal there")


def require_size(scene: Scene) -> None:
    """Raise InputError unless doubles resolve gaps of this size and hold the square of it."""
    smallest = scene.smallest_radius
    if scene.radius_out / MOST_RADII >= smallest:
        raise InputError(
            f"radius_out is {scene.radius_out} m: it must be less than {MOST_RADII:g} radii of"
            f" grain {int(np.argmin(scene.radius))}, {smallest} m, because"
            " float64 positions could not resolve gaps"
        )
    scene.annulus.require_size()


def require_compatible_settings(scene: Scene) -> None:
    """Raise InputError unless the settings are compatible with each other and with the grains."""
    _require_short_step(scene)
    _require_resolved_time(scene)
    _require_slow_walls(scene)
    _require_slow_gravity(scene)
    _require_friction(scene)
    _require_driven(scene)
    if scene.method == "exact" and scene.has_friction:
        raise InputError("method is 'exact': it solves steps without friction only; use 'accelerated'")
    if scene.method == "exact" and scene.stops_on != "residual":
        raise InputError(f"stop is {scene.stop!r}: method 'exact' stops on the residual")


def _require_driven(scene: Scene) -> None:
    """Raise InputError unless steps of walls that forces drive can be solved with the settings."""
    if scene.wall_mass is not None and scene.pressure is None:
        raise InputError(f"wall_mass is {scene.wall_mass} kg: the outer wall is fixed; give pressure")
    if not scene.has_driven_walls:
        return
    which = "pressure" if scene.pressure is not None else "force of a wall"
    if scene.method == "exact":
        raise InputError(f"{which} is given and method is 'exact': use 'accelerated' or 'gauss-seidel'")
    for k, wall in enumerate(scene.walls):
        if wall.drive is not None and scene.wall_frictions[INSIDE + k] > 0.0:
            raise InputError(f"walls[{k}] has a force and friction: set friction = 0 for this wall")
    if scene.wall == "round":
        raise InputError(f"{which} is given and wall is 'round': use 'tangent'")


def _require_resolved_time(scene: Scene) -> None:
    """Raise InputError unless doubles resolve time steps at the start."""
    if abs(scene.time) >= MOST_STEPS * scene.dt:
        raise InputError(
            f"time is {scene.time} s: it must be less than {MOST_STEPS:g} steps of {scene.dt} s, because"
            " float64 times could not resolve them"
        )


def _require_slow_walls(scene: Scene) -> None:
    """Raise InputError unless no wall can pass the center of a grain within a step."""
    smallest = scene.smallest_radius
    for k, wall in enumerate(scene.walls):
        path = wall.speed * scene.dt
        if not path < smallest:
            raise InputError(
                f"velocity of walls[{k}]: the {wall.kind} moves by {path:.3g} m in a step of {scene.dt} s;"
                f" it must be less than the smallest radius, {smallest} m"
            )


def _require_slow_gravity(scene: Scene) -> None:
    """Raise InputError unless gravity turns by less than half a turn in a step."""
    if not abs(scene.gravity_rate) * scene.dt < pi:
        raise InputError(
            f"gravity.rotate is {scene.gravity_rate} rad/s: in a step of {scene.dt} s gravity turns by half a"
            f" turn or more; dt must be less than {pi / abs(scene.gravity_rate)} s"
        )


def _require_friction(scene: Scene) -> None:
    """Raise InputError if a field has no effect without friction, or the method does not support friction."""
    walls = {"angular_velocity_out": OUTER, "angular_velocity_in": INNER}
    if scene.angular_velocity_in != 0.0 and scene.radius_in == 0.0:
        raise InputError(f"angular_velocity_in is {scene.angular_velocity_in} rad/s: there is no inner wall")
    for name, wall in walls.items():
        if getattr(scene, name) != 0.0 and scene.friction_at_walls == 0.0:
            raise InputError(
                f"{name} is {getattr(scene, name)} rad/s: a wall without friction moves no grain; give"
                " wall_friction"
            )
        if not isfinite(scene.surface_speed(wall)):
            raise InputError(f"{name} is {getattr(scene, name)} rad/s: the speed of the wall is not finite")
    if scene.has_friction:
        lost = scene.spin_drag * scene.dt / scene.inertia
        if scene.scheme == "text" and (lost >= 1.0).any():
            raise InputError(
                f"spin_drag is {scene.spin_drag} kg m2/s: in a step of {scene.dt} s it would reverse the"
                f" rotation of grain {int(lost.argmax())}; dt must be less than"
                f' {float(scene.inertia.min()) / scene.spin_drag} s, or scheme "leapfrog"'
            )
        with np.errstate(over="ignore"):
            too_fast = ~np.isfinite(scene.spin_at_start * scene.radius)
        if too_fast.any():
            grain = checks.first_bad("spin", scene.spin_at_start, too_fast)
            raise InputError(f"{grain}: the speed of its rim is not finite")
        return
    if scene.spin is not None and scene.spin.any():
        raise InputError(
            f"{checks.first_bad('spin', scene.spin, scene.spin != 0.0)}: grains rotate only with friction"
        )
    if scene.spin_drag:
        raise InputError(f"spin_drag is {scene.spin_drag} kg m2/s: grains rotate only with friction")


def _require_short_step(scene: Scene) -> None:
    mass = float(scene.mass.min())
    lost = scene.drag * scene.dt / mass  # fraction of a velocity that one step of the text's scheme removes
    if lost < 1.0:
        return
    lightest = int(np.argmin(scene.mass))
    if scene.scheme == "text":
        raise InputError(
            f"dt is {scene.dt} s: in one step, drag {scene.drag} kg/s would reverse grain {lightest}"
            f' of mass {mass} kg; dt must be less than {mass / scene.drag} s, or scheme "leapfrog"'
        )
    if not isfinite(lost):
        raise InputError(
            f"drag is {scene.drag} kg/s: drag dt / m is not finite for dt {scene.dt} s and"
            f" grain {lightest} of mass {mass} kg"
        )
