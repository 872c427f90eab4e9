"""Sliders of the page that change the scene of a simulation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from warpgrains.view.players import Live

_MOST_ROTATION = 10.0  # rad/s
_HINT = "angular velocity, counterclockwise; it needs friction"

Change = Callable[[], None]
Slider = viser.GuiSliderHandle[float]
OnChange = Callable[[Change], Callable[[Any], None]]
"""Function that turns a change of the scene into the callback of a slider."""


def value_of(slider: viser.GuiInputHandle[Any]) -> float:
    """Return the value of a slider. One that the browser sends from outside of the range is clipped."""
    low, high = slider.min, slider.max  # type: ignore[attr-defined]
    return float(np.clip(np.nan_to_num(float(slider.value), nan=low), low, high))


class Sliders:
    """Sliders of gravity, drag, friction and the like, which change the scene of a player.

    At first, they have the values of its scene. `on` turns a change into the callback of a slider.
    """

    def __init__(self, gui: viser.GuiApi, player: Live, on: OnChange) -> None:
        self._gui, self._player, self._on = gui, player, on
        self._first: list[tuple[Slider, str, float]] = []
        self._clipped: dict[str, str] = {}
        scene, rate = player.scene, player.scene.gravity_rate
        size, angle = float(np.hypot(*scene.gravity)), float(np.degrees(np.arctan2(*scene.gravity[::-1])))
        most_drag = 0.9 * float(scene.mass.min()) / scene.dt
        drag = self._add("drag [kg/s]", 0.0, most_drag, most_drag / 200.0, min(scene.drag, most_drag))
        drag.on_update(on(lambda: player.change(drag=value_of(drag))))
        pull = self._add("gravity [m/s2]", 0.0, max(20.0, size), 0.01, size)
        hint = f"0 is to the right, -90 is down{'; at time 0' if rate else ''}"
        towards = self._add("gravity direction [degrees]", -180.0, 180.0, 1.0, angle, hint)
        for slider in (pull, towards):
            slider.on_update(on(lambda: player.change(gravity=_gravity(pull, towards, rate))))
        exponent = float(np.log10(scene.tolerance)) if scene.tolerance > 0.0 else -12.0
        tolerance = self._add("log10 of tolerance [m/s]", min(-12.0, exponent), 0.0, 0.1, exponent)
        tolerance.on_update(on(lambda: player.change(tolerance=10.0 ** value_of(tolerance))))
        restitution = self._add("restitution", 0.0, 1.0, 0.01, scene.restitution)
        restitution.on_update(on(lambda: player.set_restitution(value_of(restitution))))
        self._add_friction()

    def _add(
        self, label: str, low: float, high: float, step: float, value: float, hint: str | None = None
    ) -> Slider:
        slider = self._gui.add_slider(label, low, high, step, value, hint=hint)
        self._first.append((slider, label, value))
        return slider

    def _add_friction(self) -> None:
        """Add sliders for friction, rolling friction, and the angular velocities of the circles."""
        player, scene, sliders = self._player, self._player.scene, []
        given = {"friction": scene.friction}
        if scene.method != "exact":  # which knows no other
            given["rolling friction"] = scene.rolling_friction
        rough = [self._add(label, 0.0, max(1.0, own), 0.01, own) for label, own in given.items()]
        walls = [("outer wall [rad/s]", scene.angular_velocity_out)] * (scene.bodies.outer is not None)
        walls += [("inner wall [rad/s]", scene.angular_velocity_in)] * (scene.radius_in > 0.0)
        for label, spin in walls:
            most = max(_MOST_ROTATION, abs(spin))
            sliders.append(self._add(label, -most, most, 0.1, spin, _HINT))

        def change() -> None:
            player.set_friction(*[*map(value_of, sliders), 0.0, 0.0][:2], *map(value_of, rough))

        for slider in rough + sliders:
            slider.on_update(self._on(change))

    def reset(self) -> None:
        """Set all sliders to their first values, and so change the scene."""
        for slider, _, value in self._first:
            slider.value = value  # type: ignore[misc]

    def clipped(self) -> str | None:
        """Return a message about a slider to which the user gave a value out of its range; None without one.

        The browser may have clipped the value since. Then the slider is at an end of its range.
        """
        for slider, label, _ in self._first:
            low, high, value = slider.min, slider.max, float(slider.value)
            if not low <= value <= high:
                self._clipped[label] = f"{label} is {value:g}: it must be {low:g} to {high:g}"
            elif value not in (low, high):
                self._clipped.pop(label, None)
        return next(iter(self._clipped.values()), None)


def _gravity(pull: Slider, towards: Slider, rate: float) -> dict[str, Any]:
    """Return the field `gravity` of a scene, from the sliders of its size and direction.

    `pull` is |g| [m/s2], `towards` the direction at time 0 [degrees], and `rate` that of its rotation
    [rad/s].
    """
    size, angle = value_of(pull), np.radians(value_of(towards))
    return {"vector": (float(size * np.cos(angle)), float(size * np.sin(angle))), "angular_velocity": rate}
