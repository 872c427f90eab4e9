"""OS threads that work side by side, while the caller's thread watches over them."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait

import warp as wp

from warpgrains.kernels.threads import TeamRecord

GLANCE = 0.1  # seconds between two looks at how far they are


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def team_of(size: int) -> list[TeamRecord]:
    """Return a team of so many CPU threads, as each of them sees it."""
    shared = {
        "arrivals": wp.zeros(1, dtype=wp.int64, device="cpu"),
        "ended": wp.zeros(8 * size, dtype=wp.int64, device="cpu"),
        "scene": wp.zeros(1, dtype=wp.int32, device="cpu"),
        "going_on": wp.zeros(1, dtype=wp.int32, device="cpu"),
    }
    team = []
    for rank in range(size):
        record = TeamRecord()
        record.rank, record.size = rank, size
        for name, array in shared.items():
            setattr(record, name, array)
        team.append(record)
    return team


def side_by_side(
    works: Sequence[Callable[[], None]],
    glance: Callable[[], None] | None = None,
    halt: Callable[[], None] | None = None,
) -> None:
    """Do works on a thread each; one that nobody watches is done on the caller's.

    Parameters
    ----------
    works : sequence of callable
    glance : callable, optional
        Called now and then, and at the end.
    halt : callable, optional
        Called once if this thread is interrupted: it asks the works to end soon. They are waited for.
    """
    if len(works) == 1 and glance is None:
        return works[0]()
    with ThreadPoolExecutor(len(works)) as executor:
        futures = [executor.submit(work) for work in works]
        try:
            while wait(futures, timeout=GLANCE).not_done:
                if glance is not None:
                    glance()
        except BaseException:
            if halt is not None:
                halt()
            raise
    for future in futures:
        future.result()
    if glance is not None:
        glance()
