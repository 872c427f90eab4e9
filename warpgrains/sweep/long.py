"""Long runs: those with a folder, which are executed in groups and in slices of about a second.

Checkpoints at intervals and at the end let a killed process lose little.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from math import inf
from time import perf_counter
from typing import NamedTuple, Self

from warpgrains.analysis.quantities import require_quantities
from warpgrains.analysis.snapshot import snapshot
from warpgrains.batch.loaded_scenes import LoadedScenes
from warpgrains.errors import InputError, LockedError, MissingExtraError, OutputError, SimulationError
from warpgrains.frame_log import log_of
from warpgrains.scene.state import State
from warpgrains.simulation.checkpoint import Checkpoint
from warpgrains.simulation.run import OpenRun
from warpgrains.solver.loaded_scene import LoadedScene
from warpgrains.solver.memory import OutOfMemoryError
from warpgrains.solver.service import exact_solver
from warpgrains.solver.threads import cores
from warpgrains.sweep.execution import ExecutionOptions, OnFraction, next_size, write_all
from warpgrains.sweep.results import result
from warpgrains.sweep.run_folder import HOW_TO_REPEAT, RunFolder
from warpgrains.sweep.sweep import Run
from warpgrains.sweep.sweep_folder import SweepFolder
from warpgrains.warp_start import find_device

SLICE = 1.0  # intended duration of a slice [s]
FIRST_SLICE = 4  # steps
BETWEEN_CHECKPOINTS = 20.0  # s
LEAST_WIDTH, WIDTH = 16, 64  # runs in a group


class LongRun(OpenRun):
    """A run with a folder in execution. No other process executes it, because its folder is locked."""

    def __init__(self, folder: RunFolder, start: Checkpoint, is_resumed: bool):
        assert start.options is not None  # `RunFolder.start_or_checkpoint` returns them
        statistics = start.statistics if is_resumed else None
        super().__init__(start.scene, start.options, statistics, start.first_step, is_locked=True)
        self.folder, self.saved = folder, start.state  # that of the last checkpoint, if there is one
        self.error: SimulationError | None = None
        self._outputs = ExitStack()

    @classmethod
    @contextmanager
    def locked(cls, folder: RunFolder, execution: ExecutionOptions) -> Iterator[Self | None]:
        """Lock a run and open its outputs. Yield None if it cannot continue, the reason being its result.

        OutputError if another process has the run; MissingExtraError if its method needs a library; OSError
        of its files.
        """
        with folder.lock():
            run = None
            try:
                start, is_resumed = folder.start_or_checkpoint(execution)
                require_quantities(folder.settings.measured, start.scene, folder.settings.table)
                if not is_resumed:
                    # A process ended after its first frame and before its first checkpoint. The run starts
                    # again and records the same frames, if it is recorded.
                    log_of(folder.recording).unlink(missing_ok=True)
                run = cls(folder, start, is_resumed)
                exact_solver(run.scene.method)
                run._outputs.enter_context(run.opened())
            except InputError as error:
                # what another process has, or this installation lacks, is no result of the run
                if isinstance(error, (OutputError if run is None else LockedError, MissingExtraError)):
                    raise
                reason = str(error) if run is None else f"{error}: {HOW_TO_REPEAT}"
                folder.fail(reason, 0.0 if run is None else run.statistics.seconds)
                yield None
                return
            with run._outputs:
                yield run

    @property
    def has_steps_left(self) -> bool:
        return self.error is None and not self.has_ended

    @property
    def progress(self) -> float:
        return self.statistics.steps / self.steps if self.has_steps_left else 1.0

    def record(self, now: LoadedScene) -> None:
        """Observe and record the present state, if due; a run whose frame cannot be recorded has failed."""
        if self.error is None:
            try:
                super().record(now)
            except InputError as error:
                self.error = SimulationError(str(error))

    def save_checkpoint(self, state: State) -> None:
        self.folder.save_checkpoint(self.flush_and_checkpoint(state))
        self.saved = state

    def complete(self) -> str | None:
        """Complete the recording, or discard one without frames; return the reason if that fails."""
        try:
            with suppress(SimulationError), self._outputs:
                if self.error is not None and self.statistics.frames == 0:
                    raise self.error  # an error discards a recording without frames
        except OSError as error:
            return str(error)
        return None

    def finish(self) -> None:
        """Save the result of the run, whose last checkpoint is that of its end."""
        if self.error is None:
            assert self.saved.steps == self.first_step + self.statistics.steps, "an earlier checkpoint"
            end = snapshot(self.scene, self.saved)
            self.folder.finish(result(end, self.statistics, self.folder.settings))
        else:
            self.folder.fail(str(self.error), self.statistics.seconds)


class LongGroup(NamedTuple):
    runs: list[LongRun]
    held: ExitStack
    """The runs as contexts, see `LongRun.locked`."""


class LongRunner:
    """Runner for runs with a folder each, locked from `prepare` on; `reasons` why some are unfinished."""

    def __init__(
        self, folder: SweepFolder, execution: ExecutionOptions, on_progress: OnFraction, held: ExitStack
    ):
        self.reasons: dict[int, str] = {}
        self._folder, self._execution, self._on_progress, self._held = folder, execution, on_progress, held
        self._threads, self._device = execution.threads or cores(), find_device(execution.device)
        self.narrowest, self.widest = LEAST_WIDTH, WIDTH

    def prepare(self, chosen: list[Run]) -> LongGroup:
        group = LongGroup([], self._held.enter_context(ExitStack()))
        for one in chosen:
            try:
                run = group.held.enter_context(LongRun.locked(self._folder.of(one), self._execution))
            except (OutputError, MissingExtraError, OSError) as error:
                self.reasons[one.number] = str(error)
            else:
                group.runs.extend([] if run is None else [run])
        self._on_progress(len(chosen) - len(group.runs))
        return group

    def carry_out(self, group: LongGroup) -> int:
        """Advance runs to their ends, save recordings and results; return the number of grains."""
        runs = group.runs
        with group.held:
            self._on_progress(sum(run.progress for run in runs))
            for run in self._advance([run for run in runs if run.has_steps_left]):
                self._advance([run])
            troubles = [(run, run.complete()) for run in runs]
            self.reasons |= {run.folder.number: trouble for run, trouble in troubles if trouble is not None}
            write_all(LongRun.finish, [run for run, trouble in troubles if trouble is None])
        return sum(run.scene.n for run in runs)

    def _advance(self, runs: list[LongRun]) -> list[LongRun]:
        """Advance runs to their ends, or failure; return those that must go on alone for lack of memory."""
        if not runs:
            return []
        loaded = None
        try:
            loaded = LoadedScenes([run.scene for run in runs], self._device, self._threads)
            for k, run in enumerate(runs):
                loaded.load(k, run.saved)
            self._in_slices(runs, loaded)
        except OutOfMemoryError as error:
            if loaded is not None:
                _save_checkpoints(runs, loaded)
            if len(runs) > 1:
                return [run for run in runs if run.has_steps_left]
            self._on_progress(1.0 - runs[0].progress)
            runs[0].error = OutOfMemoryError(str(error))  # whose traceback does not hold the scene
        return []

    def _in_slices(self, runs: list[LongRun], loaded: LoadedScenes) -> None:
        """Advance runs in slices; record, measure and save checkpoints between slices."""
        slice_steps, kept_at, done = FIRST_SLICE, perf_counter(), sum(run.progress for run in runs)
        _write_due(runs, loaded)
        if any(run.output is not None for run in runs):
            _save_checkpoints(runs, loaded)
        while any(run.has_steps_left for run in runs):
            start = perf_counter()
            steps = [min(slice_steps, run.steps_to_output) if run.has_steps_left else 0 for run in runs]
            errors: dict[int, SimulationError] = {}
            for last in loaded.advance_runs(runs, steps):
                errors |= last.errors
            lacking = [error for error in errors.values() if isinstance(error, OutOfMemoryError)]
            for k, error in errors.items():
                runs[k].error = None if error in lacking else error
            _write_due(runs, loaded)
            before, done = done, sum(run.progress for run in runs)
            self._on_progress(done - before)
            if lacking:
                # for a longer list of contacts; none of the steps is lost. A traceback of `lacking[0]` would
                # hold the scenes, while there is too little memory.
                raise OutOfMemoryError(str(lacking[0]))
            now = perf_counter()
            slice_steps = next_size(max(steps), now - start, SLICE, inf)
            if now - kept_at > BETWEEN_CHECKPOINTS or not any(run.has_steps_left for run in runs):
                _save_checkpoints(runs, loaded)
                kept_at = now


def _write_due(runs: list[LongRun], loaded: LoadedScenes) -> None:
    for run, now in zip(runs, loaded.scenes, strict=True):
        run.record(now)


def _save_checkpoints(runs: list[LongRun], loaded: LoadedScenes) -> None:
    """Save checkpoints of the runs, but of those whose last frame could not be recorded yet, or at all."""
    recorded = [k for k, run in enumerate(runs) if not run.missing_frames]
    states = {k: loaded.scenes[k].state() for k in recorded}
    write_all(lambda k: runs[k].save_checkpoint(states[k]), recorded)
