"""Run the benches whose figures the pages quote, and write a CSV file of each.

    python -m tests.bench all -o tests/bench/results --box2d3 FOLDER
    python -m tests.bench threads peers -o DIR

They need Linux, gcc, the extra `[bench]`, and two cores with nothing else to do for an hour. A file
appears when it is complete.
"""

import argparse
import subprocess
import sys
from pathlib import Path
from time import perf_counter
from typing import NamedTuple


class Bench(NamedTuple):
    """A module, its arguments, those of a long run if they differ, and what it measures."""

    module: str
    arguments: str
    long: str | None
    measures: str


BENCHES = {
    "threads": Bench("step", "--only threads --repeats 3", "--only threads", "two threads, quiet and busy"),
    "moving": Bench("step", "--only moving --repeats 3", "--only moving", "whole runs of grains that flow"),
    "peers": Bench(
        "peers", "--longest 60", "--longest 1000", "time against overlap of this and other programs"
    ),
    "step": Bench("step", "--only sweeps steps course start", None, "steps, compared with C"),
    "batch": Bench("batch", "", "--scenes 1000", "batches of scenes, compared with C"),
    "features": Bench("features", "--repeats 7", "", "the cost of each feature"),
    "exact": Bench("exact", "--grains 1000 3000 --steps 500 --repeats 3", "", "the exact method"),
    "gpu": Bench("gpu", "", None, "a GPU, compared with the cores of its machine"),
}


def run(name: str, options: argparse.Namespace) -> bool:
    """Run a bench, and return whether it ended well."""
    bench, file = BENCHES[name], options.output / f"{name}.csv"
    part = file.with_suffix(".part")
    is_long = options.long and bench.long is not None
    arguments = (bench.long if is_long else bench.arguments).split()
    if name == "peers" and options.box2d3:
        arguments += ["--box2d3", str(options.box2d3)]
    if options.repeats:
        arguments += ["--repeats", str(options.repeats)]
    begun = perf_counter()
    done = subprocess.run([sys.executable, "-m", f"tests.bench.{bench.module}", *arguments, "-o", str(part)])
    taken = f"{perf_counter() - begun:.0f} s"
    if done.returncode:
        print(f"{name}: failed after {taken}; its rows so far are in {part}", file=sys.stderr)
        return False
    part.replace(file)
    print(f"{name}: {taken}, {file}", file=sys.stderr)
    return True


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("benches", nargs="+", choices=["all", *BENCHES], help="all: all but gpu")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the CSV files")
    parser.add_argument("--long", action="store_true", help="everything, which takes hours")
    parser.add_argument("--repeats", type=int, help="of a median, instead of those of each bench")
    parser.add_argument(
        "--box2d3", type=Path, metavar="FOLDER", help="source of Box2D 3.1 or newer, for peers"
    )
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    chosen = options.benches if "all" not in options.benches else [name for name in BENCHES if name != "gpu"]
    failed = [name for name in chosen if not run(name, options)]
    if failed:
        sys.exit(f"failed: {', '.join(failed)}")


if __name__ == "__main__":
    main()
