"""Many runs in one process: in groups, each a batch of scenes that have as many steps left.

A group proceeds in slices of about a second. Every now and then its runs save where they are, so that a
killed process loses little; at its end each run gets its result.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from time import perf_counter
from typing import TYPE_CHECKING

from warpgrains.arrays import FloatArray
from warpgrains.batch.batch import Batch, SceneSummary
from warpgrains.errors import SceneError, SimulationError
from warpgrains.scene.state import State
from warpgrains.simulation.checkpoint import Checkpoint
from warpgrains.simulation.options import ExecutionOptions, OnProgress, RunOptions
from warpgrains.simulation.run import open_outputs
from warpgrains.solver.statistics import RunStatistics
from warpgrains.sweep.folder import RunFolder
from warpgrains.sweep.results import failure, result

if TYPE_CHECKING:
    from warpgrains.usd.recorder import Recorder

SLICE = 1.0  # s
FIRST_SLICE, GROWTH = 4, 8  # steps of the first slice, and by how much the next one may be longer
BETWEEN_CHECKPOINTS = 20.0  # s
FIRST_WIDTH, WIDTH, RECORDED_WIDTH = 8, 64, 16  # runs in a group; frames wait in memory
WRITERS = 16
MOST_WAITING = 256  # runs that wait for others with as many steps left
MOST_GRAINS = 2_000_000  # in a group


class SweepRun:
    """A run while it is carried out, beside others of its group; see `RunFolder.begin`.

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


def finish_runs(folders: Iterable[RunFolder], execution: ExecutionOptions, on_progress: OnProgress) -> None:
    """Carry out runs that are not finished to their end, each from where it is.

    A run that fails gets a result that says why, and the others go on.

    Raises
    ------
    OSError
        A file cannot be written.
    """
    for group in _groups(folders, execution, on_progress):
        _finish(group, execution, on_progress)


def _groups(
    folders: Iterable[RunFolder], execution: ExecutionOptions, on_progress: OnProgress
) -> Iterator[list[SweepRun]]:
    """Gather runs with as many steps left; a run whose scene is none has failed."""
    waiting: dict[int, list[SweepRun]] = {}
    width, widest = FIRST_WIDTH, WIDTH if execution.fps is None else RECORDED_WIDTH
    for folder, future in _ahead(folders, execution.fps):
        try:
            run = future.result()
        except SceneError as error:
            folder.finish(failure(folder.labels, str(error)))
            on_progress(1.0)
            continue
        group = waiting.setdefault(run.left, [])
        group.append(run)
        if len(group) >= width or sum(run.scene.n for run in group) >= MOST_GRAINS:
            yield waiting.pop(run.left)
            width = min(2 * width, widest)
        elif sum(map(len, waiting.values())) == MOST_WAITING:
            yield waiting.pop(max(waiting, key=lambda left: len(waiting[left])))
    yield from waiting.values()


def _ahead(folders: Iterable[RunFolder], fps: float | None) -> Iterator[tuple[RunFolder, Future[SweepRun]]]:
    """Begin runs on another thread, while groups before them are carried out: some layouts take long."""
    begun: deque[tuple[RunFolder, Future[SweepRun]]] = deque()
    executor = ThreadPoolExecutor(1)
    try:
        for folder in folders:
            begun.append((folder, executor.submit(SweepRun, folder, fps)))
            if len(begun) == WIDTH:
                yield begun.popleft()
        yield from begun
    finally:
        executor.shutdown(cancel_futures=True)


def _finish(group: list[SweepRun], execution: ExecutionOptions, on_progress: OnProgress) -> None:
    """Carry a group out to its end; the recordings are whole before there is a result."""
    with ExitStack() as outputs:
        for run in group:
            run.open(outputs)
            on_progress(1.0 - run.left / run.options.steps)
        if group[0].left > 0:
            _advance(group, execution, on_progress)
    _write(SweepRun.finish, group)


def _advance(group: list[SweepRun], execution: ExecutionOptions, on_progress: OnProgress) -> None:
    """Advance a group to its end; a run that does not fit in memory, even alone, has failed."""
    try:
        batch = Batch([run.scene for run in group], execution.device, execution.threads)
    except SimulationError as error:
        if len(group) > 1:
            for run in group:
                _advance([run], execution, on_progress)
        else:
            group[0].error = str(error)
            on_progress(group[0].left / group[0].options.steps)
        return
    for k, run in enumerate(group):
        batch.restore(k, run.state)
    _run(group, batch, on_progress)


def _run(group: list[SweepRun], batch: Batch, on_progress: OnProgress) -> None:
    """Run a batch in slices, record its frames and save where its runs are."""
    left, pace, kept_at = group[0].left, FIRST_SLICE, perf_counter()
    if any(run.is_recorded for run in group):
        _record(group, batch)
        _keep(group, batch)
    while left > 0:
        start = perf_counter()
        steps = min(pace, left, *(run.until_frame for run in group))
        for run, summary in zip(group, batch.run(steps), strict=True):
            run.count(summary)
            on_progress(steps / run.options.steps)
        left -= steps
        _record(group, batch)
        now = perf_counter()
        pace = max(1, min(GROWTH * pace, int(SLICE / (now - start) * steps)))
        if left == 0 or now - kept_at > BETWEEN_CHECKPOINTS:
            _keep(group, batch)
            kept_at = now


def _record(group: list[SweepRun], batch: Batch) -> None:
    for k, run in enumerate(group):
        if run.until_frame == 0:
            run.record(batch.position(k), batch.velocity(k))


def _keep(group: list[SweepRun], batch: Batch) -> None:
    for k, run in enumerate(group):
        run.reach(batch.state(k))
    _write(SweepRun.keep, group)


def _write(write: Callable[[SweepRun], None], group: list[SweepRun]) -> None:
    """Write files of all runs side by side: most of the time is spent waiting for the disk."""
    with ThreadPoolExecutor(WRITERS) as writers:
        list(writers.map(write, group))
