"""A run of a sweep while it is carried out, beside others of its group."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from types import TracebackType
from typing import TYPE_CHECKING, Self

from warpgrains.analysis.series import Series
from warpgrains.analysis.snapshot import snapshot
from warpgrains.errors import OutputError, SceneError
from warpgrains.locks import Lock
from warpgrains.scene.state import State
from warpgrains.simulation.checkpoint import Checkpoint
from warpgrains.simulation.options import ExecutionOptions, RunOptions
from warpgrains.simulation.run import open_outputs
from warpgrains.simulation.until import criterion, steps_to_test
from warpgrains.solver.statistics import RunStatistics
from warpgrains.sweep.folder import SweepFolder
from warpgrains.sweep.run_folder import AGAIN, RunFolder, Start

if TYPE_CHECKING:
    from warpgrains.batch.batch import Batch, SceneSummary
    from warpgrains.pictures.film import Film
    from warpgrains.usd.recorder import Recorder


def begin(sweep: SweepFolder, start: Start, execution: ExecutionOptions) -> SweepRun | str:
    """Return a run where it is, see `RunFolder.begin`, or why it goes no further: left, or failed."""
    folder = sweep.of(start.run)
    try:
        lock = folder.lock()
    except (OutputError, OSError) as error:
        return str(error)
    try:
        run = SweepRun(folder, folder.begin(execution), lock)
        if start.error is not None:
            raise SceneError(start.error)
        if start.state is not None and start.statistics is not None and run.statistics.steps == 0:
            run.state, run.statistics = start.state, start.statistics
        return run
    except (OutputError, OSError) as error:
        left = str(error)
    except SceneError as error:
        left = str(error)
        folder.fail(left)
    lock.release()
    return left


class SweepRun:
    """A run from where it is, which nobody else carries out before the end of its ``with`` block."""

    def __init__(self, folder: RunFolder, start: Checkpoint, lock: Lock):
        self.folder, self.scene = folder, start.scene
        self.statistics, self.state = start.statistics, start.state
        self.options = start.options or RunOptions(steps=start.scene.steps)
        self.error: str | None = None
        self._until = criterion(self.options.until, self.scene)
        self._lock, self._outputs = lock, ExitStack()
        self._recorder: Recorder | Film | None = None
        self._series: Series | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None = None,
        error: BaseException | None = None,
        traceback: TracebackType | None = None,
    ) -> None:
        try:
            self._outputs.__exit__(kind, error, traceback)
        finally:
            self._lock.release()

    @property
    def left(self) -> int:
        """Steps left."""
        return self.options.steps - self.statistics.steps

    @property
    def goes_on(self) -> bool:
        """Whether there are steps to be done still."""
        return self.left > 0 and self.error is None

    @property
    def is_recorded(self) -> bool:
        """Whether there are frames to record still."""
        return self._recorder is not None and self.error is None

    @property
    def until_look(self) -> int:
        """Steps until the next frame or row of the series is due, or the run ends, or its end is tested."""
        ends = [self.options.steps]
        if self._until is not None:
            ends.append(self.statistics.steps + steps_to_test(self.statistics.steps))
        if self._recorder is not None and self.error is None:
            ends.append(self._recorder.times.step(self.statistics.frames))
        if self._series is not None and self.error is None:
            ends.append((self.statistics.steps // self._series.every + 1) * self._series.every)
        return min(ends) - self.statistics.steps

    def open(self) -> str | None:
        """Open what the run writes to; return why it goes no further, if so: it is left, or has failed."""
        try:
            self._recorder = self._outputs.enter_context(
                open_outputs(self.options, self.scene, self.statistics)
            )
            if self.options.measure is not None:
                resume_at = self.statistics.steps or None
                series = Series(
                    self.options.measure, self.options.measure_every, self.options.series, resume_at
                )
                self._series = self._outputs.enter_context(series)
        except (OutputError, OSError) as error:
            return str(error)
        except SceneError as error:
            self.error = f"{error}: {AGAIN}"
            self.finish()
            return self.error
        return None

    def complete(self) -> str | None:
        """Make the recording whole; return why it cannot be, if so."""
        try:
            self._outputs.close()
        except OSError as error:
            return str(error)
        return None

    def count(self, summary: SceneSummary, batch: Batch, k: int) -> None:
        """Count what the run did, unless it was over; it ends now if its criterion is met."""
        if not self.goes_on:
            return
        self.statistics.add(RunStatistics.of_summary(summary))
        self.error = summary.error
        if self._until is not None and self.error is None:
            moment = snapshot(self.scene, batch.state(k))
            if self._until.is_met(moment, self.statistics):
                self.options = replace(self.options, steps=self.statistics.steps)

    def look(self, batch: Batch, k: int) -> None:
        """Record a frame and measure where it is time to; the run is scene k of a batch."""
        if self.error is not None:
            return
        steps = self.statistics.steps
        if self._recorder is not None and steps == self._recorder.times.step(self.statistics.frames):
            self._recorder.record(batch.position(k), batch.velocity(k))
            self.statistics.frames += 1
        if self._series is not None and steps % self._series.every == 0:
            self._series.observe(snapshot(self.scene, batch.state(k)))

    def reach(self, state: State) -> None:
        """Take the state that the run has reached; the frames it counts are on the disk."""
        self.state = state
        if self._recorder is not None:
            self._recorder.flush()

    def keep(self) -> None:
        """Save where the run is; the rows of its series are on the disk before that."""
        if self._series is not None:
            self._series.flush()
        self.folder.keep(self._reached())

    def finish(self) -> None:
        """Save the result."""
        if self.error is None:
            self.folder.finish(snapshot(self.scene, self.state), self.statistics)
        else:
            self.folder.fail(self.error, self.statistics.seconds)

    def _reached(self) -> Checkpoint:
        return Checkpoint(self.scene, self.state, self.options, self.statistics)
