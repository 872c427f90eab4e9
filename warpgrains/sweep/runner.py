"""Runs of a sweep in one process, in groups.

While one group is advanced, another thread prepares the next.

Runs without a folder come first, in groups of thousands (short.py). Runs that take longer than `SHORT` or
fail continue with a folder (long.py); on request every run has one.
"""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing
from itertools import islice
from time import perf_counter
from typing import Any

from warpgrains.sweep.execution import ExecutionOptions, OnFraction, next_size
from warpgrains.sweep.long import LongRunner, ResumePoint
from warpgrains.sweep.short import ShortRunner
from warpgrains.sweep.sweep import Run
from warpgrains.sweep.sweep_folder import SweepFolder

GROUP = 1.0  # intended duration of a group [s]
FIRST_WIDTH = 16  # runs in a group
MOST_GRAINS = 200_000  # in a group


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
    with ExitStack() as ended:
        if not execution.needs_folders and execution.device == "cpu":
            short = ended.enter_context(closing(ShortRunner(folder, execution, on_progress)))
            _in_groups(short, points)
            left, points = short.left, short.longer
        others = LongRunner(folder, execution, on_progress)
        _in_groups(others, points)
    return left | others.left


def _in_groups(runs: ShortRunner | LongRunner, points: Iterable[ResumePoint]) -> None:
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
