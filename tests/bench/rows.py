"""Timing, and CSV files with a row for each figure, with the code, the day and the machine that it is of."""

import argparse
import csv
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from datetime import date
from functools import partial
from pathlib import Path
from statistics import median
from time import perf_counter

from warpgrains import __version__
from warpgrains.warp_start import start_warp

COLUMNS = (
    "name",
    "n",
    "order",
    "threads",
    "median",
    "unit",
    "compared with",
    "its median",
    "ratio",
    "ratio is",
    "target",
    "repeats",
)
SLOWDOWN, SPEEDUP = "median / its median", "its median / median"
STAMP = ("version", "commit", "date", "processor")
"""Columns of every CSV file, after its own."""


def seconds(work: Callable[[], object]) -> float:
    start = perf_counter()
    work()
    return perf_counter() - start


def in_turn(repeats: int, *measure: Callable[[], float]) -> list[list[float]]:
    """Call each function once a round, so that noise hits all of them; return the values of each."""
    rounds = [[take() for take in measure] for _ in range(repeats)]
    return [list(values) for values in zip(*rounds, strict=True)]


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


@dataclass(frozen=True)
class Subject:
    """What is measured: a scene's kind, its size, and how it is swept."""

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
) -> dict[str, str]:
    """Take the medians; the ratio is one of medians, and `target` says what it should be, as in "<= 1.1"."""
    ours, its = median(values), median(its_values) if its_values else None
    ratio = None if its is None else ours / its if ratio_is == SLOWDOWN else its / ours
    cells = (
        subject.name,
        str(subject.n),
        subject.order,
        subject.threads,
        _number(ours),
        unit,
        compared_with,
        _number(its),
        _number(ratio),
        "" if ratio is None else ratio_is,
        target,
        str(len(values)),
    )
    return dict(zip(COLUMNS, cells, strict=True))


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def command_line(module: str, document: str | None, repeats: int = 5) -> argparse.ArgumentParser:
    summary = (document or "").partition("\n")[0]
    parser = argparse.ArgumentParser(prog=f"python -m tests.bench.{module}", description=summary)
    parser.add_argument("-o", "--output", type=Path, help="CSV file (default: standard output)")
    parser.add_argument("--repeats", type=int, default=repeats, help=f"of a median (default: {repeats})")
    cache = Path(tempfile.gettempdir()) / "warpgrains-bench"
    parser.add_argument("--cache", type=Path, default=cache, help=f"states that are kept (default: {cache})")
    return parser


def publish(
    measured: Iterable[Mapping[str, object]], output: Path | None, columns: Sequence[str] = COLUMNS
) -> None:
    """Write rows one by one as they are measured."""
    start_warp()
    stamp = dict(zip(STAMP, (__version__, _commit(), str(date.today()), _processor()), strict=True))
    with output.open("w", newline="") if output else nullcontext(sys.stdout) as file:
        writer = csv.DictWriter(file, [*columns, *STAMP], lineterminator="\n")
        writer.writeheader()
        for cells in measured:
            say("  " + ", ".join(filter(None, map(str, cells.values()))))
            writer.writerow({**cells, **stamp})
            file.flush()


def _commit() -> str:
    """Return the commit, with a + if the package differs from it."""
    git = partial(subprocess.run, cwd=Path(__file__).parents[2], capture_output=True, text=True)
    commit = git(["git", "rev-parse", "--short", "HEAD"]).stdout.strip()
    changed = git(["git", "diff", "--quiet", "HEAD", "--", "kernels", "warpgrains"]).returncode == 1
    return f"{commit}+" if changed else commit


def _processor() -> str:
    name = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.M)
    return f"{os.cpu_count()} cores, {name[1] if name else 'unknown'}"
