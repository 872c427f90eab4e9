"""The same work spent on many short steps or on few well solved ones: which leaves less overlap."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from warpgrains.errors import SimulationError
from warpgrains.report.trajectories import begin, begin_solved, follow, possible_fractions
from warpgrains.scene.scene import METHODS, Scene
from warpgrains.scene.state import State

COSTS = (16, 160, 1600)  # iterations spent in one of the scene's own steps


@dataclass(frozen=True)
class FrontierRow:
    """A run of equal work: a row of frontier.csv.

    Attributes
    ----------
    scene, method : str
    horizon : float
        How long it is [s].
    cost : int
        Iterations spent in a time as long as the scene's own step.
    dt : float
        [s].
    iterations : int
        Of a step: cost times dt in the scene's own steps.
    overlap : float
        Worst overlap that is left after any step of the run's second half [m]; nan where a grain was lost,
        which happens when far too few iterations leave two centres at one place.
    wall_floor : float
        (v dt)^2 / (2 radius_out), v the largest speed in a run of solved steps: the overlap with the outer
        wall that a tangential move may leave, however well a step is solved [m].
    """

    scene: str
    method: str
    horizon: float
    cost: int
    dt: float
    iterations: int
    overlap: float
    wall_floor: float


def measure_frontier(scene: Scene, start: State, horizon: int) -> Iterator[FrontierRow]:
    """Run from a state on, without its corrections, in color order.

    Parameters
    ----------
    scene : Scene
    start : State
    horizon : int
        For how many of the scene's own steps.
    """
    fastest = follow(begin_solved(scene, start), 1.0, horizon).fastest
    for cost in COSTS:
        for fraction in possible_fractions(scene):
            for method in METHODS:
                dt, iterations = scene.dt * fraction, round(cost * fraction)
                limits = {"order": "color", "tolerance": 0.0, "max_iterations": iterations}
                try:
                    spending = begin(scene, start).replace(method=method, **limits)
                    overlap = follow(spending, fraction, horizon).overlap
                except SimulationError:
                    overlap = np.nan
                yield FrontierRow(
                    scene=scene.name,
                    method=method,
                    horizon=horizon * scene.dt,
                    cost=cost,
                    dt=dt,
                    iterations=iterations,
                    overlap=overlap,
                    wall_floor=(fastest * dt) ** 2 / (2.0 * scene.radius_out),
                )
