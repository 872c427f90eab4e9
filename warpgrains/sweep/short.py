"""Short runs: executed in large groups, without a folder and a lock file for each run.

The results of a group are one shard. It is written before the next group is advanced, and so are checkpoints
of runs that take longer. So a killed process loses one group only.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import replace
from time import perf_counter
from typing import Any, NamedTuple, Self

from warpgrains.analysis.quantities import require_quantities
from warpgrains.analysis.snapshot import snapshot
from warpgrains.batch.loaded_scenes import LoadedScenes, team_size
from warpgrains.errors import InputError, SimulationError
from warpgrains.files import Row
from warpgrains.locks import RunLocks
from warpgrains.scene.reader import document_fields
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import State
from warpgrains.simulation.until import CountedRun, EndCriterion, criterion
from warpgrains.solver.memory import OutOfMemoryError
from warpgrains.solver.service import exact_solver
from warpgrains.solver.statistics import Summary
from warpgrains.solver.threads import cores
from warpgrains.sweep.execution import ExecutionOptions, OnFraction, write_all
from warpgrains.sweep.results import RunResult, results
from warpgrains.sweep.sweep import GRAINS, BaseScene, Run
from warpgrains.sweep.sweep_folder import SweepFolder
from warpgrains.warp_start import find_device

SHORT = 20.0  # s; longer runs continue with a folder and checkpoints
WIDTH = 4096  # runs in a group
CACHED_SCENES = 256  # cached scenes, from which scenes with the same grains are made


class ShortRun(NamedTuple):
    """A short run, which is simulated together with others in one batch."""

    run: Run
    labels: Row
    scene: Scene
    until: EndCriterion | None


class Interrupted(NamedTuple):
    """A run that has failed or takes longer than `SHORT`."""

    short: ShortRun
    state: State
    statistics: Summary
    error: SimulationError | None


class ShortGroup(NamedTuple):
    runs: list[ShortRun]
    loaded: LoadedScenes | None
    """None if the group is empty."""


class ShortRunner:
    """Runner for the short runs of a sweep.

    It leaves to `longer` a run that has a folder, takes longer than `SHORT`, fails, has a label of several
    lines, is invalid, lacks a quantity, an extra or memory, or is so large that several threads share it.
    `reasons` are those of runs that other processes have, by number.
    """

    def __init__(self, folder: SweepFolder, execution: ExecutionOptions, on_progress: OnFraction):
        self.reasons: dict[int, str] = {}
        self.longer: list[Run] = []
        self._folder, self._execution, self._on_progress = folder, execution, on_progress
        self._threads, self._device = execution.threads or cores(), find_device(execution.device)
        self.narrowest, self.widest = self._threads, WIDTH
        self._cache: dict[tuple[BaseScene, str], Scene] = {}
        folder.shards.path.mkdir(parents=True, exist_ok=True)
        self._locks = RunLocks(folder.shards.path / ".claims")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._locks.close()  # also of the runs that have continued with a folder

    def prepare(self, chosen: list[Run]) -> ShortGroup:
        """Load the scenes of runs into memory."""
        runs = [short for run in self._available(chosen) if (short := self._short(run)) is not None]
        loaded = None
        if runs:
            try:
                loaded = LoadedScenes([short.scene for short in runs], self._device, self._threads)
            except OutOfMemoryError:
                self.longer += [short.run for short in runs]
                runs = []
        return ShortGroup(runs, loaded)

    def _available(self, runs: list[Run]) -> list[Run]:
        """Return the runs without a folder that no other process has locked or finished."""
        with_folders = self._folder.with_folders()
        self.longer += [run for run in runs if run.number in with_folders]
        runs = [run for run in runs if run.number not in with_folders]
        free = set(self._locks.acquire(run.number for run in runs))
        free -= self._folder.in_shards([run for run in runs if run.number in free])
        others = [run for run in runs if run.number not in free]
        self.reasons |= {run.number: "another process has it" for run in others}
        self._on_progress(len(others))
        return [run for run in runs if run.number in free]

    def _short(self, run: Run) -> ShortRun | None:
        """Return a run as a member of a group; None if its scene or its labels demand a folder."""
        labels, settings = run.labels(), self._folder.settings
        if not any(end in label for label in labels.values() for end in "\r\n"):
            with suppress(InputError):
                scene = self._scene(run)
                exact_solver(scene.method)
                until = criterion(settings.until, scene)
                require_quantities(settings.measured, scene, settings.table)
                if team_size(scene, self._device, self._threads) == 1:
                    return ShortRun(run, labels, scene, until)
        self.longer.append(run)
        return None

    def _scene(self, run: Run) -> Scene:
        """Return the scene of a run, derived from a cached one with the same grains and walls, if any."""
        settings: dict[str, Any] = {}
        of_grains = []
        for name, value in run.changes().items():
            section, _, key = name.partition(".")
            if section in ("domain", "grains", "walls"):
                of_grains.append(value)
            else:
                settings[key] = value
        cached = self._cache.get((run.base, repr(of_grains)))
        if cached is not None:
            return cached.with_settings(**settings)
        fields = document_fields(run.sections(GRAINS), self._folder.path)
        scene = Scene(**fields, name=run.base.name)
        if len(self._cache) == CACHED_SCENES:
            del self._cache[next(iter(self._cache))]
        self._cache[run.base, repr(of_grains)] = scene
        return scene

    def carry_out(self, group: ShortGroup) -> int:
        """Advance a group to its end, but for `SHORT` seconds at most; return the number of grains."""
        if (loaded := group.loaded) is None:
            return 0
        steps, end = [short.scene.steps for short in group.runs], perf_counter() + SHORT
        progress, share = 0.0, len(steps) / sum(steps)

        def poll(done: int) -> None:
            nonlocal progress
            progress += share * done
            self._on_progress(share * done)
            if perf_counter() > end:
                loaded.cancel()

        waiting = dict(enumerate(group.runs))
        runs = None
        if self._folder.settings.until is not None:
            runs = [CountedRun(short.scene.steps, Summary(), short.until) for short in group.runs]
        errors: dict[int, SimulationError] = {}
        for last in [loaded.advance(steps, poll)] if runs is None else loaded.advance_runs(runs, steps, poll):
            errors |= last.errors
        ended: dict[int, tuple[Row, RunResult]] = {}
        for k, values in self._results(loaded, runs):
            short = waiting.pop(k)
            ended[short.run.number] = (short.labels, values)
        interrupted: list[Interrupted] = []
        for k, short in waiting.items():
            error = errors.get(k)
            if isinstance(error, OutOfMemoryError):
                error = None  # it continues alone
            statistics = last.summary(k) if runs is None else runs[k].statistics
            interrupted.append(Interrupted(short, loaded.scenes[k].state(), statistics, error))
        self._on_progress(len(ended) + sum(one.error is not None for one in interrupted) - progress)
        self._folder.shards.write(ended)
        write_all(self._keep, interrupted)
        left = [one.short.run for one in interrupted]
        self.longer += [run for run in left if not self._folder.of(run).result.exists()]
        self._locks.release(ended)
        return sum(short.scene.n for short in group.runs)

    def _keep(self, interrupted: Interrupted) -> None:
        """Save the state of a run that has failed or takes longer than `SHORT` in a folder."""
        short, state, statistics, error = interrupted
        folder = self._folder.of(short.run)
        with ExitStack() as held:
            try:
                held.enter_context(folder.lock())
                start, is_resumed = folder.start_or_checkpoint(self._execution, short.scene)
            except (InputError, OSError):
                return  # `LongRunner` finds the same, and decides what it means for the run
            if not is_resumed:
                folder.save_checkpoint(replace(start, state=state, statistics=statistics))
                if error is not None:
                    folder.fail(str(error), statistics.seconds)

    def _results(
        self, loaded: LoadedScenes, runs: list[CountedRun] | None
    ) -> Iterator[tuple[int, RunResult]]:
        """Yield the results of the finished runs in memory with their indices in the group."""
        settings = self._folder.settings
        for numbers, ends in loaded.ended(runs):
            states = (snapshot(loaded.scenes[k]) for k in numbers)
            yield from zip(numbers, results(ends, states, settings), strict=True)
