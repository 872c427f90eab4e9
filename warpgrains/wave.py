"""Scenes of a batch that are in memory at the same time: many small ones, or a large one alone."""

from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Callable, Mapping
from functools import partial
from time import perf_counter

import warp as wp

from warpgrains.errors import SimulationError
from warpgrains.grains import variant_of
from warpgrains.reports import State, StepReport, Tally
from warpgrains.scene import Scene
from warpgrains.scene_pool import ScenePool
from warpgrains.simulation import Simulation
from warpgrains.threads import side_by_side

Advanced = Callable[[int], object]
"""Told now and then how many steps more have been done."""


class Wave(ABC):
    """Scenes in memory, called by their numbers in the batch."""

    @abstractmethod
    def load(self, k: int, state: State) -> None:
        """Continue scene k from a state."""

    @abstractmethod
    def state(self, k: int) -> State:
        """Return the exact state of scene k."""

    @abstractmethod
    def work(self, steps: Mapping[int, int], advanced: Advanced) -> None:
        """Do so many steps of each scene; one that fails stops, and the others go on."""

    @abstractmethod
    def tally(self, k: int) -> Tally:
        """Return what scene k has done of the last work."""

    @abstractmethod
    def report(self, k: int) -> StepReport:
        """Return what the last step of scene k did."""

    @abstractmethod
    def error(self, k: int) -> str | None:
        """Return why scene k stopped before its work was done, if it did."""


class SmallScenes(Wave):
    """Scenes that one thread advances whole, each with all that its kind has of kernels.

    Parameters
    ----------
    scenes : mapping of int to Scene
    threads : int
        That share them out.
    """

    def __init__(self, scenes: Mapping[int, Scene], threads: int):
        kinds = defaultdict(list)
        for k, scene in scenes.items():
            kinds[variant_of(scene)].append(k)
        self._threads = threads
        self._pools = [ScenePool([scenes[k] for k in members], kind) for kind, members in kinds.items()]
        self._members = list(kinds.values())
        self._place = {
            k: (pool, place)
            for pool, members in zip(self._pools, self._members, strict=True)
            for place, k in enumerate(members)
        }

    def load(self, k: int, state: State) -> None:
        pool, place = self._place[k]
        pool.load(place, state)

    def state(self, k: int) -> State:
        pool, place = self._place[k]
        return pool.state(place)

    def work(self, steps: Mapping[int, int], advanced: Advanced) -> None:
        for pool, members in zip(self._pools, self._members, strict=True):
            pool.ask([steps[k] for k in members])
        left = sum(steps.values())

        def glance() -> None:
            nonlocal left
            left, before = sum(int(pool.left.sum()) for pool in self._pools), left
            advanced(before - left)

        try:
            while True:
                launches = [[pool.launch() for pool in self._pools] for _ in range(self._threads)]
                side_by_side([partial(_launch, each) for each in launches], glance, self._halt)
                if not any([pool.grow() for pool in self._pools]):
                    break
        finally:
            for pool in self._pools:
                pool.settle()

    def _halt(self) -> None:
        for pool in self._pools:
            pool.halt()

    def tally(self, k: int) -> Tally:
        pool, place = self._place[k]
        return pool.tally(place)

    def report(self, k: int) -> StepReport:
        pool, place = self._place[k]
        return pool.report(place)

    def error(self, k: int) -> str | None:
        pool, place = self._place[k]
        return pool.error(place)


def _launch(launches: list[wp.Launch]) -> None:
    for launch in launches:
        launch.launch()


class LargeScene(Wave):
    """A scene that threads share, or that is on a GPU.

    Parameters
    ----------
    scene : Scene
    device : str
    threads : int
    """

    def __init__(self, scene: Scene, device: str, threads: int):
        self._simulation = Simulation(scene, device, threads)
        self._tally, self._error = Tally(), None
        self._report: StepReport | None = None

    def load(self, k: int, state: State) -> None:
        self._simulation.restore(state)

    def state(self, k: int) -> State:
        return self._simulation.state()

    def work(self, steps: Mapping[int, int], advanced: Advanced) -> None:
        (count,) = steps.values()
        start, self._tally, self._error = perf_counter(), Tally(), None
        try:
            while self._tally.steps < count:
                self._report = self._simulation.step()
                self._tally.add(self._report)
                advanced(1)
        except SimulationError as error:
            self._error = str(error)
        self._tally.seconds = perf_counter() - start

    def tally(self, k: int) -> Tally:
        return self._tally

    def report(self, k: int) -> StepReport:
        return self._report

    def error(self, k: int) -> str | None:
        return self._error
