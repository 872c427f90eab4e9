"""All that the benchmark knows of the solver beyond its public face: to be mended where that changes."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from warpgrains import Scene, Simulation
from warpgrains.kernels.integrate import free_velocity
from warpgrains.kernels.record import Phase, grain_count
from warpgrains.kernels.stages import Each, Stage, While
from warpgrains.kernels.step import EXPIRE, METHODS, ORDER, SEARCH, START, searching
from warpgrains.kernels.threads import team_records
from warpgrains.solver.sizes import kind_of
from warpgrains.solver.tuning import paying_threads

from ..support.stages import kernel_of
from .timing import seconds

VEC = ("<f8", (2,))
CONTACT = np.dtype([("n", *VEC), ("gap_rate", "<f8"), ("i", "<u4"), ("j", "<u4")], align=True)

UP_TO_THE_LIST = (Each(grain_count, free_velocity), *START)
"""What a step does before it finds that its list will not do."""
ANOTHER_LIST = (*EXPIRE, While(searching, SEARCH), *ORDER)
"""What it does then."""


def default_threads(scene: Scene) -> int:
    """Return how many threads a simulation chooses by itself."""
    return paying_threads(scene)


class Record:
    """The record of a simulation on one thread, as it lies in memory now: stages are run on it alone."""

    def __init__(self, simulation: Simulation):
        self._records = simulation._engine._records
        self.numbers = self._records.host[0]
        self._keep()

    def array(self, name: str) -> np.ndarray:
        """Return an array of the record, such as "grains.position"; a view."""
        return self._records.array(0, name)

    def command(self, stages: Sequence[Stage]) -> wp.Launch:
        """Return the launch of some stages."""
        inputs = (self._records.device, team_records(1)[0])
        return wp.launch(kernel_of(*stages), dim=1, inputs=inputs, device="cpu", record_cmd=True)

    def _keep(self) -> None:
        self._kept = self._records.host.copy(), self._records._block(0).host.copy()

    def reset(self) -> None:
        """Put everything back to what it was at first."""
        self._records.host[:], self._records._block(0).host[:] = self._kept


def seconds_of_a_list(simulation: Simulation) -> float:
    """Return how long the step that comes next would take for another list; it is not changed by that."""
    record = Record(simulation)
    record.command(UP_TO_THE_LIST).launch()
    taken = seconds(record.command(ANOTHER_LIST).launch)
    assert record.numbers["control"]["phase"] == Phase.LISTED
    record.reset()
    return taken


def pair_count(simulation: Simulation) -> int:
    """Return the number of pairs of the list."""
    return int(Record(simulation).numbers["contacts"]["count"]["pairs"])


class Sweeps:
    """The contact iteration alone: `max_iterations` sweeps over the arrays of a simulation's last step.

    Attributes
    ----------
    pairs, walls : int
        Numbers of pairs, and of the contacts with walls that come after them.
    contact, dv, velocity : ndarray
        The arrays themselves: the records `Contact` of sweep.c and their corrections [m/s], in sweeping
        order, and velocities of the grains [m/s].
    """

    def __init__(self, simulation: Simulation):
        record = Record(simulation)
        count = record.numbers["contacts"]["count"]
        self.pairs, self.walls = int(count["pairs"]), int(count["walls"])
        self.contact = _known(record.array("contacts.contact"), CONTACT)
        self.dv = record.array("contacts.dv")
        self.velocity = record.array("grains.next_velocity")
        self._free = record.array("grains.free_velocity")
        self._peak, self._peak_limit = (record.array(f"verlet.peak_{of}") for of in ("square", "limit"))
        self._threshold = float(record.numbers["tuning"]["monitor_threshold"])
        self._numbers, self._start = record.numbers, self.contents()
        self._first = Phase.SWEEP if simulation.scene.method == "gauss-seidel" else Phase.CHECK_LIST
        self.run = record.command(METHODS[kind_of(simulation.scene)]).launch

    def contents(self) -> tuple[np.ndarray, ...]:
        """Return a copy of all that a sweep changes."""
        return self.dv.copy(), self.velocity.copy()

    def start_freely(self) -> None:
        """Let the sweeps start from free velocities, no contact carrying anything, and no skin too narrow."""
        self.dv[:], self.velocity[:] = 0.0, self._free
        self._peak_limit[:] = np.inf
        self._start = self.contents()

    def reset(self, monitored: bool = False) -> None:
        """Put everything back to where the sweeps start."""
        self.dv[:], self.velocity[:] = self._start
        self._peak[:] = 0.0
        self._numbers["tuning"]["monitor_threshold"] = self._threshold if monitored else np.inf
        self._numbers["control"]["phase"] = self._first
        self._numbers["control"]["may_stop"] = 0
        self._numbers["step"]["iterations"] = self._numbers["step"]["measured"] = 0
        self._numbers["verlet"]["flags"]["list_expired"] = 0
        self._numbers["verlet"]["work"]["unmonitored_change"] = 0.0

    def done(self) -> tuple[int, float]:
        """Return how many sweeps were done, and the last zeta [m/s]."""
        return self._numbers["step"]["iterations"].item(), self._numbers["step"]["zeta"].item()


def _known(array: np.ndarray, expected: np.dtype) -> np.ndarray:
    """Return an array of records, if they are those that sweep.c knows."""
    if array.dtype != expected:
        raise RuntimeError(f"sweep.c knows records {expected}, and the solver has {array.dtype}")
    return array
