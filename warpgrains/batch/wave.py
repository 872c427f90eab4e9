"""Scenes of a batch that are in memory at the same time: many small ones, or a large one alone."""

from collections import defaultdict
from collections.abc import Callable, Mapping
from functools import partial
from time import perf_counter
from typing import Protocol

from warpgrains.batch.pool import ScenePool
from warpgrains.errors import SimulationError
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import State
from warpgrains.simulation.simulation import Simulation
from warpgrains.solver.grains import variant_of
from warpgrains.solver.statistics import RunStatistics, StepReport
from warpgrains.solver.threads import side_by_side

Advanced = Callable[[int], object]
"""Told now and then how many steps more have been done."""


class Wave(Protocol):
    """Scenes in memory, called by their numbers in the batch."""

    def load(self, k: int, state: State) -> None:
        """Continue scene k from a state."""

    def state(self, k: int) -> State:
        """Return the exact state of scene k."""

    def work(self, steps: Mapping[int, int], advanced: Advanced) -> None:
        """Do so many steps of each scene; one that fails stops, and the others go on."""

    def tally(self, k: int) -> RunStatistics:
        """Return what scene k has done of the last work."""

    def report(self, k: int) -> StepReport:
        """Return what the last step of scene k did."""

    def error(self, k: int) -> str | None:
        """Return why scene k stopped before its work was done, if it did."""


class SmallScenes:
    """A wave of scenes that are shared out among threads, each advanced by one thread alone.

    Parameters
    ----------
    scenes : mapping of int to Scene
    threads : int
    """

    def __init__(self, scenes: Mapping[int, Scene], threads: int):
        kinds = defaultdict(list)
        for k, scene in scenes.items():
            kinds[variant_of(scene)].append(k)
        self._threads = threads
        self._pools: list[ScenePool] = []
        self._place: dict[int, tuple[ScenePool, int]] = {}
        for kind, numbers in kinds.items():
            pool = ScenePool([scenes[k] for k in numbers], kind)
            self._pools.append(pool)
            self._place |= {k: (pool, place) for place, k in enumerate(numbers)}

    def load(self, k: int, state: State) -> None:
        """Continue scene k from a state."""
        pool, place = self._place[k]
        pool.load(place, state)

    def state(self, k: int) -> State:
        """Return the exact state of scene k."""
        pool, place = self._place[k]
        return pool.state(place)

    def work(self, steps: Mapping[int, int], advanced: Advanced) -> None:
        """Do so many steps of each scene."""
        for k, (pool, place) in self._place.items():
            pool.ask(place, steps[k])
        try:
            self._work_off(advanced)
        finally:
            for pool in self._pools:
                pool.settle()

    def _work_off(self, advanced: Advanced) -> None:
        """Let threads advance scenes, and attend to those that wait, until none has steps left."""
        left = self._left()

        def glance() -> None:
            nonlocal left
            before, left = left, self._left()
            advanced(before - left)

        going_on = True
        while going_on:
            works = [[pool.launch() for pool in self._pools] for _ in range(self._threads)]
            side_by_side([partial(_do, each) for each in works], glance, self._halt)
            going_on = sum(pool.attend() for pool in self._pools) > 0

    def _left(self) -> int:
        return sum(int(pool.left.sum()) for pool in self._pools)

    def _halt(self) -> None:
        for pool in self._pools:
            pool.halt()

    def tally(self, k: int) -> RunStatistics:
        """Return what scene k has done of the last work."""
        pool, place = self._place[k]
        return pool.tally(place)

    def report(self, k: int) -> StepReport:
        """Return what the last step of scene k did."""
        pool, place = self._place[k]
        return pool.report(place)

    def error(self, k: int) -> str | None:
        """Return why scene k stopped before its work was done, if it did."""
        pool, place = self._place[k]
        return pool.error(place)


def _do(works: list[Callable[[], None]]) -> None:
    for work in works:
        work()


class LargeScene:
    """A wave of one scene, which threads share, or which is on a GPU.

    Parameters
    ----------
    scene : Scene
    device : str
    threads : int
    """

    def __init__(self, scene: Scene, device: str, threads: int):
        self._simulation = Simulation(scene, device, threads)
        self._tally = RunStatistics()
        self._error: str | None = None
        self._report: StepReport

    def load(self, k: int, state: State) -> None:
        """Continue from a state."""
        self._simulation.restore(state)

    def state(self, k: int) -> State:
        """Return the exact state."""
        return self._simulation.state()

    def work(self, steps: Mapping[int, int], advanced: Advanced) -> None:
        """Do so many steps."""
        (count,) = steps.values()
        start, self._tally, self._error = perf_counter(), RunStatistics(), None
        try:
            while self._tally.steps < count:
                self._report = self._simulation.step()
                self._tally.add(self._report)
                advanced(1)
        except SimulationError as error:
            self._error = str(error)
        self._tally.seconds = perf_counter() - start

    def tally(self, k: int) -> RunStatistics:
        """Return what was done of the last work."""
        return self._tally

    def report(self, k: int) -> StepReport:
        """Return what the last step did."""
        return self._report

    def error(self, k: int) -> str | None:
        """Return why the work was not done, if it was not."""
        return self._error
