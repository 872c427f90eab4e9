"""Print a benchmark's CSV as a Markdown table, losses included.

python -m tests.bench.table tests/bench/results/step.csv
"""

import argparse
from pathlib import Path

from .rows import RESULTS, SPEEDUP, is_reached, read

HEAD = ["what", "n", "order", "threads", "median", "against", "its median", "ratio", "target", "reached"]


def line(cells: dict[str, str]) -> list[str]:
    """One row as it is shown; a target that was missed stands out."""
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


def _plain(number: str) -> str:
    """A number without an exponent, in three digits."""
    value = float(number)
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def markdown(rows: list[dict[str, str]]) -> str:
    """Return the table."""
    lines = [HEAD, ["---"] * len(HEAD), *map(line, rows)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def main() -> None:
    """Read one CSV file."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.table")
    parser.add_argument("csv", type=Path, nargs="?", default=RESULTS / "step.csv")
    print(markdown(read(parser.parse_args().csv)))


if __name__ == "__main__":
    main()
