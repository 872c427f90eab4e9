"""Scenes in memory that are advanced together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import warp as wp

from warpgrains.base.arrays import FloatArray
from warpgrains.scene.scene import Scene
from warpgrains.scene.snapshot import Snapshots
from warpgrains.scene.sources import require_closed
from warpgrains.scene.state import State
from warpgrains.solver.advance import OnProgress, advance
from warpgrains.solver.buffers import bytes_needed
from warpgrains.solver.engine import Engine
from warpgrains.solver.last_steps import LastSteps
from warpgrains.solver.loading import load_state
from warpgrains.solver.memory import require_memory
from warpgrains.solver.sizes import Sizes, kind_of
from warpgrains.solver.tuning import paying_threads


def team_size(scene: Scene, device: wp.Device, threads: int) -> int:
    """Return the number of threads that share a scene: `threads`, or 1 if the scene is small or on a GPU."""
    return 1 if device.is_cuda or paying_threads(scene) == 1 else threads


class LoadedScenes:
    """Scenes in device memory that are advanced together.

    Scenes that need the same kernels (`kind_of`) and number of threads (`team_size`) are in one `Engine`.
    OutOfMemoryError if the scenes do not fit.

    Attributes
    ----------
    scenes : list of LoadedScene
    """

    def __init__(self, scenes: Sequence[Scene], device: wp.Device, threads: int):
        for k, scene in enumerate(scenes):
            require_closed(scene, f"scenes[{k}]")
        kinds = [(team_size(scene, device, threads), *kind_of(scene)) for scene in scenes]
        alike = [np.array([k for k, own in enumerate(kinds) if own == kind]) for kind in sorted(set(kinds))]
        members = [[scenes[k] for k in numbers] for numbers in alike]
        sizes = [Sizes.first(own, kinds[k[0]][0], device) for own, k in zip(members, alike, strict=True)]
        needed = [bytes_needed(size) for size in sizes]
        order = np.concatenate(alike)
        require_memory(np.concatenate(needed)[np.argsort(order)], sum(scene.n for scene in scenes), device)
        self._threads = threads
        engines = (Engine(own, device, size) for own, size in zip(members, sizes, strict=True))
        self._engines = list(zip(engines, alike, strict=True))
        place = {k: (e, index) for e, numbers in enumerate(alike) for index, k in enumerate(numbers.tolist())}
        self._place = [place[k] for k in range(len(scenes))]
        self.scenes = [self._engines[e][0].scenes[index] for e, index in self._place]

    def load(self, k: int, state: State) -> None:
        """Set scene k to a state, from which it continues."""
        engine, index = self._place[k]
        load_state(self._engines[engine][0].records, index, state)

    def vectors(self, name: str) -> FloatArray:
        """Return "position" [m] or "velocity" [m/s] of scenes with n grains each, shape (scenes, n, 2)."""
        found = np.empty((len(self.scenes), self.scenes[0].scene.n, 2))
        for engine, numbers in self._engines:
            found[numbers] = engine.records.stacked(f"grains.{name}", np.arange(len(numbers)))
        return found

    def set_gravity(self, gravity: FloatArray) -> None:
        """Set the acceleration of gravity of every scene from now on [m/s2], shape (scenes, 2)."""
        for engine, numbers in self._engines:
            engine.records.set_gravity(gravity[numbers])

    def advance(self, steps: Sequence[int], on_progress: OnProgress | None = None) -> LastSteps:
        """Advance scene k by `steps[k]` steps, unless `cancel` is called; return the results of these steps.

        Small scenes, which one thread advances, are done first, then large scenes one after the other.
        """
        for engine, numbers in self._engines:
            engine.submit([steps[k] for k in numbers])
        engines = [engine for engine, _ in self._engines]
        small = [engine for engine in engines if engine.team == 1]
        for together in ([small] if small else []) + [[engine] for engine in engines if engine.team > 1]:
            advance(together, self._threads, on_progress)
        return LastSteps.joined([(engine.last_steps, numbers) for engine, numbers in self._engines])

    def cancel(self) -> None:
        """Stop `advance` after the steps that have begun."""
        for engine, _ in self._engines:
            engine.cancel(abandon=False)

    def snapshots(self, numbers: Iterable[int]) -> Iterator[tuple[list[int], Snapshots]]:
        """Yield the present states of the scenes with indices `numbers`, in groups of equal array shapes.

        Each group comes with the indices of its scenes. This works on a CPU only, see `Engine.snapshots`.
        """
        of_shape: dict[tuple[int, int], list[int]] = {}
        for k in numbers:
            of_shape.setdefault((self._place[k][0], self.scenes[k].scene.n), []).append(k)
        for (e, _), alike in sorted(of_shape.items()):
            yield alike, self._engines[e][0].snapshots(np.array([self._place[k][1] for k in alike]))
