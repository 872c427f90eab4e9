"""Threads on a busy machine: a team, compared with one thread, on cores that other processes use as well."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

from warpgrains import Simulation

from .options import Options
from .piles import Pile, settled_pile
from .rows import Subject, row
from .timing import in_turn, seconds

LOOP = "import os, sys; os.sched_setaffinity(0, {int(sys.argv[1])})\nwhile True: pass"
LOADS = (0, 1, 2)  # endless loops on every core
CASES = (  # grains, iterations of a step, order, threads
    (25, 326, "color", 4),
    (1_000, 100, "color", None),
    (10_000, 50, "color", None),
    (25_000, 50, "color", 2),
)


def busy(options: Options) -> Iterator[dict[str, str]]:
    """Few grains on more threads than there are cores, more on as many as a simulation chooses."""
    for loops in LOADS:
        for wanted, iterations, order, count in CASES:
            n = min(wanted, options.largest)
            settled = settled_pile(n, options.cache)
            steps = 16 if n <= 1_000 else 50
            shown = f"{steps} steps of {iterations} iterations, {settled.kind}, {loops} endless loops a core"
            changes = {"order": order, "max_iterations": iterations}
            with endless_loops(loops):
                team, one = in_turn(
                    options.repeats,
                    *(partial(_seconds, settled, steps, threads, changes) for threads in (count, 1)),
                )
            subject = Subject(shown, n, order, "default" if count is None else str(count))
            yield row(subject, team, "s", "1 thread", one, target="<= 1.5")


def _seconds(settled: Pile, steps: int, threads: int | None, changes: dict[str, object]) -> float:
    """Return how long a new simulation takes for some steps."""
    simulation: Simulation = settled.simulation(threads, **changes)
    return seconds(partial(simulation.advance, steps))


@contextmanager
def endless_loops(count: int) -> Iterator[None]:
    """Keep every core busy with so many processes."""
    own = sorted(os.sched_getaffinity(0))
    loops = [subprocess.Popen([sys.executable, "-c", LOOP, str(core)]) for core in own * count]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()
