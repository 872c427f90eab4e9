"""How fast a step is, beside what it is compared with, in one run: CSV, medians.

    python -m tests.bench.step -o tests/bench/results/step.csv

Wants a machine with nothing else to do, Linux, and gcc.
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
from typing import Any

import numpy as np

from warpgrains import Scene, Simulation

from . import against_c
from .flow import SOLVED, continued, flowing, splashing
from .piles import ITERATIONS, settled_pile
from .rows import SPEEDUP, Subject, command_line, in_turn, publish, row, say, seconds

Row = dict[str, str]
Make = Callable[[int | None], Simulation]
PLAIN = {"method": "gauss-seidel", "stop": "zeta", "tolerance": 0.0, "max_iterations": ITERATIONS}
FLOWING = {100: "<= 0.06", 1_000: "<= 0.9", 5_000: "<= 8", 10_000: "<= 20"}  # ms a step
LARGE = 100_000
IDLE = 5  # steps: an idle core needs a while to come to speed
FIRST_RUNS = 3
LOOP = "import os, sys; os.sched_setaffinity(0, {int(sys.argv[1])})\nwhile True: pass"


def moving(options: argparse.Namespace) -> Iterator[Row]:
    """Whole runs of the common flowing scene, and what their steps have of it."""
    for n in sizes(FLOWING, options):
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
    """Two threads, and two simulations at once, against one thread, on quiet and busy cores; same bits."""
    for n in sizes((10_000, LARGE), options):
        pile, flow = settled_pile(n, options.cache), splashing(n, options.cache)
        cases: dict[str, Make] = {
            f"{ITERATIONS} plain sweeps, {pile.kind}": partial(pile.simulation, order="color"),
            f"{ITERATIONS} accelerated sweeps, {pile.kind}": partial(
                pile.simulation, order="color", method="accelerated"
            ),
            f"{ITERATIONS} plain sweeps, flowing": partial(continued, *flow, **PLAIN),
            "accelerated to 1e-2 m/s, flowing": partial(continued, *flow),
        }
        for (name, make), loops in product(cases.items(), (0, 1)):
            with _endless_loops(loops):
                yield from _against_one_thread(
                    f"a step, {name}{', busy cores' * loops}", n, make, options.repeats
                )


def _against_one_thread(name: str, n: int, make: Make, repeats: int) -> Iterator[Row]:
    one, two, *apart = (make(count) for count in (1, 2, 1, 1))
    ways = [partial(_ms_a_step, one), partial(_ms_a_step, two), partial(_ms_a_step_of_both, apart)]
    alone, team, both = in_turn(repeats, *ways)
    for other in (two, *apart):
        assert np.array_equal(one.position, other.position)
        assert np.array_equal(one.velocity, other.velocity)
    yield row(Subject(name, n, "color", "2"), team, "ms", "1 thread", alone, SPEEDUP, ">= 1")
    subject = Subject(f"{name}, two separate simulations", n, "color", "1 + 1")
    yield row(subject, both, "ms", "1 thread", alone, SPEEDUP)


def _ms_a_step(simulation: Simulation) -> float:
    simulation.advance(IDLE)
    steps = min(max(5, 300_000 // simulation.scene.n), 100)
    return seconds(partial(simulation.advance, steps)) / steps * 1e3


def _ms_a_step_of_both(simulations: list[Simulation]) -> float:
    with ThreadPoolExecutor(2) as pool:
        return sum(pool.map(_ms_a_step, simulations)) / 4.0


@contextmanager
def _endless_loops(count: int) -> Iterator[None]:
    """Keep every core busy with so many processes."""
    own = sorted(os.sched_getaffinity(0))
    loops = [subprocess.Popen([sys.executable, "-c", LOOP, str(core)]) for core in own * count]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def start(options: argparse.Namespace) -> Iterator[Row]:
    """The course's scene by command, in a process that finds no kernel compiled before."""
    taken = [_seconds_of_a_first_run() for _ in range(min(FIRST_RUNS, options.repeats))]
    subject = Subject("first run of a new kind of scene, kernels compiled in it", Scene.load("annulus").n)
    yield row(subject, taken, "s", target="<= 3")


def _seconds_of_a_first_run() -> float:
    command = [sys.executable, "-m", "warpgrains", "run", "annulus"]
    with TemporaryDirectory() as cache:
        environment = {**os.environ, "WARP_CACHE_PATH": cache}
        run = partial(subprocess.run, command, env=environment, cwd=cache, check=True, capture_output=True)
        return seconds(run)


def sizes(wanted: Any, options: argparse.Namespace) -> list[int]:
    return sorted({min(n, options.largest) for n in wanted})


PARTS: dict[str, Callable[[argparse.Namespace], Iterator[Row]]] = {
    "sweeps": against_c.sweeps,
    "steps": against_c.steps,
    "course": against_c.course,
    "moving": moving,
    "threads": threads,
    "start": start,
}


def main(arguments: list[str] | None = None) -> None:
    parser = command_line("step", __doc__)
    parser.add_argument("--largest", type=int, default=LARGE, help=f"grains at most (default: {LARGE:,})")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), help="what to measure")
    options = parser.parse_args(arguments)
    say(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.2f}, {options.repeats} repeats")
    publish((cells for part in options.only for cells in PARTS[part](options)), options.output)


if __name__ == "__main__":
    main()
