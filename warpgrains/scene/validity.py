"""What makes a scene: the check of every field of `Scene`, and of those that must suit each other."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from warpgrains.errors import SceneError
from warpgrains.scene import checks
from warpgrains.scene.geometry import require_distinct
from warpgrains.scene.scheme import SCHEMES
from warpgrains.scene.walls import Annulus

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

ORDERS = ("sequential", "color")
METHODS = ("gauss-seidel", "accelerated", "exact")
STOPS = ("default", "zeta", "residual")
UNCONVERGED = ("report", "raise")
MOST_RADII = 1e12  # of the smallest grain, in that of the outer wall: positions have no digits for more

SETTINGS: dict[str, Callable[[str, Any], Any]] = {
    "gravity": checks.vector,
    "drag": checks.not_negative,
    "dt": checks.positive,
    "scheme": partial(checks.one_of, known=SCHEMES),
    "duration": checks.positive,
    "tolerance": checks.not_negative,
    "max_iterations": checks.whole_number,
    "order": partial(checks.one_of, known=ORDERS),
    "method": partial(checks.one_of, known=METHODS),
    "stop": partial(checks.one_of, known=STOPS),
    "on_unconverged": partial(checks.one_of, known=UNCONVERGED),
    "name": checks.text,
    "text": checks.text,
}
"""Checks of the fields that are not of grains or walls."""


def checked_settings(scene: Scene, names: Iterable[str] = SETTINGS) -> dict[str, Any]:
    """Return fields that are not of grains or walls, as a scene keeps them.

    Raises
    ------
    SceneError
        One is not what it must be.
    """
    return {name: SETTINGS[name](name, getattr(scene, name)) for name in names}


def checked_grains(scene: Scene) -> dict[str, Any]:
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
        **Annulus.checked(scene.radius_in, scene.radius_out, scene.wall)._asdict(),
    }


def require_places(scene: Scene) -> None:
    """Raise SceneError unless all grains are between the walls, apart, and in places that have digits."""
    _require_size(scene)
    scene.walls.require_inside(scene.position, scene.radius)
    require_distinct("position", scene.position)


def _require_size(scene: Scene) -> None:
    """Raise SceneError unless positions have digits for a gap, and squares."""
    smallest = scene.smallest_radius
    if scene.radius_out / MOST_RADII >= smallest:
        raise SceneError(
            f"radius_out is {scene.radius_out} m: it must be less than {MOST_RADII:g} radii of"
            f" grain {int(np.argmin(scene.radius))}, {smallest} m, for positions to have digits for a gap"
        )
    scene.walls.require_size()


def require_agreement(scene: Scene) -> None:
    """Raise SceneError unless the settings suit each other, and the grains."""
    _require_short_step(scene)
    if scene.method == "exact" and scene.stop == "zeta":
        raise SceneError("stop is 'zeta': method 'exact' stops on the residual")


def _require_short_step(scene: Scene) -> None:
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
