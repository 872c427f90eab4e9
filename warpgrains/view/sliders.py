"""Sliders of the page: their values, and those that change the scene of a simulation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from warpgrains.view.players import Live

_MOST_ROTATION = 10.0  # rad/s
_HINT = "angular velocity, counterclockwise; it needs friction"

Change = Callable[[], None]
OnChange = Callable[[Change], Callable[[Any], None]]
"""Function that makes the callback of a slider from a change of the scene."""


def value_of(slider: viser.GuiInputHandle[Any]) -> float:
    """Return the value of a slider, within its range whatever the browser sends."""
    low, high = slider.min, slider.max  # type: ignore[attr-defined]
    return float(np.clip(np.nan_to_num(float(slider.value), nan=low), low, high))


def add_physics(gui: viser.GuiApi, player: Live, on: OnChange) -> None:
    """Add sliders of the physics, which start at the values of the scene."""
    scene, rate = player.scene, player.scene.gravity_rate
    size, angle = float(np.hypot(*scene.gravity)), float(np.degrees(np.arctan2(*scene.gravity[::-1])))
    most_drag = 0.9 * float(scene.mass.min()) / scene.dt
    drag = gui.add_slider("drag [kg/s]", 0.0, most_drag, most_drag / 200.0, min(scene.drag, most_drag))
    drag.on_update(on(lambda: player.change(drag=value_of(drag))))
    pull = gui.add_slider("gravity [m/s2]", 0.0, max(20.0, size), 0.01, size)
    hint = f"0 is to the right, -90 is down{'; at time 0' if rate else ''}"
    towards = gui.add_slider("gravity direction [degrees]", -180.0, 180.0, 1.0, angle, hint=hint)
    for slider in (pull, towards):
        slider.on_update(on(lambda: player.change(gravity=_gravity(value_of(pull), value_of(towards), rate))))
    exponent = float(np.log10(scene.tolerance)) if scene.tolerance > 0.0 else -12.0
    tolerance = gui.add_slider("log10 of tolerance [m/s]", min(-12.0, exponent), 0.0, 0.1, exponent)
    tolerance.on_update(on(lambda: player.change(tolerance=10.0 ** value_of(tolerance))))
    restitution = gui.add_slider("restitution", 0.0, 1.0, 0.01, scene.restitution)
    restitution.on_update(on(lambda: player.set_restitution(value_of(restitution))))
    _add_friction(gui, player, on)


def _gravity(size: float, degrees: float, rate: float) -> dict[str, Any]:
    """Return gravity of a size [m/s2] and direction at time 0, which turns at a rate [rad/s]."""
    angle = np.radians(degrees)
    return {"vector": (float(size * np.cos(angle)), float(size * np.sin(angle))), "rotate": rate}


def _add_friction(gui: viser.GuiApi, player: Live, on: OnChange) -> None:
    """Add sliders of friction and of the angular velocities of the circles."""
    scene, sliders = player.scene, []
    given = {"friction": scene.friction, "rolling friction": scene.rolling_friction}
    rough = [gui.add_slider(label, 0.0, max(1.0, own), 0.01, own) for label, own in given.items()]
    walls = [("outer wall [rad/s]", scene.angular_velocity_out)] * (scene.bodies.outer is not None)
    walls += [("inner wall [rad/s]", scene.angular_velocity_in)] * (scene.radius_in > 0.0)
    for label, spin in walls:
        most = max(_MOST_ROTATION, abs(spin))
        sliders.append(gui.add_slider(label, -most, most, 0.1, spin, hint=_HINT))

    def change() -> None:
        player.set_friction(*[*map(value_of, sliders), 0.0, 0.0][:2], *map(value_of, rough))

    for slider in rough + sliders:
        slider.on_update(on(change))
