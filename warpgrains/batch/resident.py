"""The scenes of a batch: which of them are in memory together, and where the others' states are."""

from collections.abc import Iterator, Sequence
from copy import deepcopy
from typing import NamedTuple

import numpy as np
import warp as wp

from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import State, first_state
from warpgrains.simulation.until import Criterion, steps_to_test
from warpgrains.solver.advance import OnProgress, advance
from warpgrains.solver.buffers import bytes_needed
from warpgrains.solver.engine import Engine
from warpgrains.solver.memory import free_memory, require_memory
from warpgrains.solver.service import exact_solver
from warpgrains.solver.sizes import Counts, Sizes
from warpgrains.solver.statistics import RunStatistics, StepReport
from warpgrains.solver.tuning import paying_threads

SHARE = 0.5  # of the free memory that a resident set may take


class Done(NamedTuple):
    """What became of scene k: what it has done, its last report, and why it stopped early, if it did."""

    k: int
    statistics: RunStatistics
    report: StepReport | None
    error: str | None


class ResidentScene:
    """A scene of a batch while it runs, as a test of its end is given it.

    Attributes
    ----------
    scene : Scene
    """

    def __init__(self, scene: Scene, engine: Engine, place: int):
        self.scene, self._engine, self._place = scene, engine, place

    @property
    def steps(self) -> int:
        """Time steps since the start."""
        return self._engine.steps(self._place)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.steps * self.scene.dt

    @property
    def position(self) -> FloatArray:
        """Centres of the grains [m], shape (n, 2); a copy."""
        return self._engine.grains(self._place, "position")

    @property
    def velocity(self) -> FloatArray:
        """Velocities of the grains [m/s], shape (n, 2); a copy."""
        return self._engine.grains(self._place, "velocity")

    def state(self) -> State:
        """Return the exact state."""
        return self._engine.state(self._place)


class ResidentSet:
    """Scenes in memory, by their numbers in the batch, each in the engine of its method.

    Of so many threads in all, those of a team share a scene.

    Attributes
    ----------
    place : dict of int to (Engine, int)
        Where each scene is.
    """

    def __init__(self, scenes: dict[int, Scene], device: wp.Device, threads: int, team: int):
        self._threads = threads
        self._engines: list[Engine] = []
        self._numbers: list[list[int]] = []
        self._is_halted = False
        self.place: dict[int, tuple[Engine, int]] = {}
        for method in sorted({scene.method for scene in scenes.values()}):
            numbers = [k for k, scene in scenes.items() if scene.method == method]
            engine = Engine([scenes[k] for k in numbers], device, team)
            engine.begin()
            self._engines.append(engine)
            self._numbers.append(numbers)
            self.place |= {k: (engine, place) for place, k in enumerate(numbers)}

    def load(self, k: int, state: State) -> None:
        """Continue scene k from a state."""
        engine, place = self.place[k]
        engine.load(place, state)

    def state(self, k: int) -> State:
        """Return the exact state of scene k."""
        engine, place = self.place[k]
        return engine.state(place)

    def work(self, steps: Sequence[int], on_progress: OnProgress) -> None:
        """Do so many steps of each scene."""
        for engine, numbers in zip(self._engines, self._numbers, strict=True):
            engine.submit([steps[k] for k in numbers])
        advance(self._engines, self._threads, on_progress)

    def work_until(
        self, criteria: Sequence[Criterion], steps: Sequence[int], on_progress: OnProgress
    ) -> dict[int, Done]:
        """Do so many steps of each scene, or fewer, to where its criterion is met; return what they did.

        A scene that is halted or fails stops between two steps.
        """
        done = {k: Done(k, RunStatistics(), None, None) for k in self.place}
        running = {k: ResidentScene(engine.scenes[at], engine, at) for k, (engine, at) in self.place.items()}
        going = [k for k in self.place if steps[k] > 0]
        self._is_halted = False
        while going and not self._is_halted:
            due = [0] * len(steps)
            for k in going:
                taken = done[k].statistics.steps
                due[k] = min(steps[k] - taken, steps_to_test(taken))
            self.work(due, on_progress)
            going = [k for k in going if self._goes_on(done, k, due[k], steps[k], running[k], criteria[k])]
        return done

    def _goes_on(
        self,
        done: dict[int, Done],
        k: int,
        due: int,
        steps: int,
        running: ResidentScene,
        criterion: Criterion,
    ) -> bool:
        """Count what scene k has just done; return whether it goes on."""
        statistics, last = done[k].statistics, self.done(k)
        statistics.add(last.statistics)
        done[k] = last._replace(statistics=statistics, report=last.report or done[k].report)
        whole = last.error is None and last.statistics.steps == due
        return whole and not criterion.is_met(running, statistics) and statistics.steps < steps

    def halt(self) -> None:
        """Let the steps under way be the last, those that take long given up."""
        self._is_halted = True
        for engine in self._engines:
            engine.halt()

    def alike(self) -> Iterator[tuple[Engine, IndexArray, IndexArray]]:
        """Yield the scenes of an engine that have as many grains: the engine, their numbers and places."""
        for engine, numbers in zip(self._engines, self._numbers, strict=True):
            n = np.array([scene.n for scene in engine.scenes])
            for count in np.unique(n):
                places = np.flatnonzero(n == count)
                yield engine, np.array(numbers)[places], places

    def done(self, k: int) -> Done:
        """Return what became of scene k."""
        engine, place = self.place[k]
        statistics = engine.statistics(place)
        return Done(k, statistics, engine.report(place) if statistics.steps else None, engine.error(place))


class ResidentSets:
    """Scenes of which as many are in memory as find room; SimulationError where one alone does not."""

    def __init__(self, scenes: Sequence[Scene], device: wp.Device, threads: int):
        for method in {scene.method for scene in scenes}:
            exact_solver(method)
        self._scenes, self._device, self._threads = scenes, device, threads
        self._teams = [self._team(scene) for scene in scenes]
        self._sets = self._divide()
        self._number = {k: number for number, members in enumerate(self._sets) for k in members}
        self._states: list[State | None] = [None] * len(scenes)
        self._resident: ResidentSet | None = None
        self._in_memory = -1

    def _team(self, scene: Scene) -> int:
        """Return how many threads share a scene: one where it is small, and all where it is large."""
        return 1 if self._device.is_cuda or paying_threads(scene) == 1 else self._threads

    def _divide(self) -> list[list[int]]:
        """Put small scenes together as long as there is memory; large ones come alone."""
        sizes = self._bytes()
        largest = int(sizes.argmax())
        require_memory(sizes[largest].item(), self._scenes[largest].n, self._device)
        small = [k for k, team in enumerate(self._teams) if team == 1]
        room, used = SHARE * free_memory(self._device), 0.0
        sets: list[list[int]] = []
        for k in small:
            if not sets or used + sizes[k] > room:
                sets.append([])
                used = 0.0
            sets[-1].append(k)
            used += sizes[k]
        return sets + [[k] for k, team in enumerate(self._teams) if team > 1]

    def _bytes(self) -> Counts:
        """Return what each scene takes in memory [bytes]."""
        sizes = np.zeros(len(self._scenes), np.int64)
        kinds = [(scene.method, team) for scene, team in zip(self._scenes, self._teams, strict=True)]
        for kind in set(kinds):
            members = [k for k, other in enumerate(kinds) if other == kind]
            sizes[members] = bytes_needed(
                Sizes.first([self._scenes[k] for k in members], kind[1], self._device)
            )
        return sizes

    def state(self, k: int) -> State:
        """Return the exact state of scene k."""
        if self._resident is not None and self._number[k] == self._in_memory:
            return self._resident.state(k)
        return deepcopy(self._states[k]) or first_state(self._scenes[k])

    def restore(self, k: int, state: State) -> None:
        """Continue scene k from a state."""
        if self._resident is not None and self._number[k] == self._in_memory:
            self._resident.load(k, state)
        else:
            self._states[k] = deepcopy(state)

    def work(
        self, steps: Sequence[int], on_progress: OnProgress, criteria: Sequence[Criterion] | None = None
    ) -> Iterator[Done]:
        """Do so many steps of each scene, set after set; yield what became of every scene, in any order.

        Where there are criteria, a scene stops earlier, where its own is met.
        """
        for number in sorted(range(len(self._sets)), key=lambda number: number != self._in_memory):
            resident = self._enter(number)
            if criteria is None:
                resident.work(steps, on_progress)
                yield from map(resident.done, self._sets[number])
            else:
                yield from resident.work_until(criteria, steps, on_progress).values()

    def _enter(self, number: int) -> ResidentSet:
        """Have a set in memory instead of the one that is."""
        if self._resident is not None and number == self._in_memory:
            return self._resident
        if self._resident is not None:
            for k in self._sets[self._in_memory]:
                self._states[k] = self._resident.state(k)
            self._resident = None
        members = self._sets[number]
        scenes = {k: self._scenes[k] for k in members}
        resident = ResidentSet(scenes, self._device, self._threads, self._teams[members[0]])
        for k in members:
            if (state := self._states[k]) is not None:
                resident.load(k, state)
            self._states[k] = None
        self._resident, self._in_memory = resident, number
        return resident
