"""A run of a sweep with a folder, during its execution in a group."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, Self

from warpgrains.analysis.series import Series
from warpgrains.analysis.snapshot import HasState, snapshot
from warpgrains.batch.resident import StepsDone
from warpgrains.errors import InputError, OutputError
from warpgrains.scene.state import State
from warpgrains.simulation.checkpoint import Checkpoint
from warpgrains.simulation.options import RunOptions
from warpgrains.simulation.run import open_outputs
from warpgrains.simulation.until import criterion
from warpgrains.solver.statistics import RunStatistics
from warpgrains.sweep.execution import ExecutionOptions
from warpgrains.sweep.folder import SweepFolder
from warpgrains.sweep.results import result
from warpgrains.sweep.run_folder import HOW_TO_REPEAT, RunFolder
from warpgrains.sweep.sweep import Run

if TYPE_CHECKING:
    from warpgrains.pictures.film import Film
    from warpgrains.usd.recorder import Recorder


class ResumePoint(NamedTuple):
    """State from which a run continues: its start, or its last state as a short run."""

    run: Run
    state: State | None = None
    """None at the start of the run."""
    statistics: RunStatistics | None = None
    error: str | None = None
    """Reason of a failure in these steps, or None."""


class GroupedRun:
    """A run that is being executed in a group. No other process executes it, because its folder is locked."""

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
        """Return the run, or the reason why it cannot continue: another process has it, or it has failed.

        Its lock and outputs are entered into `held`.
        """
        folder, run = sweep.of(point.run), None
        with ExitStack() as own:
            try:
                own.push(folder.lock())
                start = folder.begin(execution)
                if point.error is not None:
                    raise InputError(point.error)
                if point.state is not None and point.statistics is not None and start.statistics.steps == 0:
                    start = replace(start, state=point.state, statistics=point.statistics)
                run = cls(folder, start)
                own.push(run._open())
            except (OutputError, OSError) as error:
                return str(error)
            except InputError as error:
                reason = str(error) if run is None else f"{error}: {HOW_TO_REPEAT}"
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
    def has_steps_left(self) -> bool:
        """True if steps remain to be done."""
        return self.statistics.steps < self.options.steps and self.error is None

    @property
    def progress(self) -> float:
        """Fraction of the run that is done."""
        return self.statistics.steps / self.options.steps if self.has_steps_left else 1.0

    @property
    def has_frames_left(self) -> bool:
        """True if frames remain to be recorded."""
        return self._recorder is not None and self.error is None

    @property
    def steps_to_output(self) -> int:
        """Number of steps until the next frame or row of the series, or to the end of the run."""
        steps = self.statistics.steps
        ends = [self.options.steps]
        if self._recorder is not None:
            ends.append(self._recorder.times.step(self.statistics.frames))
        if self._series is not None:
            ends.append((steps // self._series.every + 1) * self._series.every)
        return min(ends) - steps

    def count(self, done: StepsDone) -> None:
        """Add the steps that the run has done; it ends now if its criterion is met."""
        if self.until is None:
            self.statistics.add(done.statistics)
        self.error = done.error
        if self.statistics.met:
            self.options = replace(self.options, steps=self.statistics.steps)

    def state(self) -> State:
        """Return the present state of the run."""
        return self._state

    def observe(self, moving: HasState) -> None:
        """Record a frame and append to the series, if due. The grains are those of `moving`."""
        if self.error is not None:
            return
        steps = self.statistics.steps
        if self._recorder is not None and steps == self._recorder.times.step(self.statistics.frames):
            reached = moving.state()
            more = {name: getattr(reached, name) for name in ("spin", "angle", "driven")}
            self._recorder.record(reached.position, reached.velocity, **more)
            self.statistics.frames += 1
        if self._series is not None and steps % self._series.every == 0:
            self._series.observe(snapshot(self.scene, moving.state()))

    def set_state(self, state: State) -> None:
        """Set the present state of the run and flush the frames that it counts to the disk."""
        self._state = state
        if self._recorder is not None:
            self._recorder.flush()

    def save_checkpoint(self) -> None:
        """Save a checkpoint after flushing the rows of the series to the disk."""
        if self._series is not None:
            self._series.flush()
        self.folder.save_checkpoint(Checkpoint(self.scene, self._state, self.options, self.statistics))

    def complete(self) -> str | None:
        """Complete the recording; return the reason if that fails."""
        try:
            self._outputs.close()
        except OSError as error:
            return str(error)
        return None

    def finish(self) -> None:
        """Save the result of the run."""
        if self.error is None:
            end = snapshot(self.scene, self._state)
            self.folder.finish(result(end, self.statistics, self.folder.columns.after_labels))
        else:
            self.folder.fail(self.error, self.statistics.seconds)
