"""What was measured: one row a figure, written as CSV and read back."""

import csv
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TextIO

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
RESULTS = Path(__file__).with_name("results")


@dataclass(frozen=True)
class Subject:
    """What is measured: a pile's kind, its size, and how it is swept."""

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


def is_reached(cells: dict[str, str]) -> bool | None:
    """Whether a row reaches its target, with its ratio or, without one, its median; None without a target."""
    if not cells["target"]:
        return None
    sign, limit = cells["target"].split()
    value = float(cells["ratio"] or cells["median"])
    return value <= float(limit) if sign == "<=" else value >= float(limit)


class Table:
    """A CSV file that grows row by row, so that what is measured is kept."""

    def __init__(self, file: TextIO, columns: Sequence[str]):
        self._file, self._writer = file, csv.DictWriter(file, columns, lineterminator="\n")
        self._writer.writeheader()

    def add(self, cells: Mapping[str, object]) -> None:
        """Write one row."""
        self._writer.writerow(cells)
        self._file.flush()


@contextmanager
def open_table(output: Path | None, columns: Sequence[str] = COLUMNS) -> Iterator[Table]:
    """Open a table in a file, or on the standard output."""
    with output.open("w", newline="") if output else nullcontext(sys.stdout) as file:
        yield Table(file, columns)


def read(path: Path) -> list[dict[str, str]]:
    """Read the rows of a CSV file."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))
