"""Advancing scenes with threads, while the calling thread serves the requests of the scenes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from warpgrains.solver.threads import side_by_side

if TYPE_CHECKING:
    from warpgrains.solver.engine import Engine

OnProgress = Callable[[int], object]
"""Called occasionally with the number of steps done since its last call."""


def advance(engines: Sequence[Engine], threads: int, on_progress: OnProgress | None = None) -> None:
    """Do the submitted steps; a scene that fails stops, and the other scenes continue.

    The calling thread polls the others, so that an interrupt can cancel them. It does short work alone.

    Parameters
    ----------
    engines : sequence of Engine
    threads : int
        Number of CPU threads; it must equal the team size of the engines, unless that is 1.
    on_progress : callable, optional
        Called occasionally and at the end, with the number of steps done since its last call.
    """
    left = 0 if on_progress is None else _left(engines)

    def glance() -> None:
        nonlocal left
        if on_progress is not None:
            before, left = left, _left(engines)
            on_progress(before - left)

    def halt() -> None:
        for engine in engines:
            engine.halt()

    is_brief = all(engine.is_brief for engine in engines)
    try:
        going_on = True
        while going_on:
            by_thread = zip(*(engine.works(threads) for engine in engines), strict=True)
            works = [partial(_do, works) for works in by_thread]
            side_by_side(works, None if is_brief else glance, halt)
            going_on = sum(engine.service() for engine in engines) > 0
        glance()
    finally:
        for engine in engines:
            engine.finish_open_steps()


def _left(engines: Sequence[Engine]) -> int:
    return sum(int(engine.left.sum()) for engine in engines)


def _do(works: Sequence[Callable[[], None]]) -> None:
    for work in works:
        work()
