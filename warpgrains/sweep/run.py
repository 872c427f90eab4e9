"""A run of a sweep that has a folder, while it is carried out in a group with others."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, Self

from warpgrains.analysis.series import Series
from warpgrains.analysis.snapshot import HasState, snapshot
from warpgrains.batch.resident import Done
from warpgrains.errors import OutputError, SceneError
from warpgrains.scene.state import State
from warpgrains.simulation.checkpoint import Checkpoint
from warpgrains.simulation.options import ExecutionOptions, RunOptions
from warpgrains.simulation.run import open_outputs
from warpgrains.simulation.until import criterion
from warpgrains.solver.statistics import RunStatistics
from warpgrains.sweep.folder import SweepFolder
from warpgrains.sweep.results import result
from warpgrains.sweep.run_folder import AGAIN, RunFolder
from warpgrains.sweep.sweep import Run

if TYPE_CHECKING:
    from warpgrains.pictures.film import Film
    from warpgrains.usd.recorder import Recorder


class ResumePoint(NamedTuple):
    """The start of a run, or the end of its steps without a folder."""

    run: Run
    state: State | None = None
    """None at its start."""
    statistics: RunStatistics | None = None
    error: str | None = None
    """Why it failed in these steps, if it did."""


class GroupedRun:
    """A run from where it is, which nobody else carries out as long as it is locked."""

    def __init__(self, folder: RunFolder, start: Checkpoint):
        self.folder, self.scene = folder, start.scene
        self._state, self.statistics = start.state, start.statistics
        self.options = start.options or RunOptions(steps=start.scene.steps)
        self.until = criterion(self.options.until, self.scene)
        self.error: str | None = None
        self._outputs = ExitStack()
        self._recorder: Recorder | Film | None = None
        self._series: Series | None = None

    @classmethod
    def begin(
        cls, sweep: SweepFolder, point: ResumePoint, execution: ExecutionOptions, held: ExitStack
    ) -> Self | str:
        """Return a run where it is, or why it goes no further: it is left to others, or has failed.

        `held` gets its lock and its outputs.
        """
        folder, run = sweep.of(point.run), None
        with ExitStack() as own:
            try:
                own.push(folder.lock())
                start = folder.begin(execution)
                if point.error is not None:
                    raise SceneError(point.error)
                if point.state is not None and point.statistics is not None and start.statistics.steps == 0:
                    start = replace(start, state=point.state, statistics=point.statistics)
                run = cls(folder, start)
                own.push(run._open())
            except (OutputError, OSError) as error:
                return str(error)
            except SceneError as error:
                reason = str(error) if run is None else f"{error}: {AGAIN}"
                folder.fail(reason, 0.0 if run is None else run.statistics.seconds)
                return reason
            held.push(own.pop_all())
            return run

    def _open(self) -> ExitStack:
        """Open the recording and the series."""
        options = self.options
        with ExitStack() as outputs:
            recorder = open_outputs(options, self.scene, self.statistics)
            self._recorder = outputs.enter_context(recorder)
            if options.measure is not None:
                resume_at = self.statistics.steps or None
                series = Series(options.measure, options.measure_every, options.series, resume_at)
                self._series = outputs.enter_context(series)
            self._outputs = outputs.pop_all()
        return self._outputs

    @property
    def goes_on(self) -> bool:
        """Whether there are steps left to do."""
        return self.statistics.steps < self.options.steps and self.error is None

    @property
    def progress(self) -> float:
        """The share of the run that is done."""
        return self.statistics.steps / self.options.steps if self.goes_on else 1.0

    @property
    def is_recorded(self) -> bool:
        """Whether there are frames left to record."""
        return self._recorder is not None and self.error is None

    @property
    def steps_to_output(self) -> int:
        """Steps until the next frame or row of the series is due, or the run ends."""
        steps = self.statistics.steps
        ends = [self.options.steps]
        if self._recorder is not None:
            ends.append(self._recorder.times.step(self.statistics.frames))
        if self._series is not None:
            ends.append((steps // self._series.every + 1) * self._series.every)
        return min(ends) - steps

    def count(self, done: Done) -> None:
        """Count the steps that the run has done; it ends now if its criterion is met."""
        if self.until is None:
            self.statistics.add(done.statistics)
        self.error = done.error
        if self.statistics.met:
            self.options = replace(self.options, steps=self.statistics.steps)

    def state(self) -> State:
        """Return the state that the run has reached."""
        return self._state

    def observe(self, moving: HasState) -> None:
        """Record a frame and measure, where they are due; the grains are where `moving` has them."""
        if self.error is not None:
            return
        steps = self.statistics.steps
        if self._recorder is not None and steps == self._recorder.times.step(self.statistics.frames):
            reached = moving.state()
            self._recorder.record(reached.position, reached.velocity, spin=reached.spin, angle=reached.angle)
            self.statistics.frames += 1
        if self._series is not None and steps % self._series.every == 0:
            self._series.observe(snapshot(self.scene, moving.state()))

    def reach(self, state: State) -> None:
        """Take the state that the run has reached; the frames it counts are on the disk."""
        self._state = state
        if self._recorder is not None:
            self._recorder.flush()

    def keep(self) -> None:
        """Save where the run is; the rows of its series are on the disk before that."""
        if self._series is not None:
            self._series.flush()
        self.folder.keep(Checkpoint(self.scene, self._state, self.options, self.statistics))

    def complete(self) -> str | None:
        """Make the recording whole; return why it cannot be, if so."""
        try:
            self._outputs.close()
        except OSError as error:
            return str(error)
        return None

    def finish(self) -> None:
        """Save the result."""
        if self.error is None:
            end = snapshot(self.scene, self._state)
            self.folder.finish(result(end, self.statistics, self.folder.columns.after_labels))
        else:
            self.folder.fail(self.error, self.statistics.seconds)
