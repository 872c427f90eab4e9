"""Change the kernels in one place at a time, and find the test that detects it.

Every mutant is a copy of the package in a folder of its own, whose kernels compile to a cache of its own. The first
row is the package as it is, which must pass. One CSV row a mutant tells its file, line, texts and effect, the test
that failed first, "none" if all passed, or "time limit", and the seconds taken.

python -m tests.bench.mutations --only verlet -o verlet.csv
"""

import argparse
import csv
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic

ROOT = Path(__file__).parents[2]
TABLE = Path(__file__).with_suffix(".toml")
COLUMNS = ("file", "line", "old", "new", "effect", "detected by", "seconds")
TIME_LIMIT = 300.0  # seconds a mutant: one that never ends is detected as well
QUICK = (
    "verlet",
    "contact_list",
    "monitoring",
    "coloring",
    "missing_contacts",
    "accelerated_stages",
    "working_set",
)
TESTS = [f"tests/kernels/test_{name}.py" for name in QUICK]
NONE, LATE, UNBUILT = "none", "time limit", "cannot be built"
BUILD_ERRORS = re.compile(r"WarpCodegen\w*Error|kernel build failed|SyntaxError|IndentationError")


@dataclass(frozen=True)
class Mutant:
    """A kernel file with other text in one place.

    Attributes
    ----------
    file : str
        Of kernels/, without its suffix; empty for the package as it is.
    old, new : str
    effect : str
        "result" or "speed".
    reason : str
        Why it changes speed alone.
    """

    file: str = ""
    old: str = ""
    new: str = ""
    effect: str = ""
    reason: str = ""

    @property
    def source(self) -> str:
        """Return the text of the file as it is."""
        return (ROOT / "kernels" / f"{self.file}.py").read_text()

    @property
    def line(self) -> int:
        """Return the line in which the old text begins."""
        return self.source[: self.source.index(self.old)].count("\n") + 1


def mutants() -> list[Mutant]:
    """Read the table."""
    return [Mutant(file, *row) for file, rows in tomllib.loads(TABLE.read_text()).items() for row in rows]


def copy_package(folder: Path, mutant: Mutant) -> None:
    """Copy the package and its tests, with the mutant's file."""
    ignored = shutil.ignore_patterns("__pycache__", "results")
    copied = {
        "warpgrains": "warpgrains",
        "kernels": "warpgrains/kernels",
        "scenes": "warpgrains/scenes",
        "tests": "tests",
    }
    for source, target in copied.items():
        shutil.copytree(ROOT / source, folder / target, ignore=ignored, dirs_exist_ok=True)
    shutil.copy(ROOT / "pyproject.toml", folder)
    if mutant.file:
        target = folder / "warpgrains" / "kernels" / f"{mutant.file}.py"
        target.write_text(mutant.source.replace(mutant.old, mutant.new))


def first_failure(folder: Path, cache: Path, tests: list[str]) -> str:
    """Run tests until one fails; return its name, NONE, or LATE."""
    line = [sys.executable, "-m", "pytest", "-n", "0", "-x", "-q", "-p", "no:cacheprovider", *tests]
    environment = os.environ | {"PYTHONPATH": str(folder), "WARP_CACHE_PATH": str(cache)}
    try:
        done = subprocess.run(
            line, cwd=folder, env=environment, capture_output=True, text=True, timeout=TIME_LIMIT
        )
    except subprocess.TimeoutExpired:
        return LATE
    if done.returncode == 0:
        return NONE
    if BUILD_ERRORS.search(done.stdout):
        return UNBUILT
    failed = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", done.stdout, re.MULTILINE)
    return failed[1] if failed else f"exit code {done.returncode}"


def detect(mutant: Mutant, tests: list[str], warm: Path) -> dict[str, object]:
    """Return the row of a mutant; its cache begins as a copy of a warm one, which serves what is unchanged."""
    start = monotonic()
    with TemporaryDirectory() as name:
        folder = Path(name)
        copy_package(folder, mutant)
        shutil.copytree(warm, folder / "cache", copy_function=os.link)
        found = first_failure(folder, folder / "cache", tests)
    line = mutant.line if mutant.file else ""
    cells = (mutant.file, line, mutant.old, mutant.new, mutant.effect, found, f"{monotonic() - start:.0f}")
    return dict(zip(COLUMNS, cells, strict=True))


def rows(chosen: list[Mutant], tests: list[str], jobs: int) -> Iterator[dict[str, object]]:
    """Run the package as it is, which warms the cache, and then every mutant."""
    with TemporaryDirectory() as name, ThreadPoolExecutor(jobs) as pool:
        warm = Path(name)
        start = monotonic()
        copy_package(warm / "package", Mutant())
        found = first_failure(warm / "package", warm / "cache", tests)
        yield dict.fromkeys(COLUMNS, "") | {"detected by": found, "seconds": f"{monotonic() - start:.0f}"}
        if found == NONE:
            yield from pool.map(partial(detect, tests=tests, warm=warm / "cache"), chosen)


def main() -> None:
    """Write one row a mutant; exit with 1 where tests fail as it is, or a changed result is not detected."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.mutations", description=__doc__.partition("\n")[0]
    )
    files = sorted({mutant.file for mutant in mutants()})
    parser.add_argument("--only", nargs="+", choices=files, default=files, help="files of kernels/ to change")
    parser.add_argument("--tests", nargs="+", default=TESTS, help="test files, those that decide fast first")
    parser.add_argument("--jobs", type=int, default=1, help="mutants at a time")
    parser.add_argument("-o", "--output", type=Path, default=Path("mutations.csv"))
    options = parser.parse_args()
    chosen = [mutant for mutant in mutants() if mutant.file in options.only]
    fine = True
    with options.output.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for row in rows(chosen, options.tests, options.jobs):
            writer.writerow(row)
            file.flush()
            print(row["file"] or "as it is", row["line"], row["effect"], row["detected by"], flush=True)
            fine &= (row["detected by"] != NONE) == (row["effect"] != "") or row["effect"] == "speed"
    sys.exit(0 if fine else 1)


if __name__ == "__main__":
    main()
