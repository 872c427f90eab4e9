"""When a run ends before its last step: at rest, or at what a caller asks for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, hypot, sqrt
from typing import TYPE_CHECKING

import numpy as np

from warpgrains.errors import SceneError
from warpgrains.scene import checks

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.simulation.simulation import Simulation

EVERY = 10  # steps between two looks
FROUDE = 1e-3  # largest speed at rest, in sqrt(g d), d the mean diameter
TOLERANCES = 10.0  # or in the scene's tolerance, where that is more: what a step leaves is no motion
FALLS = 5.0  # how long it must hold, in sqrt(d / g)

Question = Callable[["Simulation"], bool]


@dataclass(frozen=True)
class Criterion:
    """What ends a run."""

    holds: Question
    """Asked every `EVERY` steps."""
    steps: int
    """For how many steps it must hold."""
    name: str


def criterion(until: str | Question | None, scene: Scene) -> Criterion | None:
    """Return what ends a run of a scene.

    Parameters
    ----------
    until : str or callable, optional
        A callable is given the simulation, and is true where the run is to end. A text is "rest", which holds
        while no grain is faster than `speed` [m/s], and the kinetic energy not above `energy` [J], for a
        `time` [s]: "rest,speed=1e-3,time=0.5". By default the speed is sqrt(g d) / 1000, d the mean diameter,
        or ten tolerances if that is more, and the time 5 sqrt(d / g).

    Raises
    ------
    SceneError
        It is none of these; or there is no gravity, and the bounds that it sets are not given.

    Examples
    --------
    >>> criterion("rest,speed=1e-3,time=0.5", simulation.scene).steps
    50
    """
    if until is None:
        return None
    if not isinstance(until, str):
        if not callable(until):
            raise SceneError(f"until is {checks.shown(until)}: it must be 'rest', or a function")
        return Criterion(until, 0, "what was asked for")
    name, *rest = (word.strip() for word in until.split(","))
    checks.one_of("until", name, ("rest",))
    given: dict[str, float] = {}
    for word in rest:
        key, _, value = word.partition("=")
        checks.one_of("key of until=rest", key, ("speed", "energy", "time"))
        try:
            given[key] = checks.positive(f"until: {key}", float(value))
        except ValueError as error:
            wrong = error if isinstance(error, SceneError) else f"until: {word!r} is no number"
            raise SceneError(str(wrong)) from None
    return _rest(given, scene)


def _rest(given: dict[str, float], scene: Scene) -> Criterion:
    gravity, diameter = hypot(*scene.gravity), 2.0 * float(scene.radius.mean())
    if gravity == 0.0 and not ("time" in given and given.keys() & {"speed", "energy"}):
        raise SceneError("until=rest needs time, and speed or energy, where there is no gravity")
    bounds = dict(given)
    time = bounds.pop("time", None) or FALLS * sqrt(diameter / gravity)
    if not bounds:
        bounds["speed"] = max(FROUDE * sqrt(gravity * diameter), TOLERANCES * scene.tolerance)
    speed, energy = bounds.get("speed", np.inf), bounds.get("energy", np.inf)

    def holds(simulation: Simulation) -> bool:
        square = (simulation.velocity**2).sum(axis=1)
        return bool(square.max() <= speed**2 and 0.5 * scene.mass @ square <= energy)

    return Criterion(holds, ceil(time / scene.dt), "rest")
