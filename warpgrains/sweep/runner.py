"""Runs of a sweep in one process, in groups.

While one group is advanced, another thread prepares the next.

Runs without a folder come first, in groups of thousands (short.py). Those that need a folder, see
`ShortRunner`, continue with one (long.py); on request, and on a GPU, every run has one.
"""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from itertools import islice
from time import perf_counter
from typing import Protocol, TypeVar

from warpgrains.sweep.execution import ExecutionOptions, OnFraction, next_size
from warpgrains.sweep.long import LongRunner
from warpgrains.sweep.short import ShortRunner
from warpgrains.sweep.sweep import Run
from warpgrains.sweep.sweep_folder import SweepFolder

GROUP = 1.0  # intended duration of a group [s]
FIRST_WIDTH = 16  # runs in a group
MOST_GRAINS = 200_000  # in a group

Group = TypeVar("Group")


class Runner(Protocol[Group]):
    """Interface of the classes that execute groups of runs."""

    @property
    def narrowest(self) -> int:
        """Least number of runs in a group, unless their grains are too many."""

    @property
    def widest(self) -> int:
        """Largest number of runs in a group."""

    def prepare(self, runs: list[Run]) -> Group:
        """Prepare a group. Another thread calls it while the previous group is advanced."""

    def carry_out(self, group: Group) -> int:
        """Advance a group and save its results; return its number of grains."""


def finish_runs(
    folder: SweepFolder, runs: Iterable[Run], execution: ExecutionOptions, on_progress: OnFraction
) -> dict[int, str]:
    """Execute unfinished runs from their checkpoints; return why some are unfinished, by number.

    A run that fails has the reason as its result. Runs that another process has, or without usable files, are
    left.
    """
    reasons: dict[int, str] = {}
    with ExitStack() as held:
        if not execution.needs_folders:
            short = held.enter_context(ShortRunner(folder, execution, on_progress))
            _in_groups(short, runs)
            reasons, runs = short.reasons, short.longer
        long = LongRunner(folder, execution, on_progress, held)
        _in_groups(long, runs)
    return reasons | long.reasons


def _in_groups(runner: Runner[Group], runs: Iterable[Run]) -> None:
    """Execute runs in groups, sized by the last; a thread prepares each while the previous one advances."""
    waiting = iter(runs)
    with ThreadPoolExecutor(1) as ahead:

        def prepare_next(width: int) -> tuple[int, Future[Group]] | None:
            chunk = list(islice(waiting, width))
            return (len(chunk), ahead.submit(runner.prepare, chunk)) if chunk else None

        width = FIRST_WIDTH
        following = prepare_next(width)
        while following is not None:
            size, future = following
            group = future.result()
            following, start = prepare_next(width), perf_counter()
            grains = runner.carry_out(group)
            most = min(runner.widest, MOST_GRAINS * size // max(1, grains))
            width = next_size(size, perf_counter() - start, GROUP, most, runner.narrowest)
