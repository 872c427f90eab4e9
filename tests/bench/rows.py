"""How benches time what they compare, and write it as CSV, one row a figure. Prints a CSV as Markdown.

python -m tests.bench.rows tests/bench/results/step.csv
"""

import argparse
import csv
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import perf_counter

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
HEAD = ("what", "n", "order", "threads", "median", "against", "its median", "ratio", "target", "reached")


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
) -> list[Mapping[str, object]]:
    """Write rows one by one as they are measured, and return them."""
    start_warp()
    written = []
    with output.open("w", newline="") if output else nullcontext(sys.stdout) as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        for cells in measured:
            say("  " + ", ".join(filter(None, map(str, cells.values()))))
            writer.writerow(cells)
            file.flush()
            written.append(cells)
    return written


def markdown(rows: Iterable[Mapping[str, str]]) -> str:
    lines = [HEAD, ["---"] * len(HEAD), *map(_line, rows)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _line(cells: Mapping[str, str]) -> list[str]:
    unit, other = cells["unit"], cells["its median"]
    sign = "x faster" if cells["ratio is"] == SPEEDUP else "x"
    reached = {True: "yes", False: "**no**", None: ""}[is_reached(cells)]
    return [
        cells["name"],
        f"{int(cells['n']):,}",
        cells["order"],
        cells["threads"],
        f"{_plain(cells['median'])} {unit}",
        cells["compared with"],
        f"{_plain(other)} {unit}" if other else "",
        f"{_plain(cells['ratio'])}{sign}" if cells["ratio"] else "",
        cells["target"],
        reached,
    ]


def is_reached(cells: Mapping[str, str]) -> bool | None:
    """Whether a row reaches its target, with its ratio or, without one, its median; None without a target."""
    if not cells["target"]:
        return None
    sign, limit = cells["target"].split()
    value = float(cells["ratio"] or cells["median"])
    return value <= float(limit) if sign == "<=" else value >= float(limit)


def _plain(number: str) -> str:
    """A number without an exponent, in three digits."""
    value = float(number)
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.rows")
    parser.add_argument("csv", type=Path)
    with parser.parse_args().csv.open(newline="") as file:
        print(markdown(csv.DictReader(file)))


if __name__ == "__main__":
    main()
