"""Draw the CPU time of this and other programs over their error.

python scenes/programs/time_and_overlap.py [peers|shear] [--csv CSV] [-o PNG]

For the common flow (peers), the time is that of 10 ms, and the error is the worst overlap of two grains. For
plane shear, the time is that of a unit of strain, and the error is the largest relative one of mu, phi and
rate (tests.bench.plane_shear.error). Lines join the settings of a program that no other one beats in both.
"""

import argparse
import csv
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import NamedTuple

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot

from tests.bench.plane_shear import error

ROOT = Path(__file__).parents[2]
OURS = {
    "warpgrains, accelerated": "C3o",
    "warpgrains, plain": "C1o",
    "warpgrains, exact": "C6o",
    "warpgrains": "C3o",
}
OTHERS = ("C0s", "C2^", "C4D", "C5v", "C7P", "C8X", "C9<", "k>")
Rows = list[dict[str, str]]
Point = tuple[float, float]


class Picture(NamedTuple):
    """Contents of a picture of a table of measurements.

    It has a row of panels for each value of `column`, with a title from `titles`. `error` and `time` are
    labels of the axes. `point(row, rows)` returns the error and the time of a row of the table, where
    `rows` are all of its panel.
    """

    column: str
    titles: dict[str, str]
    error: str
    time: str
    point: Callable[[dict[str, str], Rows], Point]


PICTURES = {
    "peers": Picture(
        "friction",
        {"0": "without friction", "0.5": "friction 0.5"},
        "worst overlap of two grains [radii]",
        "CPU time of 10 ms [ms]",
        lambda row, rows: (float(row["overlap of pairs"]), float(row["ms of 10 ms"])),
    ),
    "shear": Picture(
        "I",
        {"0.1": "I = 0.1", "0.01": "I = 0.01"},
        "largest relative error of mu, phi and rate",
        "CPU time of a unit of strain [s]",
        lambda row, rows: (error(row, rows), float(row["s of a strain"])),
    ),
}


def draw(rows: Rows, picture: Picture, file: Path) -> None:
    """Draw a picture of the table `rows`, with a column of panels for each number of grains, and save it."""
    sizes = sorted({int(row["n"]) for row in rows})
    size = (4.4 * len(sizes), 7.8)
    figure, panels = pyplot.subplots(
        len(picture.titles),
        len(sizes),
        figsize=size,
        sharex=True,
        sharey="col",
        squeeze=False,
        layout="constrained",
    )
    names = list(dict.fromkeys(row["program"] for row in rows))
    ours = {name: style for name, style in OURS.items() if name in names}
    styles = ours | dict(zip((name for name in names if name not in ours), OTHERS, strict=False))
    for (value, n), panel in zip(product(picture.titles, sizes), panels.flat, strict=True):
        case = [row for row in rows if (row[picture.column], int(row["n"])) == (value, n)]
        for name, style in styles.items():
            points = [picture.point(row, case) for row in case if row["program"] == name]
            panel.loglog(*_axes(points), style, markersize=5, alpha=0.7, label=name)
            panel.loglog(*_axes(_front(points)), style[:-1], linewidth=2 if name in ours else 0.8)
        panel.set_title(f"{n:,} grains, {picture.titles[value]}", fontsize=11)
        panel.grid(alpha=0.3)
        panel.xaxis.set_minor_formatter("")
    for panel in panels[-1]:
        panel.set_xlabel(picture.error)
    for panel in panels[:, 0]:
        panel.set_ylabel(picture.time)
    figure.legend(*panels[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=2 * len(sizes))
    figure.savefig(file, dpi=100)


def _axes(points: list[Point]) -> tuple[list[float], list[float]]:
    return [x for x, _ in points], [y for _, y in points]


def _front(points: list[Point]) -> list[Point]:
    """Return the points (error, time) that no other point undercuts in both, by increasing error."""
    front: list[Point] = []
    for point in sorted(points):
        if not front or point[1] < front[-1][1]:
            front.append(point)
    return front


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("bench", nargs="?", choices=PICTURES, default="peers")
    parser.add_argument("--csv", type=Path, help="results (default: those of the repository)")
    parser.add_argument("-o", "--output", type=Path, help="picture (default: BENCH.png next to the scenes)")
    chosen = parser.parse_args(arguments)
    with (chosen.csv or ROOT / f"tests/bench/results/{chosen.bench}.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    draw(rows, PICTURES[chosen.bench], chosen.output or ROOT / f"scenes/{chosen.bench}.png")


if __name__ == "__main__":
    main()
