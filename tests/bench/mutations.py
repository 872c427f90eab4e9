"""Change the kernels in one place at a time, and find the test that detects it.

Every mutant of mutations.toml is a copy of the package in a separate folder with a separate kernel cache.
The first row is the unchanged package, which must pass. Each mutant has a CSV row with its file, texts and
effect, the test that failed first, and the time [s]. Instead of a test, "none" means that all tests passed,
and "time limit" that a test did not end.

python -m tests.bench.mutations --only verlet neighbors -o mutations.csv
"""

import argparse
import csv
import os
import re
import shutil
import subprocess
import sys
import tomllib
from itertools import chain
from multiprocessing.pool import ThreadPool
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
TABLE = Path(__file__).with_suffix(".toml")
COLUMNS = ("file", "old", "new", "effect", "detected by", "seconds")
TIME_LIMIT = 300.0  # s per mutant; a mutant that does not end counts as detected
DECIDING = {
    "verlet": ("verlet", "monitoring", "missing_contacts", "driven_walls"),
    "skins": ("verlet", "missing_contacts"),
    "neighbors": ("contact_list", "driven_walls"),
    "wall_sweep": ("driven_walls", "reference"),
    "contact_list": ("contact_list", "missing_contacts"),
    "working_set": ("accelerated_stages", "accelerated", "friction", "reference"),
    "momentum": ("momentum", "accelerated_stages", "accelerated"),
    "stopping": ("momentum", "accelerated_stages", "accelerated", "monitoring", "missing_contacts"),
    "coloring": ("coloring",),
    "contacts": ("coloring", "accelerated_stages"),
    "residual": ("accelerated_stages", "accelerated", "driven_walls", "friction", "walls", "reference"),
    "rolling": ("friction", "reference"),
    "attempt": ("accelerated_stages", "missing_contacts", "driven_walls", "second_order", "exact"),
    "pieces": ("exact_friction",),
    "block_lu": ("exact_friction",),
}
"""Names of test files, see `test_file`, by the file of kernels/ whose mutants they must detect.

The fastest tests come first.
"""
NONE, LATE, UNBUILT = "none", "time limit", "cannot be built"
BUILD_ERRORS = re.compile(r"WarpCodegen\w*Error|kernel build failed|SyntaxError|IndentationError")
COPIED = {
    **{folder: folder for folder in ("warpgrains", "tests", "scenes/programs")},
    **{folder: f"warpgrains/{folder}" for folder in ("kernels", "scenes")},
}


class Mutant(NamedTuple):
    """A change of a file of kernels/: the text `old` is replaced by `new`.

    Without a file, it is the unchanged package. `effect` and `reason` are explained in mutations.toml.
    """

    file: str = ""
    old: str = ""
    new: str = ""
    effect: str = ""
    reason: str = ""

    @property
    def source(self) -> str:
        return (ROOT / self.path).read_text()

    @property
    def path(self) -> Path:
        """Path of the file, relative to the repository."""
        (found,) = (ROOT / "kernels").rglob(f"{self.file}.py")
        return found.relative_to(ROOT)

    @property
    def changed(self) -> str:
        return self.source.replace(self.old, self.new)


def mutants() -> list[Mutant]:
    return [Mutant(file, *row) for file, rows in tomllib.loads(TABLE.read_text()).items() for row in rows]


def trial(mutant: Mutant, tests: list[str], warm: Path) -> dict[str, str]:
    """Run tests of a copy of the package with a mutant until one fails, and return the CSV row.

    `warm` is the folder of compiled kernels of the unchanged package.
    """
    start = monotonic()
    with TemporaryDirectory() as name:
        folder, cache, longest = Path(name), warm, 4.0 * TIME_LIMIT  # the first run compiles all
        for source, target in COPIED.items():
            shutil.copytree(ROOT / source, folder / target, dirs_exist_ok=True)
        shutil.copy(ROOT / "pyproject.toml", folder)
        if mutant.file:
            (folder / "warpgrains" / mutant.path).write_text(mutant.changed)
            cache, longest = folder / "cache", TIME_LIMIT
            shutil.copytree(warm, cache, copy_function=os.link)  # kernels without changes are compiled
        command = [sys.executable, "-m", "pytest", "-n", "0", "-x", "-q", "-p", "no:cacheprovider", *tests]
        environment = {**os.environ, "PYTHONPATH": str(folder), "WARP_CACHE_PATH": str(cache)}
        how = {"cwd": folder, "env": environment, "text": True, "timeout": longest}
        try:
            done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, **how)
            found = first_failure(done.stdout) if done.returncode else NONE
        except subprocess.TimeoutExpired:
            found = LATE
    return dict(zip(COLUMNS, (*mutant[:4], found, f"{monotonic() - start:.0f}"), strict=True))


def first_failure(printed: str) -> str:
    """Return the name of the failed test in the output of pytest, or another reason of failure."""
    if BUILD_ERRORS.search(printed):
        return UNBUILT
    failed = re.search(r"^(?:FAILED|ERROR) (.*?)(?: - .*)?$", printed, re.M)
    return failed[1] if failed else f"no test: {printed[-200:]!r}"


def test_file(name: str) -> str:
    folder = "stability" if name.startswith("exact") else "kernels"
    return f"tests/{folder}/test_{name}.py"


def is_as_it_should_be(row: dict[str, str]) -> bool:
    """Return whether the row of a mutant, or of the unchanged package, is as it should be.

    The unchanged package must pass. A mutant must be built and, if its effect is "result", detected.
    """
    found = row["detected by"]
    if not row["file"]:
        return found == NONE
    return found != UNBUILT and (found != NONE or row["effect"] != "result")


def main(arguments: list[str] | None = None) -> None:
    """Try the mutants of the chosen files, and write their rows.

    Exit with 1 if a row is not as it should be.
    """
    summary = (__doc__ or "").partition("\n")[0]
    parser = argparse.ArgumentParser(prog="python -m tests.bench.mutations", description=summary)
    files = list(DECIDING)
    parser.add_argument("--only", nargs="+", choices=files, default=files, help="files of kernels/ to change")
    parser.add_argument("--jobs", type=int, default=1, help="mutants at a time")
    parser.add_argument("-o", "--output", type=Path, default=Path("mutations.csv"))
    options = parser.parse_args(arguments)
    deciding = {file: [test_file(name) for name in DECIDING[file]] for file in options.only}
    chosen = [mutant for mutant in mutants() if mutant.file in deciding]
    with options.output.open("w", newline="") as file, TemporaryDirectory() as warm:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()

        def run(mutant: Mutant) -> dict[str, str]:
            tests = deciding.get(mutant.file) or list(dict.fromkeys(chain(*deciding.values())))
            return trial(mutant, tests, Path(warm))

        def is_fine(row: dict[str, str]) -> bool:
            writer.writerow(row)
            file.flush()
            print(row["file"] or "as it is", row["old"], row["effect"], row["detected by"], flush=True)
            return is_as_it_should_be(row)

        with ThreadPool(options.jobs) as pool:
            fine = is_fine(run(Mutant())) and all([*map(is_fine, pool.imap_unordered(run, chosen))])
    sys.exit(int(not fine))


if __name__ == "__main__":
    main()
