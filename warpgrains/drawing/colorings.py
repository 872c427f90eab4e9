"""Quantities that give grains their colors: values in a snapshot, and ends of the scale in a scene."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from warpgrains.base.arrays import FloatArray, IndexArray
from warpgrains.scene.snapshot import Snapshot
from warpgrains.walls.line import Line
from warpgrains.walls.rim import Rim
from warpgrains.walls.wall import Wall

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene


class Coloring(NamedTuple):
    """A quantity by which grains are colored, which recordings also hold as numbers."""

    unit: str
    """Unit of the values; empty for a pure number."""
    colormap: str
    """Name of the colormap, see `colors.colormap`."""
    ends: Callable[[Scene], tuple[float, float]]
    """Function that returns the values of the first and last color in a scene."""
    values: Callable[[Any], FloatArray]
    """Function that returns the value of each grain, shape (n,), from a snapshot.

    If values do not change during a run (`changes`), it also takes a scene.
    """
    extends: str = "neither"
    """Ends of the scale that values may exceed, as Matplotlib names them: neither, max or both."""
    changes: bool = True
    """Whether the values change during a run."""
    has_root: bool = False
    """Whether colors are linear in the square root of the value, so that small values differ in color."""
    needs_friction: bool = False
    """Whether only scenes with friction have the quantity."""
    needs_contacts: bool = False
    """Whether the values are computed from the contacts of a snapshot."""


def colorings_of(scene: Scene, has_contacts: bool = True) -> dict[str, Coloring]:
    """Return the colorings that a scene has, by name; without contacts, only those that need none."""
    return {
        name: own
        for name, own in COLORINGS.items()
        if scene.has_friction >= own.needs_friction and has_contacts >= own.needs_contacts
    }


def speed_scale(scene: Scene) -> float:
    """Return an estimate of the largest speed in a scene [m/s], for the ends of color scales.

    It is the largest of these speeds: that of the fastest grain at the start, that of a grain after a fall
    across the domain, and those of moving walls.
    """
    thrown = float(np.hypot(*scene.velocity.T).max())
    gravity = float(np.hypot(*scene.gravity))
    falling = np.sqrt(gravity * scene.widest)
    if scene.drag > 0.0:
        falling = min(falling, gravity * float(scene.mass.max()) / scene.drag)
    mass, found = float(scene.mass.sum()), [thrown, float(falling)]
    for wall in scene.walls:
        if isinstance(wall, Rim):
            pressed = sqrt(2.0 * abs(wall.pressure or 0.0) * scene.area / mass) if wall.drive else 0.0
            found += pressed, abs(wall.surface_speed)
            continue
        rim = wall.border.radius if wall.border is not None and scene.has_friction else 0.0
        found.append(wall.largest_speed(wall.farthest(wall.about) + rim))
        if wall.drive is not None:
            whole = 1.0 / wall.drive.inverse_mass + mass
            found.append(sqrt(2.0 * abs(wall.drive.given_force) * scene.widest / whole))
    return max(found)


def _length(wall: Wall) -> float:
    """Return the length of a wall by which a force on it is divided to get a pressure [m]."""
    return wall.length if isinstance(wall, Line) else 2.0 * wall.circle[2]


def spin_scale(scene: Scene) -> float:
    """Return an estimate of large spins in a scene [rad/s], for the ends of color scales.

    It is the largest spin at the start or, if larger, that of a grain of typical radius that rolls at half of
    `speed_scale`.
    """
    return max(float(np.abs(scene.spin).max()), 0.5 * speed_scale(scene) / scene.typical_radius)


def pressure_scale(scene: Scene) -> float:
    """Return an estimate of large pressures in a scene [N/m], for the ends of color scales.

    It is the weight of all grains, divided by a quarter of the width of the domain, or if larger, four times
    the pressure on a driven wall. Without gravity and driven walls, it is the pressure on a mean grain that
    loses the speed `speed_scale` (or, if that is 0, one radius per step) within one step.
    """
    weight = float(scene.mass.sum() * np.hypot(*scene.gravity))
    driven = [
        abs(wall.pressure or 0.0) if isinstance(wall, Rim) else abs(wall.drive.given_force) / _length(wall)
        for wall in scene.walls
        if wall.drive is not None
    ]
    given = 4.0 * max([0.0, *driven])
    if weight > 0.0 or given > 0.0:
        return max(given, weight / (scene.widest / 4.0))
    radius = float(scene.radius.mean())
    stopping = float(scene.mass.mean()) * (speed_scale(scene) or radius / scene.dt) / scene.dt
    return stopping / (2.0 * np.pi * radius)


def pressure(now: Snapshot) -> FloatArray:
    """Return the sum of the normal forces on each grain, divided by its circumference [N/m], shape (n,)."""
    return force(now) / (2.0 * np.pi * now.scene.radius)


def force(now: Snapshot) -> FloatArray:
    """Return the sum of the normal forces on each grain [N], shape (n,)."""
    grain = np.concatenate([*now.pair.T, now.wall[:, 0]])
    pushed = np.concatenate([now.force, now.force, now.wall_force])
    return np.bincount(grain, pushed, now.n).astype(np.float64)  # integers without contacts


def mobilized(now: Snapshot) -> FloatArray:
    """Return the largest |tangential force| / (friction * normal force) of the contacts of each grain, (n,).

    Where this is 1, the contact slides.
    """
    found, (i, j), grain = np.zeros(now.n), now.pair.T, now.wall[:, 0]
    between = _share(now.tangential_force, now.scene.friction * now.force)
    at_wall = _share(
        now.wall_tangential_force, now.scene.at_walls["friction"][now.wall[:, 1]] * now.wall_force
    )
    for loaded, share in ((i, between), (j, between), (grain, at_wall)):
        np.maximum.at(found, loaded, share)
    return found


def _share(tangential: FloatArray, most: FloatArray) -> FloatArray:
    """Return |tangential| / most for each contact, shape (m,), or 0 where most = 0.

    `tangential` is the tangential force, `most` its largest value without sliding [N].
    """
    return np.divide(np.abs(tangential), most, out=np.zeros_like(most), where=most > 0.0)


def start_height(scene: Scene) -> FloatArray:
    """Return the height of each grain at the start, measured against gravity [m], shape (n,).

    Positions are rounded to float32, so that a recording gives the same heights.
    """
    return scene.position.astype(np.float32).astype(np.float64) @ scene.up_at(scene.time)


def _ends(of: Callable[[Scene], FloatArray], scene: Scene) -> tuple[float, float]:
    values = of(scene)
    return float(values.min()), float(values.max())


def force_scale(scene: Scene) -> float:
    """Return the sum of the normal forces on a grain of mean radius with pressure `pressure_scale` [N]."""
    return pressure_scale(scene) * 2.0 * np.pi * float(scene.radius.mean())


def _radii(of: Scene | Snapshot) -> FloatArray:
    return of.scene.radius if isinstance(of, Snapshot) else of.radius


def numbers_of_birth(of: Scene | Snapshot) -> IndexArray:
    """Return the ids of the grains of a snapshot, or at the start of a scene, shape (n,).

    They number the grains of a run in the order in which they appear.
    """
    return of.id if isinstance(of, Snapshot) else np.arange(of.n)


_STILL: dict[str, tuple[str, str, Callable[[Any], FloatArray]]] = {
    "radius": ("m", "plasma", _radii),
    "id": ("", "viridis", lambda of: numbers_of_birth(of).astype(np.float64)),
    "height": ("m", "plasma_r", start_height),
}
_PUSHED: dict[str, Any] = {"extends": "max", "has_root": True, "needs_contacts": True}
COLORINGS = {
    **{
        name: Coloring(unit, colors, partial(_ends, of), of, changes=False)
        for name, (unit, colors, of) in _STILL.items()
    },
    "speed": Coloring(
        "m/s",
        "YlGnBu",
        lambda scene: (0.0, speed_scale(scene)),
        lambda now: np.hypot(*now.velocity.T),
        "max",
        has_root=True,
    ),
    "pressure": Coloring("N/m", "YlOrBr", lambda scene: (0.0, pressure_scale(scene)), pressure, **_PUSHED),
    "force": Coloring("N", "YlGn", lambda scene: (0.0, force_scale(scene)), force, **_PUSHED),
    "spin": Coloring(
        "rad/s",
        "PuOr",
        lambda scene: (-spin_scale(scene), spin_scale(scene)),
        lambda now: now.spin,
        "both",
        needs_friction=True,
    ),
    "mobilized": Coloring(
        "", "Purples", lambda _: (0.0, 1.0), mobilized, needs_friction=True, needs_contacts=True
    ),
}
"""The colorings by the value of `color_by`; for "palette" and "bands" see `colors.CATEGORIES`."""
