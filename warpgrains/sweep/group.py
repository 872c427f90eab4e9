"""Groups: runs in memory that are advanced together for some time."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from time import perf_counter

import numpy as np
import warp as wp

from warpgrains.analysis.snapshot import snapshot
from warpgrains.base.errors import InputError
from warpgrains.base.files import Row
from warpgrains.batch.loaded_scenes import LoadedScenes
from warpgrains.simulation.run import advance_runs
from warpgrains.solver.memory import OutOfMemoryError
from warpgrains.solver.statistics import Summary
from warpgrains.sweep.execution import OnFraction, RunSettings
from warpgrains.sweep.results import RunResult, failure, results
from warpgrains.sweep.sweep_run import SweepRun

WRITERS = 16


class Group:
    """Runs that are advanced together, after `load` has loaded them into memory.

    `ended` maps the number of each run that has ended or failed to the labels and the result of the run.
    """

    def __init__(self, members: list[SweepRun]):
        self.members = members
        self.ended: dict[int, tuple[Row, RunResult]] = {}
        self._loaded: LoadedScenes | None = None

    @property
    def is_loaded(self) -> bool:
        return self._loaded is not None

    def load(self, device: wp.Device, threads: int) -> None:
        """Load the runs into memory; OutOfMemoryError if they do not fit together."""
        self._loaded = LoadedScenes([one.scene for one in self.members], device, threads)
        for k, one in enumerate(self.members):
            one.waits = False
            if one.state is not None:
                self._loaded.load(k, one.state)

    def advance(self, seconds: float, on_progress: OnFraction) -> None:
        """Advance loaded runs until all have ended or failed, or until about `seconds` have passed.

        If a run lacks memory that its group uses, it waits, and gets its own group later.
        """
        if self._loaded is None:
            return
        loaded, members = self._loaded, self.members
        end, share = perf_counter() + seconds, len(members) / sum(one.options.steps for one in members)

        def poll(done: int) -> None:
            on_progress(share * done)
            if perf_counter() > end:
                loaded.cancel()

        def advance(due: list[int]) -> Iterator[tuple[int, Summary]]:
            last = loaded.advance(due, poll)
            for k in np.flatnonzero(due).tolist():
                done = last.summary(k)
                if isinstance(last.errors.get(k), OutOfMemoryError) and len(members) > 1:
                    members[k].is_alone = members[k].waits = True
                    done.error = None
                yield k, done

        for _ in advance_runs(members, loaded.scenes, advance):
            if perf_counter() > end:
                return

    def save(self, chosen: Collection[int]) -> None:
        """Save checkpoints of the runs `members[k]`, k in `chosen`. Runs without a folder have none."""
        if self._loaded is not None:
            for k in chosen:
                self.members[k].state = self._loaded.scenes[k].state()
            with ThreadPoolExecutor(WRITERS) as writers:  # most of the time is spent waiting for the disk
                list(writers.map(SweepRun.save_state, (self.members[k] for k in chosen)))

    def finish(self, settings: RunSettings) -> dict[int, str]:
        """Complete the outputs of ended runs, and store the results in `ended`.

        Return why outputs cannot be completed, by number of the run; these runs get no result.
        """
        members = self.members
        ended = [k for k, one in enumerate(members) if one.has_ended]
        self.save([k for k in ended if members[k].folder])
        reasons = {k: reason for k in ended if (reason := members[k].close()) is not None}
        found = {
            k: failure(error, settings, members[k].statistics.seconds)
            for k in ended
            if (error := members[k].error) is not None
        }
        means: dict[int, dict[str, float]] = {}
        for k in ended:
            try:
                means[k] = members[k].means(settings.after)
            except InputError as error:  # the run was too short
                found.setdefault(k, failure(str(error), settings, members[k].statistics.seconds))
        if self._loaded is not None:
            scenes, good = self._loaded.scenes, [k for k in ended if k not in found]
            for alike, ends in self._loaded.snapshots(good):
                done, averaged = [members[k].statistics for k in alike], [means[k] for k in alike]
                states = (snapshot(scenes[k]) for k in alike)
                found |= zip(alike, results(ends, done, states, averaged, settings), strict=True)
        for k in found.keys() - reasons.keys():
            self.ended[members[k].run.number] = members[k].labels, found[k]
        return {members[k].run.number: reason for k, reason in reasons.items()}
