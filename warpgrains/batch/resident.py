"""The scenes of a batch: which of them are in memory together, and where the others' states are."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import warp as wp

from warpgrains.batch.wave import Advanced, LargeScene, SmallScenes, Wave
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import State, first_state
from warpgrains.solver.grains import variant_of
from warpgrains.solver.launch import CAPTURING
from warpgrains.solver.memory import free_memory, require_memory
from warpgrains.solver.record_layout import Counts, first_room, record_bytes
from warpgrains.solver.statistics import RunStatistics, StepReport
from warpgrains.solver.step import PAIRS_PER_GRAIN, paying_threads

SHARE = 0.5  # of the free memory that a wave may take


class Done(NamedTuple):
    """What became of scene k: what it has done, its last report, and why it stopped early, if it did."""

    k: int
    tally: RunStatistics
    report: StepReport | None
    error: str | None


class Waves:
    """Scenes of which as many are in memory as find room there.

    Parameters
    ----------
    scenes : sequence of Scene
    device : wp.Device
    threads : int

    Raises
    ------
    SimulationError
        A scene does not fit in memory.
    """

    def __init__(self, scenes: Sequence[Scene], device: wp.Device, threads: int):
        self._scenes, self._device, self._threads = scenes, device, threads
        for scene in scenes:
            if not self._is_small(scene):
                require_memory(scene.n, PAIRS_PER_GRAIN * scene.n, device)
        small = [k for k, scene in enumerate(scenes) if self._is_small(scene)]
        large = [[k] for k, scene in enumerate(scenes) if not self._is_small(scene)]
        self._waves = self._divide(small) + large
        self._number = {k: number for number, wave in enumerate(self._waves) for k in wave}
        self._states: list[State | None] = [None] * len(scenes)
        self._wave: Wave | None = None
        self._in_memory = -1

    def _is_small(self, scene: Scene) -> bool:
        """Whether a scene is best left to one thread."""
        return self._device.is_cpu and (self._threads == 1 or paying_threads(scene) == 1)

    def _divide(self, small: list[int]) -> list[list[int]]:
        """Put small scenes together as long as there is memory."""
        if not small:
            return []
        sizes = _sizes([self._scenes[k] for k in small])
        largest = self._scenes[small[int(np.argmax(sizes))]]
        require_memory(largest.n, int(first_room(np.array(largest.n))), self._device)
        room, used = SHARE * free_memory(self._device), 0.0
        waves: list[list[int]] = [[]]
        for k, size in zip(small, sizes.tolist(), strict=True):
            if waves[-1] and used + size > room:
                waves.append([])
                used = 0.0
            waves[-1].append(k)
            used += size
        return waves

    def state(self, k: int) -> State:
        """Return the exact state of scene k."""
        if self._wave is not None and self._number[k] == self._in_memory:
            return self._wave.state(k)
        return self._states[k] or first_state(self._scenes[k])

    def restore(self, k: int, state: State) -> None:
        """Continue scene k from a state."""
        if self._wave is not None and self._number[k] == self._in_memory:
            with CAPTURING:
                self._wave.load(k, state)
        else:
            self._states[k] = state

    def work(self, steps: Sequence[int], advanced: Advanced) -> Iterator[Done]:
        """Do so many steps of each scene, wave after wave; yield what became of every scene, in any order."""
        for number in sorted(range(len(self._waves)), key=lambda number: number != self._in_memory):
            wave = self._enter(number)
            wave.work({k: steps[k] for k in self._waves[number]}, advanced)
            for k in self._waves[number]:
                tally = wave.tally(k)
                yield Done(k, tally, wave.report(k) if tally.steps else None, wave.error(k))

    def _enter(self, number: int) -> Wave:
        """Have a wave in memory instead of the one that is."""
        if self._wave is not None and number == self._in_memory:
            return self._wave
        if self._wave is not None:
            for k in self._waves[self._in_memory]:
                self._states[k] = self._wave.state(k)
            self._wave = None
        with CAPTURING:
            wave = self._load(self._waves[number])
        self._wave, self._in_memory = wave, number
        return wave

    def _load(self, members: list[int]) -> Wave:
        """Put scenes into memory, in the states that they have come to."""
        wave: Wave
        if self._is_small(self._scenes[members[0]]):
            wave = SmallScenes({k: self._scenes[k] for k in members}, self._threads)
        else:
            wave = LargeScene(self._scenes[members[0]], self._device.alias, self._threads)
        for k in members:
            wave.load(k, self.state(k))
            self._states[k] = None
        return wave


def _sizes(scenes: Sequence[Scene]) -> Counts:
    """Return what each scene takes in memory [bytes]."""
    sizes = np.zeros(len(scenes), np.int64)
    kinds = [variant_of(scene) for scene in scenes]
    for kind in set(kinds):
        members = np.array([k for k, other in enumerate(kinds) if other == kind])
        sizes[members] = record_bytes(np.array([scenes[k].n for k in members]), kind)
    return sizes
