"""A dask cluster of two local workers against two threads of one process, on the same sweep: CSV, medians.

    python -m tests.bench.cluster -o tests/bench/results/cluster.csv

Each time is that of the whole command, from its start; the cluster is there before, its workers are new.
"""

import argparse
import csv
import shutil
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from statistics import mean

from distributed import LocalCluster

from .rows import Subject, open_table, row
from .timing import in_turn, say, seconds

SWEEP = """
scene = "polydisperse"
[set]
time.duration = {duration}
[axes]
grains.seed = {{seeds = {runs}}}
"""
WORKERS = 2


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Read the command line."""
    summary = "Measure a sweep on a local dask cluster beside the same sweep without it."
    parser = argparse.ArgumentParser(prog="python -m tests.bench.cluster", description=summary)
    parser.add_argument("-o", "--output", type=Path, help="CSV file (default: standard output)")
    parser.add_argument("--runs", type=int, default=200, help="scenes (default: 200)")
    parser.add_argument(
        "--duration", type=float, default=3.0, help="simulated time of a scene [s] (default: 3)"
    )
    parser.add_argument(
        "--repeats", type=int, default=5, help="values that a median is taken of (default: 5)"
    )
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> None:
    """Carry out the sweep in turn here and there, and hold the results against one another."""
    chosen = parse(arguments)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        table = stack.enter_context(open_table(chosen.output))
        sweep = folder / "sweep.toml"
        sweep.write_text(SWEEP.format(runs=chosen.runs, duration=chosen.duration))
        here, there = in_turn(chosen.repeats, partial(_here, sweep), partial(_on_cluster, sweep))
        assert _read(folder / "here" / "results.csv") == _read(folder / "there" / "results.csv")
        cost = mean(float(run["seconds"]) for run in _read(folder / "here" / "timing.csv"))
        name = f"scenes of {cost:.2g} s on {WORKERS} dask workers"
        subject = Subject(name, chosen.runs, threads=str(WORKERS))
        cells = row(subject, there, "s", f"{WORKERS} threads of one process", here, target="<= 1.15")
        say(", ".join(filter(None, cells.values())))
        table.add(cells)


def _read(table: Path) -> list[dict[str, str]]:
    with table.open(newline="") as lines:
        return list(csv.DictReader(lines))


def _here(sweep: Path) -> float:
    return _seconds_of(sweep, "here", "--threads", str(WORKERS))


def _on_cluster(sweep: Path) -> float:
    with LocalCluster(n_workers=WORKERS, threads_per_worker=1, dashboard_address=None) as cluster:
        return _seconds_of(sweep, "there", "--scheduler", cluster.scheduler_address)


def _seconds_of(sweep: Path, name: str, *options: str) -> float:
    """Carry out the sweep in a new process and a new folder."""
    output = sweep.with_name(name)
    shutil.rmtree(output, ignore_errors=True)
    command = [sys.executable, "-m", "warpgrains", "batch", str(sweep), "-o", str(output), *options]
    taken = seconds(partial(subprocess.run, command, check=True, stdout=subprocess.DEVNULL))
    say(f"{name}: {taken:.2f} s")
    return taken


if __name__ == "__main__":
    main()
