"""Run the benches whose figures the pages quote, and write a CSV file of each.

    python -m tests.bench all -o tests/bench/results --box2d3 FOLDER
    python -m tests.bench threads peers -o DIR

The benches need Linux, gcc, the extra `[bench]`, and two idle cores for an hour. Each file appears
when it is complete.
"""

import argparse
import sys
import tempfile
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

from .rows import publish, say


class Bench(NamedTuple):
    """A bench, which writes one CSV file.

    `measures` names its subject. `functions` are names of functions of tests.bench, separated by spaces,
    which yield its rows. `options` are its default options, and `long` those that replace them with --long.
    """

    measures: str
    functions: str
    options: dict[str, Any]
    long: dict[str, Any]


BENCHES = {
    "threads": Bench("two threads, quiet and busy", "step.threads", {"repeats": 3}, {"repeats": 5}),
    "moving": Bench("whole runs of grains that flow", "step.moving", {"repeats": 3}, {"repeats": 5}),
    "peers": Bench(
        "time against overlap of this and other programs", "peers.rows", {"longest": 60.0}, {"longest": 1e3}
    ),
    "shear": Bench(
        "plane shear in this and other programs",
        "plane_shear.rows",
        {"grains": [400], "rates": [0.1], "seeds": 1, "longest": 60.0},
        {"grains": [400, 4_000], "rates": [0.1, 0.01], "seeds": 3, "longest": 2e3},
    ),
    "step": Bench(
        "steps, compared with C",
        "against_c.sweeps against_c.steps against_c.course step.first_run",
        {"repeats": 5},
        {},
    ),
    "batch": Bench(
        "batches of scenes, compared with C",
        "batch.courses batch.piles",
        {"repeats": 5, "scenes": [300]},
        {"scenes": [1_000]},
    ),
    "features": Bench("the cost of each feature", "features.costs", {"repeats": 7}, {"repeats": 15}),
    "measuring": Bench(
        "the cost of measuring after each step", "features.measuring", {"repeats": 5}, {"repeats": 15}
    ),
    "exact": Bench(
        "the exact method",
        "exact.piles exact.shipped exact.with_friction",
        {"repeats": 3, "grains": [1_000, 3_000], "steps": 500},
        {"repeats": 5, "grains": [1_000, 3_000, 10_000], "steps": None},
    ),
    "gpu": Bench("a GPU, compared with the cores of its machine", "batch.on_gpu", {"repeats": 5}, {}),
}


def options_of(bench: Bench, given: argparse.Namespace) -> argparse.Namespace:
    """Return the options given to the command, completed by the defaults of the bench."""
    own = bench.options | (bench.long if given.long else {})
    chosen = {key: value for key, value in vars(given).items() if value is not None}
    return argparse.Namespace(**{**vars(given), **own, **chosen})


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("benches", nargs="+", choices=["all", *BENCHES], help="all: all but gpu")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the CSV files")
    parser.add_argument("--long", action="store_true", help="everything, which takes hours")
    cache = Path(tempfile.gettempdir()) / "warpgrains-bench"
    parser.add_argument("--cache", type=Path, default=cache, help=f"states that are kept (default: {cache})")
    of_each = parser.add_argument_group("instead of what each bench has")
    of_each.add_argument("--repeats", type=int, help="times of a median")
    of_each.add_argument("--grains", type=int, nargs="+", metavar="N", help="of a scene")
    of_each.add_argument("--scenes", type=int, nargs="+", metavar="N", help="of a batch")
    of_each.add_argument("--steps", type=int, help="of a run, at most")
    peers = parser.add_argument_group("peers")
    peers.add_argument("--box2d3", type=Path, metavar="FOLDER", help="source of Box2D 3.1 or newer")
    peers.add_argument("--programs", nargs="+", help="that are measured (default: all)")
    peers.add_argument("--longest", type=float, help="limit of a measurement [s]")
    of_shear = parser.add_argument_group("shear")
    of_shear.add_argument("--rates", type=float, nargs="+", metavar="I", help="inertial numbers")
    of_shear.add_argument("--seeds", type=int, help="packings of few grains at the start")
    parser.add_argument("--device", default="cuda:0", help="of gpu (default: cuda:0)")
    options = parser.parse_args(arguments)
    source = options.box2d3
    if source and not (source / "src" / "physics_world.c").is_file():
        parser.error(f"--box2d3: {source} holds no source of Box2D 3.1 or newer (src/physics_world.c)")
    return options


def main(arguments: list[str] | None = None) -> None:
    """Run the benches that command line arguments name, one after the other, each in a separate process."""
    given, failed = parse(arguments), []
    given.output.mkdir(parents=True, exist_ok=True)
    chosen = given.benches if "all" not in given.benches else [name for name in BENCHES if name != "gpu"]
    for name in chosen:
        begun, bench, file = perf_counter(), BENCHES[name], given.output / f"{name}.csv"
        process = get_context("spawn").Process(
            target=publish, args=(bench.functions, options_of(bench, given), file)
        )
        process.start()
        process.join()
        if process.exitcode:
            failed.append(name)
        say(f"{name}: {perf_counter() - begun:.0f} s, {'failed' if process.exitcode else file}")
    if failed:
        sys.exit(f"failed: {', '.join(failed)}; rows so far are in files .part")


if __name__ == "__main__":
    main()
