"""Runs of a sweep in one process, in groups.

While one group is advanced, another thread prepares the next.

Runs without a folder come first, in groups of thousands. The results of a group are one shard, written before
the next group is advanced. Runs that take longer than `SHORT` or fail continue with a folder; on request
every run has one. These runs advance in slices of about a second, and save checkpoints at intervals and at
the end, so that a killed process loses little.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from itertools import islice
from math import inf
from time import perf_counter
from typing import Any

from warpgrains.batch.resident import ResidentSets
from warpgrains.errors import SimulationError
from warpgrains.solver.threads import cores
from warpgrains.solver.tuning import find_device
from warpgrains.sweep.execution import ExecutionOptions, OnFraction
from warpgrains.sweep.folder import SweepFolder
from warpgrains.sweep.grouped_run import GroupedRun, ResumePoint
from warpgrains.sweep.short import ShortRuns
from warpgrains.sweep.sizes import next_size
from warpgrains.sweep.sweep import Run

GROUP, SLICE = 1.0, 1.0  # intended durations of a group, and of a slice of a group with folders [s]
FIRST_SLICE = 4  # steps
BETWEEN_CHECKPOINTS = 20.0  # s
FIRST_WIDTH, LEAST_WIDTH, WIDTH, RECORDED_WIDTH = 16, 16, 64, 16  # runs in a group; frames wait in memory
MOST_GRAINS = 200_000  # in a group
WRITERS = 16


def finish_runs(
    folder: SweepFolder, runs: Iterable[Run], execution: ExecutionOptions, on_progress: OnFraction
) -> dict[int, str]:
    """Execute unfinished runs to their ends, each from its last checkpoint.

    A run that fails has the reason as its result, and the other runs continue. They also continue if another
    process has a run, or its files cannot be used.

    Returns
    -------
    dict of int to str
        Reasons why runs are unfinished, by their numbers.

    Raises
    ------
    OSError
        A file cannot be written.
    """
    left: dict[int, str] = {}
    points: Iterable[ResumePoint] = map(ResumePoint, runs)
    with ExitStack() as held:
        if not execution.needs_folders and execution.device == "cpu":
            short = ShortRuns(folder, execution, on_progress, held)
            _in_groups(short, points)
            left, points = short.left, short.longer
        others = FolderRuns(folder, execution, on_progress)
        _in_groups(others, points)
    return left | others.left


def _in_groups(runs: ShortRuns | FolderRuns, points: Iterable[ResumePoint]) -> None:
    """Execute runs in groups. Another thread prepares each group while the previous one is advanced."""
    waiting, width = iter(points), FIRST_WIDTH
    with ExitStack() as all_held, ThreadPoolExecutor(1) as ahead:

        def begin_next() -> tuple[Future[Any], ExitStack] | None:
            chunk, held = list(islice(waiting, width)), all_held.enter_context(ExitStack())
            return (ahead.submit(runs.begin, chunk, held), held) if chunk else None

        following = begin_next()
        while following is not None:
            future, held = following
            group = future.result()
            following, start = begin_next(), perf_counter()
            with held:
                grains = runs.carry_out(group)
            most = min(runs.widest, MOST_GRAINS * width // max(1, grains))
            width = next_size(width, perf_counter() - start, GROUP, most, runs.narrowest)


class FolderRuns:
    """Runner for runs with a folder each.

    Parameters
    ----------
    folder, execution, on_progress
        As for `finish_runs`.

    Attributes
    ----------
    left : dict of int to str
        Reasons why runs are unfinished, by their numbers.
    """

    def __init__(self, folder: SweepFolder, execution: ExecutionOptions, on_progress: OnFraction):
        self.left: dict[int, str] = {}
        self._folder, self._execution, self._on_progress = folder, execution, on_progress
        self._threads, self._device = execution.threads or cores(), find_device(execution.device)
        self.widest = WIDTH if execution.fps is None else RECORDED_WIDTH
        self.narrowest = min(LEAST_WIDTH, self.widest)

    def begin(self, points: list[ResumePoint], held: ExitStack) -> list[GroupedRun]:
        """Return the runs that can continue; their locks and outputs are entered into `held`."""
        begun = [(point, GroupedRun.begin(self._folder, point, self._execution, held)) for point in points]
        self.left |= {point.run.number: run for point, run in begun if isinstance(run, str)}
        runs = [run for _, run in begun if not isinstance(run, str)]
        self._on_progress(len(points) - len(runs))
        return runs

    def carry_out(self, runs: list[GroupedRun]) -> int:
        """Advance runs to their ends, complete their recordings and save their results.

        Returns
        -------
        int
            Total number of grains of the runs.
        """
        self._on_progress(sum(run.progress for run in runs))
        self._advance([run for run in runs if run.has_steps_left])
        troubles = [(run, run.complete()) for run in runs]
        self.left |= {run.folder.number: trouble for run, trouble in troubles if trouble is not None}
        _write(GroupedRun.finish, [run for run, trouble in troubles if trouble is None])
        return sum(run.scene.n for run in runs)

    def _advance(self, runs: list[GroupedRun]) -> None:
        """Advance runs to their ends. A run that does not fit in memory even alone has failed."""
        if not runs:
            return
        try:
            sets = ResidentSets([run.scene for run in runs], self._device, self._threads)
        except SimulationError as error:
            if len(runs) > 1:
                for run in runs:
                    self._advance([run])
            else:
                self._on_progress(1.0 - runs[0].progress)
                runs[0].error = str(error)
            return
        for k, run in enumerate(runs):
            if run.statistics.steps > 0:
                sets.restore(k, run.state())
        self._in_slices(runs, sets)

    def _in_slices(self, runs: list[GroupedRun], sets: ResidentSets) -> None:
        """Advance runs in slices; record, measure and save checkpoints between slices."""
        slice_steps, kept_at = FIRST_SLICE, perf_counter()
        for run in runs:
            run.observe(run)
        if any(run.has_frames_left for run in runs):
            _save_checkpoints(runs, sets)
        while any(run.has_steps_left for run in runs):
            start, before = perf_counter(), sum(run.progress for run in runs)
            steps = [min(slice_steps, run.steps_to_output) if run.has_steps_left else 0 for run in runs]
            endings = [(run.until, run.statistics) for run in runs if run.until is not None]
            for resident in sets.advance(steps, lambda _: None, endings or None):
                for k, scene in resident.scenes.items():
                    if steps[k] > 0:
                        runs[k].count(resident.outcomes.done(k))
                        runs[k].observe(scene)
            self._on_progress(sum(run.progress for run in runs) - before)
            now = perf_counter()
            slice_steps = next_size(max(steps), now - start, SLICE, inf)
            if now - kept_at > BETWEEN_CHECKPOINTS or not any(run.has_steps_left for run in runs):
                _save_checkpoints(runs, sets)
                kept_at = now


def _save_checkpoints(runs: list[GroupedRun], sets: ResidentSets) -> None:
    for k, run in enumerate(runs):
        run.set_state(sets.state(k))
    _write(GroupedRun.save_checkpoint, runs)


def _write(write: Callable[[GroupedRun], None], runs: list[GroupedRun]) -> None:
    """Write files of all runs in parallel threads, because most of the time is spent waiting for the disk."""
    with ThreadPoolExecutor(WRITERS) as writers:
        list(writers.map(write, runs))
