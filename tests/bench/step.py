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
from dataclasses import replace
from functools import partial
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from warpgrains import Scene, Simulation
from warpgrains.solver.tuning import paying_threads

from . import against_c
from .flow import SOLVED, continued, flowing, splashing
from .piles import ITERATIONS, advance, settled_pile
from .rows import SPEEDUP, Subject, command_line, in_turn, publish, row, say, seconds

Row = dict[str, str]
Make = Callable[[int | None], Simulation]
PLAIN = {"method": "gauss-seidel", "stop": "zeta", "tolerance": 1e-12, "max_iterations": ITERATIONS}
FLOWING = {100: "<= 0.06", 1_000: "<= 0.9", 5_000: "<= 8", 10_000: "<= 20"}  # ms a step
LARGE = 100_000
IDLE = 5  # steps: an idle core needs a while to come to speed
FIRST_RUNS = 3
LOOP = "import os, sys; os.sched_setaffinity(0, {int(sys.argv[1])})\nwhile True: pass"
LOADS = (0, 1, 2)  # endless loops on every core
BUSY = (  # grains, iterations of a step, threads
    (25, 326, 4),
    (1_000, 100, None),
    (10_000, 50, None),
    (25_000, 50, 2),
)


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
    """Two threads, the default, and two simulations at once, against one thread; same bits."""
    for n in sizes((1_000, 10_000, LARGE), options):
        pile = settled_pile(n, options.cache)
        subject = Subject(f"one step of {ITERATIONS} iterations, {pile.kind}", n, "color")
        yield from _against_one_thread(subject, partial(pile.simulation, order="color"), options, ">= 1.6")
        flow = splashing(n, options.cache)
        subject = Subject(f"one step of {ITERATIONS} iterations, flowing", n, "color")
        make = partial(continued, *flow, order="color", **PLAIN)
        yield from _against_one_thread(subject, make, options, ">= 1.6")
        subject = Subject("one flowing step, accelerated to 1e-2 m/s", n, "color")
        yield from _against_one_thread(subject, partial(continued, *flow), options, ">= 1.5")


def _against_one_thread(
    subject: Subject, make: Make, options: argparse.Namespace, target: str
) -> Iterator[Row]:
    simulations = [make(count) for count in (1, 2, None)]
    apart = [make(1) for _ in range(2)]
    measures = [partial(_ms_a_step, simulation) for simulation in simulations]
    one, two, chosen, both = in_turn(options.repeats, *measures, partial(_ms_a_step_of_both, apart))
    first, *others = [*simulations, *apart]
    for other in others:
        assert np.array_equal(first.position, other.position)
        assert np.array_equal(first.velocity, other.velocity)
    aim = target if subject.n == LARGE else ""
    default = f"{paying_threads(first.scene)} (default)"
    yield row(replace(subject, threads="2"), two, "ms", "1 thread", one, SPEEDUP, aim)
    yield row(replace(subject, threads=default), chosen, "ms", "1 thread", one, SPEEDUP, ">= 0.95")
    machine = replace(subject, name=f"{subject.name}, by two separate simulations at once", threads="1 + 1")
    yield row(machine, both, "ms", "1 thread", one, SPEEDUP)


def _ms_a_step(simulation: Simulation) -> float:
    simulation.advance(IDLE)
    steps = min(max(5, 100_000 // simulation.scene.n), 100)
    return seconds(partial(simulation.advance, steps)) / steps * 1e3


def _ms_a_step_of_both(simulations: list[Simulation]) -> float:
    with ThreadPoolExecutor(2) as pool:
        return sum(pool.map(_ms_a_step, simulations)) / 4.0


def busy(options: argparse.Namespace) -> Iterator[Row]:
    """A team against one thread, on cores that other processes use as well."""
    for loops in LOADS:
        for wanted, iterations, count in BUSY:
            n = min(wanted, options.largest)
            pile, steps = settled_pile(n, options.cache), 16 if wanted <= 1_000 else 50
            make = partial(pile.simulation, order="color", max_iterations=iterations)

            def taken(threads: int | None, make: Make = make, steps: int = steps) -> float:
                return seconds(partial(advance, make(threads), steps))

            with _endless_loops(loops):
                team, one = in_turn(options.repeats, partial(taken, count), partial(taken, 1))
            name = f"{steps} steps of {iterations} iterations, {pile.kind}, {loops} endless loops a core"
            subject = Subject(name, n, "color", "default" if count is None else str(count))
            yield row(subject, team, "s", "1 thread", one, target="<= 1.5")


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
    "busy": busy,
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
