"""Limits of the measurements of a report, and the rows of its tables."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

ACCURATE: dict[str, Any] = {"method": "accelerated", "order": "color", "stop": "residual"}
"""Fields of a scene that select the solver of accurate steps; tolerances are set where it is used."""
SWEEPING = ("gauss-seidel", "accelerated")
"""Methods whose number of iterations can be prescribed."""
SECOND_ORDER = "leapfrog, round wall"
SCHEMES: dict[str, dict[str, Any]] = {
    "euler": {"scheme": "euler", "wall": "tangent"},
    SECOND_ORDER: {"scheme": "leapfrog", "wall": "round"},
}
"""Fields of a scene that select each time scheme, by its name in the report."""
COSTS = (16, 160, 1600)  # iterations per time step of the scene, at which methods are compared


@dataclass(frozen=True)
class Budget:
    """Limits of the measurements of a report. With the defaults, the shipped scenes take some minutes."""

    repeats: int = 5
    """Number of repetitions of a step, of which the median is taken."""
    most_iterations: int = 10_000
    """Largest number of iterations of one step."""
    longest: float = 0.2
    """Wall time of a step beyond which no more iterations are tried [s]."""
    history: int = 1000
    """Largest number of steps that are followed to find the difficult ones."""
    horizon: int = 32
    """Longest duration of trajectories, in time steps of the scene; a multiple of 4."""

    @property
    def iterations(self) -> list[int]:
        """Numbers of iterations with which a step is solved: 1, 3, 10, 30, ... up to `most_iterations`."""
        steps = range(2 * len(str(self.most_iterations)))
        limits = [(1, 3)[k % 2] * 10 ** (k // 2) for k in steps]
        return [limit for limit in limits if limit <= self.most_iterations]


class Configuration(NamedTuple):
    """Code, method, order of contacts and number of threads that solve a step."""

    code: str
    """"warpgrains" or "C reference"."""
    method: str
    order: str
    threads: int


@dataclass(frozen=True)
class StepRow:
    """One solution of a step, a row of steps.csv."""

    scene: str
    moment: str
    """Name of the step: onset, hardest or end, see `History`."""
    time: float
    """Simulated time at which the step starts [s]."""
    grains: int
    contacts: int
    """Contacts that carry a correction after the step."""
    code: str
    method: str
    order: str
    threads: int
    """`code`, `method`, `order` and `threads` are those of `Configuration`."""
    iterations: int
    wall_time: float
    """Wall time of the step, median of its repetitions [s]."""
    error: float
    """Largest difference of a velocity component from the exact solution, found by clarabel [m/s]."""
    error_of_exact: float
    """Difference of the exact solution from that of method "exact" with the smallest tolerance [m/s].

    Errors below it are unreliable.
    """
    error_of_nothing: float
    """Error of the free velocities, those after a step without contacts [m/s]."""

    @property
    def configuration(self) -> Configuration:
        return Configuration(self.code, self.method, self.order, self.threads)


@dataclass(frozen=True)
class PathRow:
    """A simulation from the first contact on, with some scheme and time step; a row of trajectories.csv."""

    scene: str
    scheme: str
    """One of `SCHEMES`."""
    horizon: float
    """Duration [s]."""
    dt: float
    """Time step [s]."""
    error: float
    """Largest difference of a coordinate from the reference trajectory [m]; NaN if a grain was lost.

    The reference is of second order, with time steps 1/64 of the scene's. Both are compared after every four
    time steps of the scene.
    """
    finest_error: float
    """Error of the trajectory with time steps 1/32 of the scene's [m]. Errors of this size are unreliable."""
    cpu_time: float
    """CPU time of all steps [s]."""


@dataclass(frozen=True)
class FrontierRow:
    """A run with a prescribed number of iterations per step, a row of frontier.csv.

    Runs with the same `cost` do equal work: few iterations in short steps, or many in long ones.
    """

    scene: str
    method: str
    horizon: float
    """Duration [s]."""
    cost: int
    """Iterations per time step of the scene."""
    dt: float
    """Time step [s]."""
    iterations: int
    """Iterations per step of this run: `cost` times the ratio of `dt` to the time step of the scene."""
    overlap: float
    """Worst overlap after any step of the second half of the run [m]; NaN if a grain was lost.

    A grain is lost if far too few iterations let two centers coincide.
    """
    wall_floor: float
    """Overlap that solved steps can leave at the outer circle [m]: (v dt)^2 / (2 radius_out).

    v is the largest speed in a run of solved steps. With `wall` = "tangent", a grain that slides leaves the
    circle along its tangent. With `wall` = "round" (eq. 18), or without a circle, the value is 0.
    """


@dataclass(frozen=True)
class Findings:
    """All measurements of a report, in the order of the scenes."""

    steps: list[StepRow] = field(default_factory=list)
    paths: list[PathRow] = field(default_factory=list)
    frontier: list[FrontierRow] = field(default_factory=list)

    def of(self, scene: str) -> "Findings":
        """Return the measurements of one scene by its name."""
        return Findings(*([row for row in rows if row.scene == scene] for rows in vars(self).values()))


def fitted_order(rows: list[PathRow]) -> float | None:
    """Return the order p of error = c dt^p, fitted by least squares of logarithms.

    Rows without a positive error are left out. None if fewer than two remain.
    """
    rows = [row for row in rows if row.error > 0.0]
    if len(rows) < 2:
        return None
    return float(np.polyfit(np.log([row.dt for row in rows]), np.log([row.error for row in rows]), 1)[0])
