"""The loop in which threads advance scenes, and the calling thread serves the requests of scenes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from warpgrains.solver.threads import run_threads

if TYPE_CHECKING:
    from warpgrains.solver.engine import Engine

SLIGHT = 2e4  # grains times iterations (0.2 ms) below which waking another thread costs more than it gains
OnProgress = Callable[[int], object]
"""Called from time to time with the number of steps that all scenes have done since its last call."""


def advance(engines: Sequence[Engine], threads: int, on_progress: OnProgress | None = None) -> None:
    """Do the submitted steps of all engines; a scene that fails stops, and the other scenes continue.

    At most `threads` CPU threads run; if a team shares each scene (`Engine.team`), all its threads run. The
    calling thread only polls these threads, so that an interrupt can cancel them. If the work is short
    (`Engine.is_brief`), the calling thread works, too. If the work is very short and no team shares a scene,
    it works alone. `on_progress` is also called at the end.
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
    has_failed = True
    try:
        going_on = True
        while going_on:
            by_thread = zip(*(engine.tasks(threads) for engine in engines), strict=True)
            tasks = [partial(_do, tasks) for tasks in by_thread]
            run_threads(tasks, None if is_brief else poll, cancel)
            going_on = sum(engine.service() for engine in engines) > 0
        poll()
        has_failed = False
    finally:
        for engine in engines:
            engine.finish_open_steps(has_failed)


def _left(engines: Sequence[Engine]) -> int:
    return sum(int(engine.left.sum()) for engine in engines)


def _do(tasks: Sequence[Callable[[], None]]) -> None:
    for work in tasks:
        work()
