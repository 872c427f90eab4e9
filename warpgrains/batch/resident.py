"""The scenes of a batch in memory, and the states of those that are not.

Scenes are divided into sets that fit in memory together. One set at a time is resident; the other scenes are
kept as states.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import warp as wp

from warpgrains.arrays import FloatArray
from warpgrains.errors import SimulationError
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import State, first_state
from warpgrains.simulation.until import CountedRun
from warpgrains.solver.advance import OnProgress, advance
from warpgrains.solver.buffers import bytes_needed
from warpgrains.solver.engine import Engine
from warpgrains.solver.final_states import FinalStates
from warpgrains.solver.loaded_scene import LoadedScene
from warpgrains.solver.loading import load_state
from warpgrains.solver.memory import free_memory, require_memory
from warpgrains.solver.sizes import Counts, Sizes, kind_of
from warpgrains.solver.statistics import RunStatistics, StepReport
from warpgrains.solver.tuning import paying_threads

SHARE = 0.5  # largest fraction of the free memory for a resident set


class StepsDone(NamedTuple):
    """Statistics of the last steps of a scene, its last report, and the reason of an early stop, if any."""

    statistics: RunStatistics
    report: StepReport | None
    error: SimulationError | None


class SetSteps(NamedTuple):
    """The last steps of the scenes of a set. Later steps do not change the record."""

    numbers: Collection[int]
    """Numbers of the scenes in the batch."""
    errors: dict[int, SimulationError]
    """Reasons why scenes stopped early."""
    stepped: list[int]
    """Scenes that took at least one step."""
    done: Callable[[int], StepsDone]
    """Function that returns what a scene did."""
    ended: Callable[[], Iterator[tuple[list[int], FinalStates]]]
    """Function that yields numbers and final states of the scenes that have done all steps, or whose runs
    have ended; those whose arrays have one shape together. It is valid until the next set, and not for a GPU,
    see `Engine.ends`."""


def team_size(scene: Scene, device: wp.Device, threads: int) -> int:
    """Return the number of threads that share a scene: all, or 1 if it is small or on a GPU."""
    return 1 if device.is_cuda or paying_threads(scene) == 1 else threads


class ResidentSets:
    """The scenes of a batch, divided into sets of which one at a time, `present`, is in memory.

    Scenes of one kind share an engine. Raises OutOfMemoryError where one scene alone does not fit in memory.
    """

    def __init__(self, scenes: Sequence[Scene], device: wp.Device, threads: int):
        self._scenes, self._device, self._threads = scenes, device, threads
        self._teams = [team_size(scene, device, threads) for scene in scenes]
        self._sets = self._divide()
        self._states: list[State | None] = [None] * len(scenes)
        self._resident: int | None = None
        self._engines: list[tuple[Engine, list[int]]] = []
        self._place: dict[int, tuple[int, int]] = {}
        self.present: dict[int, LoadedScene] = {}
        self._is_canceled = False

    def _divide(self) -> list[list[int]]:
        """Group small scenes while they fit in memory; a scene that several threads share is a set alone."""
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
        sizes = np.zeros(len(self._scenes), np.int64)
        kinds = [(kind_of(scene), team) for scene, team in zip(self._scenes, self._teams, strict=True)]
        for kind in set(kinds):
            members = [k for k, other in enumerate(kinds) if other == kind]
            first = Sizes.first([self._scenes[k] for k in members], kind[1], self._device)
            sizes[members] = bytes_needed(first)
        return sizes

    def state(self, k: int) -> State:
        """Return the exact state of scene k, in memory or not."""
        if k in self.present:
            return self.present[k].state()
        return deepcopy(self._states[k]) or first_state(self._scenes[k])

    def vectors(self, name: str) -> FloatArray:
        """Return "position" or "velocity" of all scenes, of n grains each, shape (scenes, n, 2)."""
        found = np.empty((len(self._scenes), self._scenes[0].n, 2))
        for k in set(range(len(found))) - self.present.keys():
            found[k] = getattr(self.state(k), name)
        for engine, numbers in self._engines:
            found[numbers] = engine.records.stacked(f"grains.{name}", np.arange(len(numbers)))
        return found

    def restore(self, k: int, state: State) -> None:
        """Continue scene k from a state, in memory or not."""
        if k in self.present:
            engine, index = self._place[k]
            load_state(self._engines[engine][0].records, index, state)
        else:
            self._states[k] = deepcopy(state)

    def advance(
        self,
        steps: Sequence[int],
        on_progress: OnProgress | None = None,
        runs: Sequence[CountedRun] | None = None,
        gravity: FloatArray | None = None,
    ) -> Iterator[SetSteps]:
        """Advance each scene by its number of steps, or to its run's end; yield set by set what was done.

        Runs count the steps, if they are given. Without them, what was done is read from the device when it
        is asked for: that of thousands of scenes takes as long as their steps. Gravity [m/s2], shape (scenes,
        2), replaces that of the scenes.
        """
        for _ in self.in_memory():
            for engine, numbers in self._engines:
                engine.set_gravity(None if gravity is None else gravity[numbers])
            yield self._launch(steps, on_progress) if runs is None else self._count(steps, on_progress, runs)

    def in_memory(self) -> Iterator[None]:
        """Load set after set into memory, the present one first, until `cancel`; yield after each.

        The caller keeps none of `present`, which would keep its whole set. If a set does not fit, all states
        are kept.
        """
        self._is_canceled = False
        for number in sorted(range(len(self._sets)), key=lambda number: number != self._resident):
            if self._is_canceled:
                return
            self.make_resident(number)
            yield

    def _count(
        self, steps: Sequence[int], on_progress: OnProgress | None, runs: Sequence[CountedRun]
    ) -> SetSteps:
        counted = {k: StepsDone(runs[k].statistics, None, None) for k in self.present}
        left = {k: steps[k] for k in self.present if steps[k] > 0}
        while left and not self._is_canceled:
            due = [0] * len(steps)
            for k, most in left.items():
                due[k] = min(most, runs[k].steps_to_test)
            last = self._launch(due, on_progress)
            for k in tuple(left):
                done, report = last.done(k), counted[k].report
                runs[k].count(done.statistics, self.present[k])
                counted[k] = StepsDone(runs[k].statistics, done.report or report, done.error)
                left[k] -= done.statistics.steps
                if runs[k].has_ended or done.statistics.steps < due[k] or left[k] == 0:
                    del left[k]
        counted = {k: done._replace(statistics=replace(done.statistics)) for k, done in counted.items()}
        errors = {k: done.error for k, done in counted.items() if done.error is not None}
        stepped = [k for k, done in counted.items() if done.report is not None]
        return SetSteps(counted, errors, stepped, counted.__getitem__, partial(self._ended, runs))

    def _launch(self, steps: Sequence[int], on_progress: OnProgress | None) -> SetSteps:
        for engine, numbers in self._engines:
            engine.submit([steps[k] for k in numbers])
        advance([engine for engine, _ in self._engines], self._threads, on_progress)
        launched = [(engine.last_steps.copy(), numbers) for engine, numbers in self._engines]
        place = self._place

        def done(k: int) -> StepsDone:
            engine, index = place[k]
            last, _ = launched[engine]
            statistics, error = last.statistics(index), last.errors.get(index)
            return StepsDone(statistics, last.report(index) if statistics.steps else None, error)

        errors = {numbers[k]: error for last, numbers in launched for k, error in last.errors.items()}
        taken = [(last.sums["steps"].tolist(), numbers) for last, numbers in launched]
        stepped = [k for steps, numbers in taken for k, step in zip(numbers, steps, strict=True) if step]
        return SetSteps(place, errors, stepped, done, partial(self._ended, None))

    def cancel(self) -> None:
        """Stop after the steps under way."""
        self._is_canceled = True
        for engine, _ in self._engines:
            engine.cancel(abandon=False)

    def make_resident(self, number: int = 0) -> None:
        """Load a set into memory, replacing the present one."""
        if number == self._resident:
            return
        for k in self.present:
            self._states[k] = self.state(k)
        self._resident, self._engines, self._place, self.present = None, [], {}, {}
        members, kinds = self._sets[number], {kind_of(self._scenes[k]) for k in self._sets[number]}
        by_kind = [[k for k in members if kind_of(self._scenes[k]) == kind] for kind in sorted(kinds)]
        team, engines = self._teams[members[0]], []
        place = {k: (e, index) for e, numbers in enumerate(by_kind) for index, k in enumerate(numbers)}
        for numbers in by_kind:
            engine = Engine([self._scenes[k] for k in numbers], self._device, team)
            for index, k in enumerate(numbers):
                load_state(engine.records, index, self._states[k] or first_state(self._scenes[k]))
            engines.append((engine, numbers))
        self._resident, self._engines, self._place = number, engines, place
        self.present = {k: engines[e][0].scenes[i] for k, (e, i) in place.items()}
        self._states = [None if k in place else state for k, state in enumerate(self._states)]

    def _ended(self, runs: Sequence[CountedRun] | None) -> Iterator[tuple[list[int], FinalStates]]:
        """Yield what `SetSteps.ended` does; `runs` are those of all scenes, if they count the steps."""
        for engine, numbers in self._engines:
            groups: dict[tuple[int, int, bool], list[int]] = {}
            for index, k in enumerate(numbers):
                if engine.left[index] == 0 if runs is None else runs[k].has_ended:
                    scene = self._scenes[k]
                    shape = scene.n, len(scene.walls), scene.bodies.two_circles
                    groups.setdefault(shape, []).append(index)
            for group in groups.values():
                statistics = None if runs is None else [runs[numbers[index]].statistics for index in group]
                yield [numbers[index] for index in group], engine.ends(np.array(group), statistics)
