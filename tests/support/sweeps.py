"""Sweeps that several tests carry out."""

import csv
from pathlib import Path

from warpgrains.cli.main import main

SMALL = """
scene = "annulus"
[set]
time.duration = 0.4
solver.max_iterations = 30
[axes]
physics.drag = [0.1, 100.0, 0.5]
grains.count = [5, 15]
"""
"""Six runs of 40 steps, some not converged; the third and the fourth have too much drag to be a scene."""

LONG = """
scene = "annulus"
[set]
solver.order = "color"
[axes]
physics.drag = {range = [0.1, 0.9], count = 3}
grains.shift = {log_range = [1e-9, 1e-6], count = 4}
"""
"""Twelve runs of 800 steps."""


def write(folder: Path, text: str = SMALL) -> Path:
    """Write a sweep file."""
    path = folder / "sweep.toml"
    path.write_text(text)
    return path


def batch(*arguments: object) -> int:
    """Run the command in this process and return its exit code."""
    try:
        return main(["batch", *map(str, arguments)])
    except SystemExit as exit:
        return int(exit.code or 0)


def table(path: Path) -> list[dict[str, str]]:
    """Read a table."""
    with path.open(newline="") as lines:
        return list(csv.DictReader(lines))


def results(folder: Path) -> bytes:
    """Read the table of results as it lies on disk."""
    return (folder / "results.csv").read_bytes()
