"""Timing, and CSV files with a row per figure, and with version, commit, date and machine."""

import argparse
import csv
import os
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from datetime import date
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from statistics import median
from time import perf_counter
from typing import NamedTuple

from warpgrains import __version__
from warpgrains.base.warp_start import start_warp

Row = dict[str, str]
STAMP = ("version", "commit", "date", "processor")
"""Last columns of every CSV file."""
SLOWDOWN, SPEEDUP = "median / its median", "its median / median"


def seconds(work: Callable[[], object]) -> float:
    start = perf_counter()
    work()
    return perf_counter() - start


def in_turn(repeats: int, *measure: Callable[[], float]) -> list[list[float]]:
    """Call all functions once in each of `repeats` rounds, so that noise of the machine affects all of them.

    Returns a list for each function, with the values that it returned.
    """
    rounds = [[take() for take in measure] for _ in range(repeats)]
    return [list(values) for values in zip(*rounds, strict=True)]


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


class Subject(NamedTuple):
    """Subject of a measurement: its name, the number of grains, the order of contacts, and the threads."""

    name: str
    n: int
    order: str = "sequential"
    threads: str = "1"


def row(
    subject: Subject,
    values: Sequence[float],
    unit: str,
    compared_with: str = "",
    its_values: Sequence[float] = (),
    ratio_is: str = SLOWDOWN,
    target: str = "",
) -> Row:
    """Return a row with the median of the measured `values`, that of `its_values`, and the ratio of both.

    `its_values` are those of the program `compared_with`. `ratio_is` says which median is divided by which.
    `target` is the bound that the ratio or the median should satisfy, as a text such as "<= 1.1".
    """
    ours, its = median(values), median(its_values) if its_values else None
    ratio = None if its is None else ours / its if ratio_is == SLOWDOWN else its / ours
    return {
        "name": subject.name,
        "n": str(subject.n),
        "order": subject.order,
        "threads": subject.threads,
        "median": _number(ours),
        "unit": unit,
        "compared with": compared_with,
        "its median": _number(its),
        "ratio": _number(ratio),
        "ratio is": "" if ratio is None else ratio_is,
        "target": target,
        "repeats": str(len(values)),
    }


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def publish(functions: str, options: argparse.Namespace, file: Path) -> None:
    """Write the rows that functions of tests.bench yield to a CSV file, each as soon as it is measured.

    `functions` are names such as "step.moving", separated by spaces.
    """
    start_warp()
    stamp = dict(zip(STAMP, (__version__, _commit(), str(date.today()), _processor()), strict=True))
    part, writer = file.with_suffix(".part"), None
    with part.open("w", newline="") as lines:
        for function in functions.split():
            for cells in resolve_name(f"tests.bench.{function}")(options):
                say("  " + ", ".join(filter(None, cells.values())))
                if writer is None:
                    writer = csv.DictWriter(lines, [*cells, *STAMP], lineterminator="\n")
                    writer.writeheader()
                writer.writerow({**cells, **stamp})
                lines.flush()
    part.replace(file)


def _commit() -> str:
    """Return the commit, followed by + if kernels/ or warpgrains/ have uncommitted changes."""
    git = partial(subprocess.run, cwd=Path(__file__).parents[2], capture_output=True, text=True)
    commit = git(["git", "rev-parse", "--short", "HEAD"]).stdout.strip()
    changed = git(["git", "diff", "--quiet", "HEAD", "--", "kernels", "warpgrains"]).returncode == 1
    return f"{commit}+" if changed else commit


def _processor() -> str:
    name = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.M)
    return f"{os.cpu_count()} cores, {name[1] if name else 'unknown'}"
