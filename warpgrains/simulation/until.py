"""End criteria of runs: rest, or a condition given by the caller."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, hypot, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from warpgrains.base import checks
from warpgrains.base.errors import InputError, written_as
from warpgrains.scene.energy import kinetic_energy
from warpgrains.scene.gravity import TurningGravity

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.loaded_scene import LoadedScene

TEST_INTERVAL = 10  # steps between two tests
FROUDE = 1e-3  # largest speed at rest, in sqrt(g d), d the mean diameter
TOLERANCE = 10.0  # or this many tolerances, if larger: a converged step leaves such speeds
REST_TIME = 5.0  # duration for which the end criterion must hold, in sqrt(d / g)
BOUNDS = ("speed", "energy", "time")

Question = Callable[[Any], bool]


@dataclass(frozen=True)
class EndCriterion:
    """End criterion of a run."""

    condition: Question
    """Function that returns True if a simulation meets the criterion; called every `TEST_INTERVAL` steps."""
    steps: int = 0
    """Number of steps for which the condition must hold to end the run; 0: the first test may end it."""
    name: str = "the end criterion"


def criterion(until: str | Question | EndCriterion | None, scene: Scene) -> EndCriterion | None:
    """Return the end criterion of a run, or None.

    Parameters
    ----------
    until : str or callable, optional
        A callable receives the simulation and returns True to end the run. The text "rest" ends it when, for
        a `time` [s], no grain or driven wall was faster than `speed` [m/s] and `kinetic_energy` was at most
        `energy` [J]: "rest,speed=1e-3,time=0.5". The run goes on while a wall will move or gravity turns.
        The default speed is sqrt(g d) / 1000 with the mean diameter d, or ten tolerances if that is larger.
        The default time is 5 sqrt(d / g).

    Raises
    ------
    InputError
        `until` is invalid; or there is no gravity, and the bounds that depend on it are not given.

    Examples
    --------
    >>> criterion("rest,speed=1e-3,time=0.5", simulation.scene).steps
    50
    """
    if until is None or isinstance(until, EndCriterion):
        return until
    if isinstance(until, str):
        return _rest(bounds_of(until), scene)
    if not callable(until):
        raise InputError(f"until is {checks.shown(until)}: it must be 'rest', or a function")
    return EndCriterion(until)


def bounds_of(until: str) -> dict[str, float]:
    """Return the bounds in the text of an end criterion, by key; InputError if the text is invalid.

    For "rest,speed=1e-3,time=0.5", they are {"speed": 1e-3, "time": 0.5}.
    """
    name, *rest = (word.strip() for word in until.split(","))
    checks.one_of("until", name, ("rest",))
    given: dict[str, float] = {}
    for word in rest:
        key, _, value = word.partition("=")
        with written_as({}, "until"):
            checks.one_of("key", key, BOUNDS)
        try:
            bound = float(value)
        except ValueError:
            raise InputError(f"until: {word!r} must be a bound such as {key}=1e-3") from None
        given[key] = checks.positive(f"until: {key}", bound)
    return given


def _rest(bounds: dict[str, float], scene: Scene) -> EndCriterion:
    gravity, diameter = hypot(*scene.gravity), 2.0 * float(scene.radius.mean())
    if gravity == 0.0 and not ("time" in bounds and len(bounds) > 1):
        raise InputError("until=rest needs time, and speed or energy, in a scene without gravity")
    time = bounds.pop("time", None) or REST_TIME * sqrt(diameter / gravity)
    if not bounds:
        bounds["speed"] = max(FROUDE * sqrt(gravity * diameter), TOLERANCE * scene.tolerance)
    speed, energy = bounds.get("speed", np.inf), bounds.get("energy", np.inf)

    def is_at_rest(now: LoadedScene) -> bool:
        will_move = any(wall.moves and now.time < wall.stops_at for wall in now.scene.walls)
        if will_move or isinstance(now.scene.gravity, TurningGravity):
            return False
        if now.driven is not None and np.abs(now.driven[:, 1]).max() > speed:
            return False
        if (now.velocity**2).sum(axis=1).max() > speed**2:
            return False
        return bool(kinetic_energy(now.scene.mass, now.scene.radius, now.velocity, now.spin) <= energy)

    return EndCriterion(is_at_rest, ceil(time / scene.dt), "rest")
