"""Groups: runs in memory that are advanced together for some time."""

from __future__ import annotations

from collections.abc import Collection
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from time import perf_counter

import warp as wp

from warpgrains.analysis.snapshot import snapshot
from warpgrains.base.errors import InputError
from warpgrains.base.files import Row
from warpgrains.batch.loaded_scenes import LoadedScenes, StepsTaken
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import State
from warpgrains.simulation.until import CountedRun
from warpgrains.solver.memory import OutOfMemoryError
from warpgrains.solver.statistics import Summary
from warpgrains.sweep.execution import OnFraction, RunSettings
from warpgrains.sweep.results import RunResult, failure, results
from warpgrains.sweep.run_folder import FolderRun
from warpgrains.sweep.sweep import Run

WRITERS = 16


@dataclass(eq=False, slots=True)
class GroupedRun:
    """A run in a group."""

    run: Run
    labels: Row
    scene: Scene
    counted: CountedRun | None
    """Its steps, and a `FolderRun` if it has a folder; None if nothing is due before its last step."""
    is_alone: bool
    """True if it needs a group of its own: several threads share it, or it lacked memory beside others."""
    state: State | None = None
    """State from which it continues; None at its start."""
    error: str | None = None
    """Reason of its failure."""

    @property
    def folder(self) -> FolderRun | None:
        return self.counted if isinstance(self.counted, FolderRun) else None

    @property
    def progress(self) -> float:
        return 0.0 if self.state is None else self.state.steps / self.scene.steps

    @property
    def has_ended(self) -> bool:
        """True if it has failed, or an end is counted."""
        return self.error is not None or (self.counted is not None and self.counted.has_ended)

    @property
    def steps_due(self) -> int:
        """Number of steps to its next output, or to its end."""
        if self.has_ended:
            return 0
        if self.folder is not None:
            return self.folder.steps_to_output
        return self.scene.steps - (0 if self.counted is None else self.counted.statistics.steps)


class Group:
    """Runs that are advanced together, after `load`.

    `ended` has the labels and results of those that have ended or failed, by number of the run.
    """

    def __init__(self, members: list[GroupedRun]):
        self.members = members
        self.ended: dict[int, tuple[Row, RunResult]] = {}
        self._loaded: LoadedScenes | None = None
        self._runs: list[CountedRun] = []
        self._last: StepsTaken | None = None

    @property
    def is_loaded(self) -> bool:
        return self._loaded is not None

    def load(self, device: wp.Device, threads: int) -> None:
        """Load the runs into memory; OutOfMemoryError if they do not fit together."""
        self._loaded = LoadedScenes([one.scene for one in self.members], device, threads)
        for k, one in enumerate(self.members):
            if one.state is not None:
                self._loaded.load(k, one.state)

    def advance(self, seconds: float, on_progress: OnFraction) -> None:
        """Advance the runs, if they are loaded, to their ends or failures, for a limited time."""
        if self._loaded is None:
            return
        loaded, members = self._loaded, self.members
        end, share = perf_counter() + seconds, len(members) / sum(one.scene.steps for one in members)

        def poll(done: int) -> None:
            on_progress(share * done)
            if perf_counter() > end:
                loaded.cancel()

        if any(one.counted is not None for one in members):
            for one in members:
                one.counted = one.counted or CountedRun(one.scene.steps, Summary())
        self._runs = runs = [one.counted for one in members if one.counted is not None]
        due = self._due()
        while any(due):
            for last in loaded.advance_runs(runs, due, poll) if runs else [loaded.advance(due, poll)]:
                self._last = last
                for k, error in last.errors.items():
                    if isinstance(error, OutOfMemoryError) and len(members) > 1:
                        members[k].is_alone = True
                    else:
                        members[k].error = str(error)
            due = self._due()
            if not runs or perf_counter() > end:
                return

    def _due(self) -> list[int]:
        """Observe and record the present states, if due; return the steps of the runs to the next time."""
        assert self._loaded is not None
        for one, now in zip(self.members, self._loaded.scenes, strict=True):
            if one.folder is not None and one.error is None:
                try:
                    one.folder.record(now)
                except InputError as error:  # a frame that cannot be recorded
                    one.error = str(error)
        beside_others = len(self.members) > 1
        return [0 if one.is_alone and beside_others else one.steps_due for one in self.members]

    def save(self, chosen: Collection[int]) -> None:
        """Save checkpoints of the present states of runs with a folder, unless they are not loaded."""
        if self._loaded is not None:
            for k in chosen:
                self.members[k].state = self._loaded.scenes[k].state()
            with ThreadPoolExecutor(WRITERS) as writers:  # most of the time is spent waiting for the disk
                list(writers.map(self._save, chosen))

    def _save(self, k: int) -> None:
        one = self.members[k]
        if one.folder is not None and one.state is not None:
            one.folder.save(one.state)

    def finish(self, settings: RunSettings) -> dict[int, str]:
        """Complete the outputs of the runs that have ended; return why that is impossible, by number."""
        folders = {k: one.folder for k, one in enumerate(self.members) if one.has_ended and one.folder}
        self.save(folders)
        reasons = {k: folder.close(self.members[k].error) for k, folder in folders.items()}
        found: dict[int, RunResult] = {}
        if self._loaded is not None:
            scenes = self._loaded.scenes
            for numbers, ends in self._loaded.ended(self._runs or None):
                states = (snapshot(scenes[k]) for k in numbers)
                found |= zip(numbers, results(ends, states, settings), strict=True)
        for k, one in enumerate(self.members):
            if one.error is not None:
                found[k] = failure(one.error, settings, self.statistics(k).seconds)
        for k, values in found.items():
            if reasons.get(k) is None:
                self.ended[self.members[k].run.number] = self.members[k].labels, values
        return {self.members[k].run.number: reason for k, reason in reasons.items() if reason is not None}

    def statistics(self, k: int) -> Summary:
        counted = self.members[k].counted
        if counted is not None:
            return counted.statistics
        return Summary() if self._last is None else self._last.summary(k)
