"""When a run ends before its last step: at rest, or at what a caller asks for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, hypot, sqrt
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.errors import InputError
from warpgrains.scene import checks

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.statistics import RunStatistics

EVERY = 10  # steps between two tests
FROUDE = 1e-3  # largest speed at rest, in sqrt(g d), d the mean diameter
TOLERANCES = 10.0  # or in the scene's tolerance, where that is more: what a step leaves is no motion
FALLS = 5.0  # how long it must hold, in sqrt(d / g)


class Moving(Protocol):
    """Grains that move: a `Simulation`, a scene of a `Batch`, a `Snapshot`."""

    @property
    def velocity(self) -> FloatArray:
        """Velocities of the grains [m/s], shape (n, 2)."""


Question = Callable[[Any], bool]


@dataclass(frozen=True)
class Criterion:
    """What ends a run."""

    holds: Question
    """Asked every `EVERY` steps."""
    steps: int
    """For how many steps it must hold."""
    name: str

    def is_met(self, moving: Moving, statistics: RunStatistics) -> bool:
        """Test, every `EVERY` steps of a run, whether it ends now; count for how long that has held.

        Parameters
        ----------
        moving : Moving
            Its grains.
        statistics : RunStatistics
            What the run has done; `held` and `met` are updated.
        """
        if statistics.steps % EVERY == 0:
            held = statistics.held + EVERY if statistics.held else 1
            statistics.held = held if self.holds(moving) else 0
            statistics.met = statistics.held > self.steps
        return statistics.met


def steps_to_test(steps: int) -> int:
    """Return the steps that a run, which has done `steps`, takes to its next test."""
    return EVERY - steps % EVERY


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
    InputError
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
            raise InputError(f"until is {checks.shown(until)}: it must be 'rest', or a function")
        return Criterion(until, 0, "the criterion")
    return _rest(rest_bounds(until), scene)


def rest_bounds(until: str) -> dict[str, float]:
    """Return the bounds that a text such as "rest,speed=1e-3,time=0.5" sets, by their keys.

    Raises
    ------
    InputError
        It is no such text.
    """
    name, *rest = (word.strip() for word in until.split(","))
    checks.one_of("until", name, ("rest",))
    given: dict[str, float] = {}
    for word in rest:
        key, _, value = word.partition("=")
        checks.one_of("key of until=rest", key, ("speed", "energy", "time"))
        try:
            given[key] = checks.positive(f"until: {key}", float(value))
        except ValueError as error:
            wrong = error if isinstance(error, InputError) else f"until: {word!r} is not a number"
            raise InputError(str(wrong)) from None
    return given


def _rest(given: dict[str, float], scene: Scene) -> Criterion:
    gravity, diameter = hypot(*scene.gravity), 2.0 * float(scene.radius.mean())
    if gravity == 0.0 and not ("time" in given and given.keys() & {"speed", "energy"}):
        raise InputError("until=rest needs time, and speed or energy, in a scene without gravity")
    bounds = dict(given)
    time = bounds.pop("time", None) or FALLS * sqrt(diameter / gravity)
    if not bounds:
        bounds["speed"] = max(FROUDE * sqrt(gravity * diameter), TOLERANCES * scene.tolerance)
    speed, energy = bounds.get("speed", np.inf), bounds.get("energy", np.inf)

    def holds(moving: Moving) -> bool:
        square = (moving.velocity**2).sum(axis=1)
        return bool(square.max() <= speed**2 and 0.5 * scene.mass @ square <= energy)

    return Criterion(holds, ceil(time / scene.dt), "rest")
