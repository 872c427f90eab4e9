"""Draw the CPU time of 10 ms over the worst overlap of two grains, by this and other programs.

python scenes/programs/time_and_overlap.py [--csv CSV] [-o PNG]
"""

import argparse
import csv
from itertools import product
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot

ROOT = Path(__file__).parents[2]
OURS = {"accelerated": "C3", "plain": "C1", "exact": "C6"}  # methods of warpgrains, and their colors
OTHERS = ("C0s", "C2^", "C4D", "C5v", "C7P", "C8X", "C9<", "k>")
FRICTIONS = {"0": "without friction", "0.5": "friction 0.5"}


def draw(rows: list[dict[str, str]], file: Path) -> None:
    """Draw a panel for each number of grains, without friction above and with it below."""
    sizes = sorted({int(row["n"]) for row in rows})
    size = (4.4 * len(sizes), 7.8)
    figure, panels = pyplot.subplots(
        len(FRICTIONS),
        len(sizes),
        figsize=size,
        sharex=True,
        sharey="col",
        squeeze=False,
        layout="constrained",
    )
    names = list(dict.fromkeys(row["program"] for row in rows))
    ours = {name: OURS[name.split(", ")[1]] + "o" for name in names if name.startswith("warpgrains")}
    styles = ours | dict(zip((name for name in names if name not in ours), OTHERS, strict=False))
    for (friction, n), panel in zip(product(FRICTIONS, sizes), panels.flat, strict=True):
        for name, style in styles.items():
            own = [
                row for row in rows if (row["program"], row["friction"], int(row["n"])) == (name, friction, n)
            ]
            points = [(float(row["overlap of pairs"]), float(row["ms of 10 ms"])) for row in own]
            panel.loglog(*_axes(points), style, markersize=5, alpha=0.7, label=name)
            panel.loglog(*_axes(_front(points)), style[:-1], linewidth=2 if name in ours else 0.8)
        panel.set_title(f"{n:,} grains, {FRICTIONS[friction]}", fontsize=11)
        panel.grid(alpha=0.3)
    for panel in panels[-1]:
        panel.set_xlabel("worst overlap of two grains [radii]")
    for panel in panels[:, 0]:
        panel.set_ylabel("CPU time of 10 ms [ms]")
    figure.legend(*panels[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=2 * len(sizes))
    figure.savefig(file, dpi=100)


def _axes(points: list[tuple[float, float]]) -> tuple[list[float], list[float]]:
    return [x for x, _ in points], [y for _, y in points]


def _front(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points that no other one has both a smaller overlap and a shorter time than."""
    front: list[tuple[float, float]] = []
    for overlap, time in sorted(points):
        if not front or time < front[-1][1]:
            front.append((overlap, time))
    return front


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--csv", type=Path, default=ROOT / "tests/bench/results/peers.csv")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "scenes/peers.png")
    chosen = parser.parse_args(arguments)
    with chosen.csv.open(newline="") as file:
        draw(list(csv.DictReader(file)), chosen.output)


if __name__ == "__main__":
    main()
