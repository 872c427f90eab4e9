"""Times of whole runs, of steps by one and by two threads, and of a first run.

Steps are timed on idle cores, and on cores that are kept busy by other processes.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from itertools import product
from tempfile import TemporaryDirectory

import numpy as np

from warpgrains import Scene, Simulation

from .flow import ITERATIONS, SOLVED, SWEPT, continued, flowing, settled_pile, splashing
from .rows import SPEEDUP, Row, Subject, in_turn, row, seconds

FLOWING = {100: "<= 0.06", 1_000: "<= 0.9", 5_000: "<= 8", 10_000: "<= 20"}  # targets by grains [ms per step]
SHARED = 10_000, 100_000  # grains of the scenes for two threads
IDLE = 5  # steps before timing, because an idle core starts slowly
FIRST_RUNS = 3
LOOP = "import os, sys; os.sched_setaffinity(0, {int(sys.argv[1])})\nwhile True: pass"


def moving(options: argparse.Namespace) -> Iterator[Row]:
    """Yield rows for whole runs of the flow: time, iterations and new lists per step, and worst overlap."""
    for n in options.grains or FLOWING:
        scene = flowing(n, **SOLVED)
        simulations = [Simulation(scene, threads=1) for _ in range(options.repeats)]
        simulations[0].compile()
        done = [simulation.run() for simulation in simulations]
        taken = [summary.seconds / summary.steps * 1e3 for summary in done]
        subject = partial(Subject, n=n, order="color")
        yield row(subject("a flowing step, accelerated to 1e-2 m/s"), taken, "ms", target=FLOWING.get(n, ""))
        yield row(subject("worst overlap of it"), [done[0].overlap / scene.smallest_radius], "radii")
        yield row(subject("iterations of it"), [done[0].iterations_mean], "")
        yield row(subject("lists of it"), [done[0].rebuilds / done[0].steps], "")


def threads(options: argparse.Namespace) -> Iterator[Row]:
    """Yield times of a step by two threads, and by two simulations at the same time, on idle and busy cores.

    All are compared with one thread.
    """
    for n in options.grains or SHARED:
        kind, *pile = settled_pile(n, options.cache)
        flow = splashing(n, options.cache)
        cases = {
            f"{ITERATIONS} plain iterations, {kind}": partial(continued, *pile, order="color"),
            f"{ITERATIONS} accelerated iterations, {kind}": partial(
                continued, *pile, order="color", method="accelerated"
            ),
            f"{ITERATIONS} plain iterations, flowing": partial(continued, *flow, **SWEPT),
            "accelerated to 1e-2 m/s, flowing": partial(continued, *flow),
        }
        for (name, make), loops in product(cases.items(), (0, 1)):
            with _endless_loops(loops):
                yield from _against_one_thread(f"a step, {name}{', busy cores' * loops}", n, make, options)


def _against_one_thread(
    name: str, n: int, make: Callable[..., Simulation], options: argparse.Namespace
) -> Iterator[Row]:
    steps = options.steps or min(max(5, 300_000 // n), 100)

    def ms_a_step(simulation: Simulation) -> float:
        simulation.advance(IDLE)
        return seconds(partial(simulation.advance, steps)) / steps * 1e3

    def ms_a_step_of_both() -> float:
        with ThreadPoolExecutor(2) as pool:
            return sum(pool.map(ms_a_step, apart)) / 4.0

    one, two, *apart = (make(threads=count) for count in (1, 2, 1, 1))
    alone, team, both = in_turn(
        options.repeats, partial(ms_a_step, one), partial(ms_a_step, two), ms_a_step_of_both
    )
    for other in (two, *apart):
        assert np.array_equal(one.position, other.position)
        assert np.array_equal(one.velocity, other.velocity)
    yield row(Subject(name, n, "color", "2"), team, "ms", "1 thread", alone, SPEEDUP, ">= 1")
    subject = Subject(f"{name}, two separate simulations", n, "color", "1 + 1")
    yield row(subject, both, "ms", "1 thread", alone, SPEEDUP)


@contextmanager
def _endless_loops(count: int) -> Iterator[None]:
    """Keep every core busy with `count` processes during the ``with`` block."""
    own = sorted(os.sched_getaffinity(0))
    loops = [subprocess.Popen([sys.executable, "-c", LOOP, str(core)]) for core in own * count]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def first_run(options: argparse.Namespace) -> Iterator[Row]:
    """Yield the time of `warpgrains run annulus` with an empty cache, so that it compiles all kernels."""
    taken = [_seconds_of_a_first_run() for _ in range(min(FIRST_RUNS, options.repeats))]
    subject = Subject("first run of a new kind of scene, kernels compiled in it", Scene.load("annulus").n)
    yield row(subject, taken, "s", target="<= 3")


def _seconds_of_a_first_run() -> float:
    command = [sys.executable, "-m", "warpgrains", "run", "annulus"]
    with TemporaryDirectory() as cache:
        environment = {**os.environ, "WARP_CACHE_PATH": cache}
        run = partial(subprocess.run, command, env=environment, cwd=cache, check=True, capture_output=True)
        return seconds(run)
