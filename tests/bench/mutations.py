"""Change the kernels in one place at a time, and find the test that detects it.

Every mutant of mutations.toml is a copy of the package in a folder of its own, whose kernels compile to a
cache of its own. The first row is the package as it is, which must pass. One CSV row a mutant has its file,
line, texts and effect, the test that failed first, and the seconds taken. "none" means that all tests passed,
"time limit" that one did not end.

python -m tests.bench.mutations --only verlet neighbors -o mutations.csv
"""

import argparse
import csv
import multiprocessing
import os
import re
import shutil
import sys
import tomllib
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic

import pytest
import warp as wp

ROOT = Path(__file__).parents[2]
TABLE = Path(__file__).with_suffix(".toml")
COLUMNS = ("file", "line", "old", "new", "effect", "detected by", "seconds")
TIME_LIMIT = 300.0  # seconds a mutant: one that never ends is detected as well
DECIDING = {
    "verlet": ("verlet", "monitoring", "missing_contacts", "driven_walls"),
    "skins": ("verlet", "missing_contacts"),
    "neighbors": ("contact_list", "driven_walls"),
    "wall_sweep": ("driven_walls", "reference"),
    "contact_list": ("contact_list", "missing_contacts"),
    "working_set": ("accelerated_stages", "working_set"),
    "momentum": ("momentum", "accelerated_stages", "working_set"),
    "stopping": ("momentum", "accelerated_stages", "working_set", "monitoring", "missing_contacts"),
    "coloring": ("coloring",),
    "contacts": ("accelerated_stages",),
}
"""Test files of tests/kernels that decide on the mutants of a file, the fastest first."""
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
        What it changes: "result" (or the proof of one), "speed" alone, or "nothing".
    reason : str
        Why it changes no result.
    """

    file: str = ""
    old: str = ""
    new: str = ""
    effect: str = ""
    reason: str = ""

    @property
    def source(self) -> str:
        return (ROOT / "kernels" / f"{self.file}.py").read_text()

    @property
    def line(self) -> int:
        return self.source[: self.source.index(self.old)].count("\n") + 1


def mutants() -> list[Mutant]:
    return [Mutant(file, *row) for file, rows in tomllib.loads(TABLE.read_text()).items() for row in rows]


def copy_package(folder: Path, mutant: Mutant) -> None:
    """Copy the package and its tests, with the mutant's file."""
    copied = {
        "warpgrains": "warpgrains",
        "kernels": "warpgrains/kernels",
        "scenes": "warpgrains/scenes",
        "scenes/programs": "scenes/programs",
        "tests": "tests",
    }
    for source, target in copied.items():
        shutil.copytree(ROOT / source, folder / target, dirs_exist_ok=True)
    shutil.copy(ROOT / "pyproject.toml", folder)
    if mutant.file:
        target = folder / "warpgrains" / "kernels" / f"{mutant.file}.py"
        target.write_text(mutant.source.replace(mutant.old, mutant.new))


class FirstFailure:
    """A plugin of pytest that keeps the name of the first test that fails."""

    name = NONE

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed and self.name == NONE:
            self.name = UNBUILT if BUILD_ERRORS.search(report.longreprtext) else report.nodeid

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed and self.name == NONE:
            self.name = UNBUILT if BUILD_ERRORS.search(report.longreprtext) else f"import of {report.nodeid}"


@wp.kernel
def nothing() -> None:
    pass


def prepare(cache: Path) -> None:
    """Start Warp and precompile its headers: every process forked from this one begins with them."""
    wp.config.log_level = wp.LOG_WARNING
    wp.config.kernel_cache_dir, wp.config.use_precompiled_headers = str(cache), True
    wp.load_module(sys.modules[__name__], device="cpu")


def run_tests(answer: Connection, folder: Path, cache: Path, tests: list[str]) -> None:
    """Run tests of a copy of the package until one fails, and send its name; in a process of its own."""
    os.chdir(folder)
    sys.path.insert(0, str(folder))
    wp.config.kernel_cache_dir = str(cache)
    first = FirstFailure()
    options = ["-n", "0", "-x", "-q", "-p", "no:cacheprovider"]
    with (folder / "log").open("w") as log, redirect_stdout(log), redirect_stderr(log):
        code = pytest.main([*options, *tests], plugins=[first])
    answer.send(first.name if first.name != NONE or code == 0 else f"exit code {int(code)}")


class Trial:
    """A mutant whose tests run in a process of their own, in a folder of its own."""

    def __init__(self, mutant: Mutant, tests: list[str], warm: Path):
        self._mutant, self._start, self._folder = mutant, monotonic(), TemporaryDirectory()
        folder, cache = Path(self._folder.name), warm
        copy_package(folder, mutant)
        if mutant.file:  # what it leaves unchanged is compiled already
            cache = folder / "cache"
            shutil.copytree(warm, cache, copy_function=os.link)
        self.answer, end = multiprocessing.Pipe(duplex=False)
        context = multiprocessing.get_context("fork")
        self._process = context.Process(target=run_tests, args=(end, folder, cache, tests))
        self._process.start()
        end.close()

    def seconds_left(self) -> float:
        return max(0.0, self._start + TIME_LIMIT - monotonic())

    def row(self) -> dict[str, object]:
        found = LATE
        if self.answer.poll():
            try:
                found = self.answer.recv()
            except EOFError:
                found = "the process ended"
        self._process.kill()
        self._process.join()
        self._folder.cleanup()
        mutant, seconds = self._mutant, f"{monotonic() - self._start:.0f}"
        line = mutant.line if mutant.file else ""
        cells = (mutant.file, line, mutant.old, mutant.new, mutant.effect, found, seconds)
        return dict(zip(COLUMNS, cells, strict=True))


def rows(files: list[str], tests: list[str], jobs: int, most: int) -> Iterator[dict[str, object]]:
    """Run the package as it is, which warms the cache, and then the mutants of some files."""
    deciding = {file: tests or [f"tests/kernels/test_{name}.py" for name in DECIDING[file]] for file in files}
    with TemporaryDirectory() as name:
        warm = Path(name)
        prepare(warm)
        all_tests = list(dict.fromkeys(test for several in deciding.values() for test in several))
        (as_it_is,) = trials([Mutant()], all_tests, 1, warm)
        yield as_it_is
        for file in files if as_it_is["detected by"] == NONE else []:
            chosen = [mutant for mutant in mutants() if mutant.file == file][:most]
            yield from trials(chosen, deciding[file], jobs, warm)


def trials(chosen: list[Mutant], tests: list[str], jobs: int, warm: Path) -> Iterator[dict[str, object]]:
    """Run mutants, and yield the rows in the order in which they end."""
    left, running = list(chosen), []
    while left or running:
        while left and len(running) < jobs:
            running.append(Trial(left.pop(0), tests, warm))
        wait([trial.answer for trial in running], min(trial.seconds_left() for trial in running))
        for trial in running[:]:
            if trial.answer.poll() or trial.seconds_left() == 0.0:
                running.remove(trial)
                yield trial.row()


def is_as_it_should_be(row: dict[str, object]) -> bool:
    """Return whether the package as it is passes, or a mutant is built, and detected if results change."""
    found = row["detected by"]
    if row["effect"] == "result":
        return found not in (NONE, UNBUILT)
    return found == NONE or (row["file"] != "" and found != UNBUILT)


def main() -> None:
    """Write the rows; exit with 1 where one is not as it should be."""
    summary = (__doc__ or "").partition("\n")[0]
    parser = argparse.ArgumentParser(prog="python -m tests.bench.mutations", description=summary)
    files = list(DECIDING)
    parser.add_argument("--only", nargs="+", choices=files, default=files, help="files of kernels/ to change")
    parser.add_argument("--tests", nargs="+", default=[], help="test files (default: those of `DECIDING`)")
    parser.add_argument("--jobs", type=int, default=1, help="mutants at a time")
    parser.add_argument("--most", type=int, default=1000, help="mutants of a file, the first ones")
    parser.add_argument("-o", "--output", type=Path, default=Path("mutations.csv"))
    options = parser.parse_args()
    fine = True
    with options.output.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for row in rows(options.only, options.tests, options.jobs, options.most):
            writer.writerow(row)
            file.flush()
            print(row["file"] or "as it is", row["line"], row["effect"], row["detected by"], flush=True)
            fine &= is_as_it_should_be(row)
    sys.exit(0 if fine else 1)


if __name__ == "__main__":
    main()
