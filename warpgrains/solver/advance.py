"""Advancing scenes with threads, while the calling thread serves the requests of the scenes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from warpgrains.solver.threads import run_threads

if TYPE_CHECKING:
    from warpgrains.solver.engine import Engine

SLIGHT = 2e4  # grains times iterations, 0.2 ms: another thread would gain less than its waking costs
OnProgress = Callable[[int], object]
"""Called occasionally with the number of steps done since its last call."""


def advance(engines: Sequence[Engine], threads: int, on_progress: OnProgress | None = None) -> None:
    """Do the submitted steps; a scene that fails stops, and the other scenes continue.

    At most `threads` CPU threads advance scenes that no team shares; teams choose their own (`Engine.tasks`).
    The calling thread polls them, so that an interrupt can cancel them. In short work it takes part, and it
    does the shortest alone, but for scenes that a team shares. `on_progress` is called at the end, too.
    """
    left = 0 if on_progress is None else _left(engines)

    def poll() -> None:
        nonlocal left
        if on_progress is not None:
            before, left = left, _left(engines)
            on_progress(before - left)

    def cancel(abandon: bool) -> None:
        for engine in engines:
            engine.cancel(abandon)

    is_brief = all(engine.is_brief for engine in engines)
    if is_brief and threads > 1 and sum(engine.work() for engine in engines) < SLIGHT:
        threads = 1
    try:
        going_on = True
        while going_on:
            by_thread = zip(*(engine.tasks(threads) for engine in engines), strict=True)
            tasks = [partial(_do, tasks) for tasks in by_thread]
            run_threads(tasks, None if is_brief else poll, cancel)
            going_on = sum(engine.service() for engine in engines) > 0
        poll()
    finally:
        for engine in engines:
            engine.finish_open_steps()


def _left(engines: Sequence[Engine]) -> int:
    return sum(int(engine.left.sum()) for engine in engines)


def _do(tasks: Sequence[Callable[[], None]]) -> None:
    for work in tasks:
        work()
