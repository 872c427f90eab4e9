"""Settings of a report, and the rows of its tables."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

ACCURATE: dict[str, Any] = {"method": "accelerated", "order": "color", "stop": "residual"}
"""Fields of a scene that is solved as well as can be."""
SWEEPING = ("gauss-seidel", "accelerated")
"""Methods of which so many iterations can be asked."""
SECOND_ORDER = "leapfrog, round wall"
SCHEMES = {
    "text": {"scheme": "text", "wall": "tangent"},
    SECOND_ORDER: {"scheme": "leapfrog", "wall": "round"},
}
"""Fields of a scene, by what a report calls them."""
COSTS = (16, 160, 1600)  # iterations spent in one of the scene's own steps, where equal work is compared


@dataclass(frozen=True)
class Budget:
    """Limits of the measurements; the default takes some minutes for the shipped scenes."""

    repeats: int = 5
    """Times a step is taken, of which the median counts."""
    most_iterations: int = 10_000
    """Of one step."""
    longest: float = 0.2
    """Wall time of a step after which no more iterations are tried [s]."""
    history: int = 1000
    """Steps after which the history of a scene is cut off."""
    horizon: int = 32
    """Longest time over which trajectories are followed, in the scene's own steps; a multiple of 4."""

    @property
    def iterations(self) -> list[int]:
        """Limits on the iterations of a step: 1, 3, 10, 30, ..."""
        steps = range(2 * len(str(self.most_iterations)))
        limits = [(1, 3)[k % 2] * 10 ** (k // 2) for k in steps]
        return [limit for limit in limits if limit <= self.most_iterations]


class Configuration(NamedTuple):
    """Code, method, order and threads that solve a step."""

    code: str
    """warpgrains, or C reference."""
    method: str
    order: str
    threads: int


@dataclass(frozen=True)
class StepRow:
    """One step in one configuration: a row of steps.csv."""

    scene: str
    moment: str
    time: float
    """Simulated time at which the step starts [s]."""
    grains: int
    contacts: int
    """Contacts that carry a correction after the step."""
    code: str
    method: str
    order: str
    threads: int
    """These four say what solved it, see `Configuration`."""
    iterations: int
    wall_time: float
    """Median of the repeats [s]."""
    error: float
    """Largest difference of a velocity component from the exact solution [m/s]."""
    error_of_exact: float
    """Difference of the exact solution from that of the exact method, converged as far as it goes:
    errors below it are not to be trusted [m/s]."""
    error_of_nothing: float
    """Error of the free velocities, of a step without any contact [m/s]."""

    @property
    def configuration(self) -> Configuration:
        """Columns code to threads."""
        return Configuration(self.code, self.method, self.order, self.threads)


@dataclass(frozen=True)
class PathRow:
    """A trajectory: a row of trajectories.csv."""

    scene: str
    scheme: str
    """One of `SCHEMES`."""
    horizon: float
    """How long it is [s]."""
    dt: float
    """[s]."""
    error: float
    """Largest distance of a coordinate from the trajectory of second order with steps 1/64 as long as the
    scene's own, at any multiple of four of the scene's own steps [m]; nan where a grain was lost."""
    finest_error: float
    """The same distance of one with steps 1/32 as long: errors near it are not to be trusted [m]."""
    cpu_time: float
    """Spent on all steps [s]."""


@dataclass(frozen=True)
class FrontierRow:
    """A run of equal work: a row of frontier.csv."""

    scene: str
    method: str
    horizon: float
    """How long it is [s]."""
    cost: int
    """Iterations spent in a time as long as the scene's own step."""
    dt: float
    """[s]."""
    iterations: int
    """Of a step: cost times dt in the scene's own steps."""
    overlap: float
    """Worst overlap that is left after any step of the run's second half [m]; nan where a grain was lost,
    which happens when far too few iterations leave two centres at one place."""
    wall_floor: float
    """(v dt)^2 / (2 radius_out), v the largest speed in a run of solved steps: the overlap with the outer
    wall that a tangential move may leave, however well a step is solved [m]; 0 where the wall is round."""


@dataclass(frozen=True)
class Findings:
    """All that was measured, scene after scene."""

    steps: list[StepRow] = field(default_factory=list)
    paths: list[PathRow] = field(default_factory=list)
    frontier: list[FrontierRow] = field(default_factory=list)

    def of(self, scene: str) -> "Findings":
        """Return what was found of one scene."""
        return Findings(*([row for row in rows if row.scene == scene] for rows in vars(self).values()))


def fitted_order(rows: list[PathRow]) -> float | None:
    """Return p of error = c dt^p, by least squares in the logarithms; None of fewer than two errors."""
    rows = [row for row in rows if row.error > 0.0]
    if len(rows) < 2:
        return None
    return float(np.polyfit(np.log([row.dt for row in rows]), np.log([row.error for row in rows]), 1)[0])
