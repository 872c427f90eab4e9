"""Many runs in one process: short ones first (short.py), then those that have folders.

These go in groups, each a batch of scenes that have as many steps left.

A group proceeds in slices of about a second. Every now and then its runs save where they are, so that a
killed process loses little; at its end each run gets its result.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing
from time import perf_counter

from warpgrains.batch.batch import Batch
from warpgrains.errors import SimulationError
from warpgrains.simulation.options import ExecutionOptions, OnProgress
from warpgrains.sweep.folder import SweepFolder
from warpgrains.sweep.run import SweepRun, begin
from warpgrains.sweep.run_folder import Start
from warpgrains.sweep.short import ShortRuns
from warpgrains.sweep.sweep import Run

SLICE = 1.0  # s
FIRST_SLICE, GROWTH = 4, 8  # steps of the first slice, and by how much the next one may be longer
BETWEEN_CHECKPOINTS = 20.0  # s
FIRST_WIDTH, WIDTH, RECORDED_WIDTH = 8, 64, 16  # runs in a group; frames wait in memory
WRITERS = 16
MOST_WAITING = 256  # runs that wait for others with as many steps left
MOST_GRAINS = 2_000_000  # in a group


def finish_runs(
    folder: SweepFolder, runs: Iterable[Run], execution: ExecutionOptions, on_progress: OnProgress
) -> dict[str, str]:
    """Carry out runs that are not finished to their end, each from where it is.

    A run that fails gets a result that says why, and the others go on. So they do if another process has
    a run, or its files cannot be used.

    Returns
    -------
    dict of str to str
        By the numbers of the runs that were not carried out to their end, why not.

    Raises
    ------
    OSError
        A file cannot be written.
    """
    left: dict[str, str] = {}
    starts: Iterable[Start] = map(Start, runs)
    if not execution.needs_folders and execution.device == "cpu":
        short = ShortRuns(folder, execution, on_progress)
        short.finish(runs)
        left, starts = short.left, short.long
    for group in _groups(folder, starts, execution, on_progress, left):
        _finish(group, execution, on_progress, left)
    return left


def _groups(
    folder: SweepFolder,
    starts: Iterable[Start],
    execution: ExecutionOptions,
    on_progress: OnProgress,
    left: dict[str, str],
) -> Iterator[list[SweepRun]]:
    """Gather runs with as many steps left."""
    waiting: dict[int, list[SweepRun]] = {}
    width, widest = FIRST_WIDTH, WIDTH if execution.fps is None else RECORDED_WIDTH
    with closing(_ahead(folder, starts, execution)) as begun, ExitStack() as held:
        held.callback(lambda: [held.push(run) for group in waiting.values() for run in group])
        for number, future in begun:
            run = future.result()
            if isinstance(run, str):
                left[str(number)] = run
                on_progress(1.0)
                continue
            group = waiting.setdefault(run.left, [])
            group.append(run)
            if len(group) >= width or sum(run.scene.n for run in group) >= MOST_GRAINS:
                yield waiting.pop(run.left)
                width = min(2 * width, widest)
            elif sum(map(len, waiting.values())) == MOST_WAITING:
                yield waiting.pop(max(waiting, key=lambda left: len(waiting[left])))
        while waiting:
            yield waiting.popitem()[1]


def _ahead(
    folder: SweepFolder, starts: Iterable[Start], execution: ExecutionOptions
) -> Generator[tuple[int, Future[SweepRun | str]]]:
    """Begin runs on another thread, while groups before them are carried out: some layouts take long."""
    begun: deque[tuple[int, Future[SweepRun | str]]] = deque()
    executor = ThreadPoolExecutor(1)
    try:
        for start in starts:
            begun.append((start.run.number, executor.submit(begin, folder, start, execution)))
            if len(begun) == WIDTH:
                yield begun.popleft()
        while begun:
            yield begun.popleft()
    finally:
        executor.shutdown(cancel_futures=True)
        for _, future in begun:
            if not future.cancelled() and isinstance(run := future.result(), SweepRun):
                run.__exit__()


def _finish(
    group: list[SweepRun], execution: ExecutionOptions, on_progress: OnProgress, left: dict[str, str]
) -> None:
    """Carry a group out to its end; the recordings are whole before there is a result."""
    with ExitStack() as held:
        for run in group:
            held.push(run)
        opened = _without_trouble(SweepRun.open, group, left)
        on_progress(len(group) - sum(run.left / run.options.steps for run in opened))
        if opened and opened[0].left > 0:
            _advance(opened, execution, on_progress)
        _write(SweepRun.finish, _without_trouble(SweepRun.complete, opened, left))


def _without_trouble(
    do: Callable[[SweepRun], str | None], group: list[SweepRun], left: dict[str, str]
) -> list[SweepRun]:
    """Do something with each run of a group, and return those with which nothing was wrong."""
    troubles = {run.folder.labels["run"]: do(run) for run in group}
    left |= {number: trouble for number, trouble in troubles.items() if trouble is not None}
    return [run for run in group if run.folder.labels["run"] not in left]


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
    """Run a batch in slices, record and measure, and save where its runs are."""
    pace, kept_at = FIRST_SLICE, perf_counter()
    whole = [run.options.steps for run in group]
    awaited = sum(run.left / run.options.steps for run in group)
    _look(group, batch)
    if any(run.is_recorded for run in group):
        _keep(group, batch)
    while going := [run for run in group if run.goes_on]:
        start = perf_counter()
        steps = min([pace, *(run.until_look for run in going)])
        due = [steps if run.goes_on else 0 for run in group]
        for k, summary in enumerate(batch.run(due)):
            group[k].count(summary, batch, k)
            on_progress(due[k] / whole[k])
            awaited -= due[k] / whole[k]
        _look(group, batch)
        now = perf_counter()
        pace = max(1, min(GROWTH * pace, int(SLICE / (now - start) * steps)))
        if now - kept_at > BETWEEN_CHECKPOINTS or not any(run.goes_on for run in group):
            _keep(group, batch)
            kept_at = now
    on_progress(awaited)  # of runs that failed, or met their criterion


def _look(group: list[SweepRun], batch: Batch) -> None:
    for k, run in enumerate(group):
        run.look(batch, k)


def _keep(group: list[SweepRun], batch: Batch) -> None:
    for k, run in enumerate(group):
        run.reach(batch.state(k))
    _write(SweepRun.keep, group)


def _write(write: Callable[[SweepRun], None], group: list[SweepRun]) -> None:
    """Write files of all runs side by side: most of the time is spent waiting for the disk."""
    with ThreadPoolExecutor(WRITERS) as writers:
        list(writers.map(write, group))
