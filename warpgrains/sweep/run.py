"""A run of a sweep while it is carried out, beside others of its group."""

from __future__ import annotations

from contextlib import ExitStack
from types import TracebackType
from typing import TYPE_CHECKING, NamedTuple, Self

from warpgrains.analysis.snapshot import snapshot
from warpgrains.arrays import FloatArray
from warpgrains.errors import OutputError, SceneError
from warpgrains.locks import Lock
from warpgrains.scene.state import State
from warpgrains.simulation.checkpoint import Checkpoint
from warpgrains.simulation.options import RunOptions
from warpgrains.simulation.run import open_outputs
from warpgrains.solver.statistics import RunStatistics
from warpgrains.sweep.folder import SweepFolder
from warpgrains.sweep.results import failure, result
from warpgrains.sweep.run_folder import AGAIN, RunFolder
from warpgrains.sweep.sweep import Run

if TYPE_CHECKING:
    from warpgrains.batch.batch import SceneSummary
    from warpgrains.pictures.film import Film
    from warpgrains.usd.recorder import Recorder


class Start(NamedTuple):
    """Where a run with a folder begins."""

    run: Run
    state: State | None = None
    """Where it is if it has been carried out without a folder so far."""
    statistics: RunStatistics | None = None
    error: str | None = None
    """Why it failed meanwhile, if it did."""


def begin(sweep: SweepFolder, start: Start, fps: float | None) -> SweepRun | str:
    """Return a run where it is, see `RunFolder.begin`, or why it goes no further: left, or failed."""
    folder = sweep.of(start.run)
    try:
        lock = folder.lock()
    except (OutputError, OSError) as error:
        return str(error)
    try:
        run = SweepRun(folder, folder.begin(fps), lock)
        if start.error is not None:
            raise SceneError(start.error)
        if start.state is not None and start.statistics is not None and run.statistics.steps == 0:
            run.state, run.statistics = start.state, start.statistics
        return run
    except (OutputError, OSError) as error:
        left = str(error)
    except SceneError as error:
        left = str(error)
        folder.finish(failure(folder.labels, left))
    lock.release()
    return left


class SweepRun:
    """A run from where it is, which nobody else carries out before the end of its ``with`` block."""

    def __init__(self, folder: RunFolder, start: Checkpoint, lock: Lock):
        self.folder, self.scene = folder, start.scene
        self.statistics, self.state = start.statistics, start.state
        self.options = start.options or RunOptions(steps=start.scene.steps)
        self.error: str | None = None
        self._lock, self._outputs = lock, ExitStack()
        self._recorder: Recorder | Film | None = None

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
    def is_recorded(self) -> bool:
        """Whether there are frames to record still."""
        return self._recorder is not None and self.error is None

    @property
    def until_frame(self) -> int:
        """Steps until the next frame is due; those to the end, if none is."""
        if self._recorder is None or self.error is not None:
            return self.options.steps
        return self.statistics.frames * self._recorder.stride - self.statistics.steps

    def open(self) -> str | None:
        """Open what the run writes to; return why it goes no further, if so: it is left, or has failed."""
        try:
            self._recorder = self._outputs.enter_context(
                open_outputs(self.options, self.scene, self.statistics)
            )
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

    def count(self, summary: SceneSummary) -> None:
        """Count what the run did, unless it had failed before."""
        if self.error is None:
            self.statistics.add(RunStatistics.of_summary(summary))
            self.error = summary.error

    def record(self, position: FloatArray, velocity: FloatArray) -> None:
        """Record a frame."""
        assert self._recorder is not None
        self._recorder.record(position, velocity)
        self.statistics.frames += 1

    def reach(self, state: State) -> None:
        """Take the state that the run has reached; the frames it counts are on the disk."""
        self.state = state
        if self._recorder is not None:
            self._recorder.flush()

    def keep(self) -> None:
        """Save where the run is."""
        self.folder.keep(self._reached())

    def finish(self) -> None:
        """Save the result."""
        if self.error is None:
            end = snapshot(self.scene, self.state)
            self.folder.finish(result(self.folder.labels, end, self.statistics))
        else:
            self.folder.finish(failure(self.folder.labels, self.error, self.statistics.seconds))

    def _reached(self) -> Checkpoint:
        return Checkpoint(self.scene, self.state, self.options, self.statistics)
