"""The scenes of a batch in memory, and the states of those that are not.

Scenes are divided into sets that fit in memory together. One set at a time is resident; the other scenes are
kept as states.
"""

from collections.abc import Iterable, Iterator, Sequence
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
from warpgrains.solver.outcomes import Outcomes
from warpgrains.solver.service import exact_solver
from warpgrains.solver.sizes import Counts, Sizes
from warpgrains.solver.statistics import RunStatistics, StepReport
from warpgrains.solver.tuning import paying_threads

SHARE = 0.5  # largest fraction of the free memory for a resident set

Ending = tuple[Criterion, RunStatistics]
"""Stopping criterion of a scene, and the statistics of its run, which are updated."""


class StepsDone(NamedTuple):
    """Statistics of the last steps of scene k, its last report, and the reason of an early stop, if any."""

    k: int
    statistics: RunStatistics
    report: StepReport | None
    error: str | None


class ResidentScene:
    """A scene in memory. Callables that test for the end of its run receive it.

    Attributes
    ----------
    scene : Scene
    """

    def __init__(self, scene: Scene, engine: Engine, index: int):
        self.scene, self._engine, self._index = scene, engine, index

    @property
    def steps(self) -> int:
        """Time steps since the start."""
        return self._engine.steps(self._index)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.steps * self.scene.dt

    @property
    def position(self) -> FloatArray:
        """Centers of the grains [m], shape (n, 2); a copy."""
        return self._engine.grains(self._index, "position")

    @property
    def velocity(self) -> FloatArray:
        """Velocities of the grains [m/s], shape (n, 2); a copy."""
        return self._engine.grains(self._index, "velocity")

    def state(self) -> State:
        """Return the exact state, see `Batch.state`."""
        return self._engine.state(self._index)

    def load(self, state: State) -> None:
        """Load a state, from which the scene continues."""
        self._engine.load(self._index, state)


class SetOutcomes(NamedTuple):
    """Outcomes of the scenes of a set in the last `ResidentSet.advance`. Later steps do not change them."""

    engines: list[Outcomes]
    place: dict[int, tuple[int, int]]
    """Of every scene, by its number in the batch: its engine, and its index there."""
    ended: dict[int, StepsDone]
    """Of scenes with a criterion: what they did in the whole run."""

    @property
    def errors(self) -> dict[int, str]:
        """Reasons why scenes stopped early."""
        if not any(outcomes.errors for outcomes in self.engines):
            return {}
        errors = {k: self.engines[engine].errors.get(index) for k, (engine, index) in self.place.items()}
        return {k: error for k, error in errors.items() if error is not None}

    @property
    def stepped(self) -> Iterable[int]:
        """Scenes that took at least one step."""
        if self.ended:
            return [k for k, done in self.ended.items() if done.report is not None]
        if all(outcomes.sums["steps"].all() for outcomes in self.engines):
            return self.place
        return [k for k, (engine, index) in self.place.items() if self.engines[engine].sums["steps"][index]]

    def done(self, k: int) -> StepsDone:
        """Return what scene k did."""
        if k in self.ended:
            return self.ended[k]
        engine, index = self.place[k]
        outcomes = self.engines[engine]
        statistics = outcomes.statistics(index)
        report = outcomes.report(index) if statistics.steps else None
        return StepsDone(k, statistics, report, outcomes.errors.get(index))


class ResidentSet:
    """Scenes in memory, by their numbers in the batch. Scenes of one kind share an engine.

    Of the `threads`, groups of `team` threads share a scene.

    Attributes
    ----------
    scenes : dict of int to ResidentScene
    outcomes : SetOutcomes
    """

    def __init__(self, scenes: dict[int, Scene], device: wp.Device, threads: int, team: int):
        self._threads = threads
        self._engines: list[tuple[Engine, list[int]]] = []
        self._is_canceled = False
        self.scenes: dict[int, ResidentScene] = {}
        self.outcomes = SetOutcomes([], {}, {})
        for kind in sorted({scene.kernel_kind for scene in scenes.values()}):
            numbers = [k for k, scene in scenes.items() if scene.kernel_kind == kind]
            engine = Engine([scenes[k] for k in numbers], device, team)
            engine.begin()
            self.outcomes.place.update({k: (len(self._engines), index) for index, k in enumerate(numbers)})
            self._engines.append((engine, numbers))
            self.scenes |= {k: ResidentScene(scenes[k], engine, index) for index, k in enumerate(numbers)}

    def advance(
        self, steps: Sequence[int], on_progress: OnProgress, endings: Sequence[Ending] | None = None
    ) -> None:
        """Advance each scene by its number of steps, or until its criterion is met.

        A scene that fails or is interrupted stops between two steps.
        """
        self._is_canceled = False
        if endings is None:
            self._launch(steps, on_progress)
            return
        going = {k: endings[k][1].steps + steps[k] for k in self.scenes if steps[k] > 0}
        ended = {k: StepsDone(k, endings[k][1], None, None) for k in self.scenes}
        while going and not self._is_canceled:
            due = [0] * len(steps)
            for k, end in going.items():
                taken = endings[k][1].steps
                due[k] = min(end - taken, steps_to_test(taken))
            self._launch(due, on_progress)
            for k, end in tuple(going.items()):
                last, (criterion, statistics) = self.outcomes.done(k), endings[k]
                statistics.add(last.statistics)
                ended[k] = StepsDone(k, statistics, last.report or ended[k].report, last.error)
                is_whole = last.error is None and last.statistics.steps == due[k]
                if not is_whole or criterion.is_met(self.scenes[k], statistics) or statistics.steps >= end:
                    del going[k]
        self.outcomes = self.outcomes._replace(ended=ended)

    def _launch(self, steps: Sequence[int], on_progress: OnProgress) -> None:
        for engine, numbers in self._engines:
            engine.submit([steps[k] for k in numbers])
        advance([engine for engine, _ in self._engines], self._threads, on_progress)
        outcomes = [engine.outcomes.copy() for engine, _ in self._engines]
        self.outcomes = SetOutcomes(outcomes, self.outcomes.place, {})

    def write_vectors(self, name: str, found: FloatArray) -> None:
        """Write "position" or "velocity" of the scenes to an array of all scenes, shape (scenes, n, 2)."""
        for engine, numbers in self._engines:
            found[numbers] = engine.vectors(name)

    def cancel(self) -> None:
        """Stop after the steps under way; slow steps are abandoned."""
        self._is_canceled = True
        for engine, _ in self._engines:
            engine.cancel()

    def by_shape(self) -> Iterator[tuple[Engine, IndexArray, IndexArray]]:
        """Group scenes whose arrays have one shape; yield engine, numbers, and indices in the engine."""
        for engine, numbers in self._engines:
            groups: dict[tuple[int, int, bool], list[int]] = {}
            for index, scene in enumerate(engine.scenes):
                shape = scene.n, len(scene.walls), scene.has_two_circles
                groups.setdefault(shape, []).append(index)
            for group in groups.values():
                indices = np.array(group)
                yield engine, np.array(numbers)[indices], indices


class ResidentSets:
    """The scenes of a batch, divided into sets of which one at a time is in memory.

    Raises SimulationError if one scene alone does not fit.
    """

    def __init__(self, scenes: Sequence[Scene], device: wp.Device, threads: int):
        for method in {scene.method for scene in scenes}:
            exact_solver(method)
        self._scenes, self._device, self._threads = scenes, device, threads
        alone = device.is_cuda  # a GPU has no threads that share a scene
        self._teams = [1 if alone or paying_threads(scene) == 1 else threads for scene in scenes]
        self._sets = self._divide()
        self._states: list[State | None] = [None] * len(scenes)
        self._resident: ResidentSet | None = None
        self._in_memory = -1
        self._is_canceled = False

    def _divide(self) -> list[list[int]]:
        """Group small scenes while they fit in memory.

        A scene that several threads share forms a set alone.
        """
        sizes = self._bytes()
        largest = int(sizes.argmax())
        require_memory(sizes[largest].item(), self._scenes[largest].n, self._device)
        capacity, used = SHARE * free_memory(self._device), 0.0
        sets: list[list[int]] = []
        for k, team in enumerate(self._teams):
            if team == 1:
                if not sets or used + sizes[k] > capacity:
                    sets.append([])
                    used = 0.0
                sets[-1].append(k)
                used += sizes[k]
        return sets + [[k] for k, team in enumerate(self._teams) if team > 1]

    def _bytes(self) -> Counts:
        """Return the memory of each scene [bytes]."""
        sizes = np.zeros(len(self._scenes), np.int64)
        kinds = [(scene.kernel_kind, team) for scene, team in zip(self._scenes, self._teams, strict=True)]
        for kind in set(kinds):
            members = [k for k, other in enumerate(kinds) if other == kind]
            sizes[members] = bytes_needed(
                Sizes.first([self._scenes[k] for k in members], kind[1], self._device)
            )
        return sizes

    def _resident_scene(self, k: int) -> ResidentScene | None:
        return None if self._resident is None else self._resident.scenes.get(k)

    def state(self, k: int) -> State:
        """Return the exact state of scene k, in memory or not."""
        if (resident := self._resident_scene(k)) is not None:
            return resident.state()
        return deepcopy(self._states[k]) or first_state(self._scenes[k])

    def vectors(self, name: str) -> FloatArray:
        """Return "position" or "velocity" of all scenes, of n grains each, shape (scenes, n, 2)."""
        found = np.empty((len(self._scenes), self._scenes[0].n, 2))
        for k in range(len(self._scenes)):
            if self._resident_scene(k) is None:
                found[k] = getattr(self.state(k), name)
        if self._resident is not None:
            self._resident.write_vectors(name, found)
        return found

    def restore(self, k: int, state: State) -> None:
        """Continue scene k from a state, in memory or not."""
        if (resident := self._resident_scene(k)) is not None:
            resident.load(state)
        else:
            self._states[k] = deepcopy(state)

    def advance(
        self, steps: Sequence[int], on_progress: OnProgress, endings: Sequence[Ending] | None = None
    ) -> Iterator[ResidentSet]:
        """Advance the scenes set after set, see `ResidentSet.advance`. Yields each set after its steps.

        After `cancel` the remaining sets are not advanced.
        """
        self._is_canceled = False
        for number in sorted(range(len(self._sets)), key=lambda number: number != self._in_memory):
            if self._is_canceled:
                return
            resident = self.make_resident(number)
            resident.advance(steps, on_progress, endings)
            yield resident

    def cancel(self) -> None:
        """Stop after the steps under way, see `ResidentSet.cancel`."""
        self._is_canceled = True
        if self._resident is not None:
            self._resident.cancel()

    def make_resident(self, number: int = 0) -> ResidentSet:
        """Load a set into memory, replacing the present one, and return it."""
        if self._resident is not None and number == self._in_memory:
            return self._resident
        if self._resident is not None:
            for k, scene in self._resident.scenes.items():
                self._states[k] = scene.state()
            self._resident = None
        members = self._sets[number]
        scenes = {k: self._scenes[k] for k in members}
        resident = ResidentSet(scenes, self._device, self._threads, self._teams[members[0]])
        for k in members:
            if (state := self._states[k]) is not None:
                resident.scenes[k].load(state)
            self._states[k] = None
        self._resident, self._in_memory = resident, number
        return resident
