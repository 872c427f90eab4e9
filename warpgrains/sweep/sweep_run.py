"""A run of a sweep while it is carried out, beside others of its batch."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

from warpgrains.arrays import FloatArray
from warpgrains.batch.batch import SceneSummary
from warpgrains.scene.state import State
from warpgrains.simulation.checkpoint import Checkpoint
from warpgrains.simulation.options import RunOptions
from warpgrains.simulation.run import open_outputs
from warpgrains.solver.statistics import RunStatistics
from warpgrains.sweep.results import failure, result
from warpgrains.sweep.run_folder import RunFolder

if TYPE_CHECKING:
    from warpgrains.usd.recorder import Recorder


class SweepRun:
    """A run in a group.

    Parameters
    ----------
    folder : RunFolder
        Its files.
    fps : float or None
        Frames recorded a second of simulated time [1/s], if the run is to be recorded.

    Raises
    ------
    SceneError
        Its scene is none, or its checkpoint is damaged.
    """

    def __init__(self, folder: RunFolder, fps: float | None):
        start = folder.begin(fps)
        self.folder, self.scene, self.statistics, self.state = (
            folder,
            start.scene,
            start.statistics,
            start.state,
        )
        self.options = start.options or RunOptions(steps=start.scene.steps)
        self.error: str | None = None
        self._recorder: Recorder | None = None

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

    def open(self, outputs: ExitStack) -> None:
        """Open what the run writes to."""
        self._recorder = outputs.enter_context(open_outputs(self.options, self.scene, self.statistics))

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
            self.folder.finish(result(self.folder.labels, self._reached()))
        else:
            self.folder.finish(failure(self.folder.labels, self.error, self.statistics.seconds))

    def _reached(self) -> Checkpoint:
        return Checkpoint(self.scene, self.state, self.options, self.statistics)
