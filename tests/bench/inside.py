"""All that the benchmark knows of the solver beyond its public face: to be mended where that changes."""

from time import perf_counter

import numpy as np
import warp as wp

from warpgrains import Scene, Simulation
from warpgrains.kernels.data import DRIFT, ITERATIONS, MISSED, WATCHING, ZETA
from warpgrains.solver.step import paying_threads

VEC = ("<f8", (2,))
PAIR = np.dtype([("n", *VEC), ("gap_rate", "<f8"), ("i", "<i4"), ("j", "<i4")], align=True)
WALL = np.dtype(
    [("n", *VEC), ("gap_rate_out", "<f8"), ("gap_rate_in", "<f8"), ("dv", "<f8"), ("i", "<i4")], align=True
)


def default_threads(scene: Scene) -> int:
    """Return how many threads a simulation chooses by itself."""
    return paying_threads(scene)


def time_rebuilds(simulation: Simulation) -> list[float]:
    """Return a list that every search for contacts, from now on, adds its seconds to."""
    times: list[float] = []
    contacts = simulation._solver.contacts
    rebuild = contacts.rebuild

    def timed_rebuild() -> None:
        start = perf_counter()
        rebuild()
        times.append(perf_counter() - start)

    contacts.rebuild = timed_rebuild  # type: ignore[method-assign]
    return times


class Sweeps:
    """The contact iteration alone: `max_iterations` sweeps over the arrays of a simulation's last step.

    Attributes
    ----------
    pairs, pair_dv, walls, velocity : ndarray
        The arrays themselves, in sweeping order: records `Pair` and `Wall` of sweep.c, corrections of the
        pairs and velocities of the grains [m/s].
    """

    def __init__(self, simulation: Simulation):
        self._solver = simulation._solver
        contacts = self._solver.contacts
        pairs, _, walls = contacts.counts
        self.pairs = _records(contacts.device.pairs, PAIR)[:pairs]
        self.pair_dv = contacts.device.pair_dv.numpy()[:pairs]
        self.walls = _records(contacts.device.walls, WALL)[:walls]
        self.velocity = self._solver.grains.next_velocity.numpy()
        self._start = self.contents()

    def contents(self) -> tuple[np.ndarray, ...]:
        """Return a copy of all that a sweep changes."""
        return self.pair_dv.copy(), self.walls["dv"].copy(), self.velocity.copy()

    def reset(self) -> None:
        """Put everything back to where the sweeps start, all calm, so that nothing is watched."""
        self.pair_dv[:], self.walls["dv"], self.velocity[:] = self._start
        progress, watch = self._solver._progress, self._solver._watch
        progress.iterating.numpy()[0] = 1
        progress.report.numpy()[ITERATIONS] = 0.0
        watch.flag.numpy()[[WATCHING, MISSED]] = 0
        watch.scalar.numpy()[DRIFT] = 0.0

    def run(self) -> None:
        """Sweep, as the step does."""
        self._solver._replay(self._solver._iterate)

    def done(self) -> tuple[int, float]:
        """Return how many sweeps were done, and the last zeta [m/s]."""
        report = self._solver._progress.report.numpy()
        return int(report[ITERATIONS]), report[ZETA].item()


def _records(array: wp.array, expected: np.dtype) -> np.ndarray:
    """View an array of records, if they are those that sweep.c knows."""
    view = array.numpy()
    if view.dtype != expected:
        raise RuntimeError(f"sweep.c knows records {expected}, and the solver has {view.dtype}")
    return view
