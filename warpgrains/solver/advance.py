"""Scenes advanced by threads, and what they wait for done by the thread that called."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from warpgrains.solver.threads import side_by_side

if TYPE_CHECKING:
    from warpgrains.solver.engine import Engine

OnProgress = Callable[[int], object]
"""Told now and then how many steps more have been done."""


def advance(engines: Sequence[Engine], threads: int, on_progress: OnProgress | None = None) -> None:
    """Do the steps that were submitted; a scene that fails stops, and the others go on.

    The caller's thread watches over them, so that an interrupt reaches them; what is brief it does by itself.

    Parameters
    ----------
    engines : sequence of Engine
    threads : int
        On a CPU; teams of more than one must be as large.
    on_progress : callable, optional
        Told now and then, and at the end, how many steps more have been done.
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
