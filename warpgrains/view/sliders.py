"""Sliders of the page: their values, and those of friction and of walls that rotate."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from warpgrains.view.players import Live

_MOST_ROTATION = 10.0  # rad/s
_HINT = "angular velocity, counterclockwise; it needs friction"

Change = Callable[[], None]


def value_of(slider: viser.GuiInputHandle[Any]) -> float:
    """Return the value of a slider, within its range whatever the browser sends."""
    low, high = slider.min, slider.max  # type: ignore[attr-defined]
    return float(np.clip(np.nan_to_num(float(slider.value), nan=low), low, high))


def add_friction(gui: viser.GuiApi, player: Live, on: Callable[[Change], Callable[[Any], None]]) -> None:
    """Add sliders of friction and of the angular velocities of the walls; `on` makes callbacks of changes."""
    scene = player.scene
    sliders = [gui.add_slider("friction", 0.0, max(1.0, scene.friction), 0.01, scene.friction)]
    walls = [("outer wall [rad/s]", scene.angular_velocity_out)]
    walls += [("inner wall [rad/s]", scene.angular_velocity_in)] * (scene.radius_in > 0.0)
    for label, spin in walls:
        most = max(_MOST_ROTATION, abs(spin))
        sliders.append(gui.add_slider(label, -most, most, 0.1, spin, hint=_HINT))

    def change() -> None:
        friction, out, inside = [*map(value_of, sliders), 0.0][:3]
        player.set_friction(friction, out, inside)

    for slider in sliders:
        slider.on_update(on(change))
