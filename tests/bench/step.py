"""How fast a step is, beside what it is compared with, in one run: CSV, medians.

    python -m tests.bench.step -o tests/bench/results/step.csv

Wants a machine with nothing else to do, Linux, and gcc.
"""

import argparse
import os
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from warpgrains.warp_start import start_warp

from . import accelerated, against_c, busy, lists, moving, scaling, solo, threads
from .options import Options
from .rows import Table, open_table
from .timing import say, seconds

PARTS: dict[str, Callable[[Options], Iterator[dict[str, str]]]] = {
    "sweeps": against_c.sweeps,
    "steps": against_c.steps,
    "course": against_c.course,
    "solo": solo.solo,
    "compiling": solo.compiling,
    "lists": lists.lists,
    "moving": moving.moving,
    "threads": threads.threads,
    "busy": busy.busy,
    "costs": scaling.costs,
    "segments": scaling.segments,
    "memory": scaling.memory,
    "accelerated": accelerated.accelerated,
}


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Read the command line."""
    summary = "Measure how fast a step is, beside what it is compared with."
    parser = argparse.ArgumentParser(prog="python -m tests.bench.step", description=summary)
    parser.add_argument("-o", "--output", type=Path, help="CSV file (default: standard output)")
    parser.add_argument("--quick", action="store_true", help="3 repeats, and no pile above 100,000 grains")
    parser.add_argument("--repeats", type=int, help="values that a median is taken of (default: 5)")
    parser.add_argument("--largest", type=int, help="grains of the largest pile (default: 1,000,000)")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), help="what to measure")
    cache = Path(tempfile.gettempdir()) / "warpgrains-bench"
    parser.add_argument("--cache", type=Path, default=cache, help=f"settled piles (default: {cache})")
    return parser.parse_args(arguments)


def options_of(chosen: argparse.Namespace) -> Options:
    """Return how much is measured."""
    repeats, largest = (3, 100_000) if chosen.quick else (5, 1_000_000)
    return Options(chosen.repeats or repeats, chosen.largest or largest, chosen.cache)


def main(arguments: list[str] | None = None) -> None:
    """Measure, and write the figures down one by one."""
    chosen = parse(arguments)
    start_warp()
    options = options_of(chosen)
    say(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.2f}, {options.repeats} repeats")
    with open_table(chosen.output) as table:
        for part in chosen.only:
            taken = seconds(partial(_measure, part, options, table))
            say(f"{part}: {taken:.1f} s")


def _measure(part: str, options: Options, table: Table) -> None:
    for cells in PARTS[part](options):
        say("  " + ", ".join(filter(None, cells.values())))
        table.add(cells)


if __name__ == "__main__":
    main()
