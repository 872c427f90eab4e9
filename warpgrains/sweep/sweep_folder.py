"""The folder of a sweep: results of runs, and tables of all results, which are made from them alone.

================== ==========================================================================================
results.csv        the results of all runs that are finished; timing.csv, how long they took
settings.json      the settings of all runs, see `RunSettings`
scenes/NAME.toml   the common part of the runs of a scene; their values on the axes are in their results
parts/             results of runs without a folder, see `ResultShards`
runs/00042/        the folder of a run, if it needs one, see `ExecutionOptions.needs_folders`
grains/            copies of files of grains
================== ==========================================================================================
"""

import json
import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from warpgrains.errors import InputError, OutputError
from warpgrains.files import columns_of, csv_line, make_folder, read_regular, write_atomically
from warpgrains.sweep.execution import RunSettings
from warpgrains.sweep.results import MET, SECONDS, value_columns
from warpgrains.sweep.run_folder import RESULT, RunFolder
from warpgrains.sweep.shards import ResultShards, writer
from warpgrains.sweep.sweep import GRAINS, BaseScene, Run, Sweep

RESULTS = "results.csv"
AREA = "packing_fraction"
HOW_TO_CONTINUE = "use --resume to continue the sweep, or choose another -o"


class Outcomes(NamedTuple):
    finished: set[int]
    failed: dict[int, str]
    """Reasons of the failed runs, by number."""
    unconverged: set[int]
    """Runs with a step that did not meet the tolerance."""
    unmet: set[int] | None
    """Runs that ended before their end criterion was met; None if they have none."""
    without_area: set[int]
    """Runs whose packing fraction is not a number, because its area is unknown."""


class SweepFolder:
    """The output folder of a sweep.

    `results` is the table of all results, which do not depend on when and where a run was done; `timing` that
    of the times for steps and for completing recordings [s]; `shards` the results of the runs without a
    folder.
    """

    def __init__(self, path: Path, axes: tuple[str, ...], settings: RunSettings):
        self.path, self.settings, self._axes = path, settings, axes
        self.columns = ["run", "scene", *axes, *value_columns(settings)]
        self.results, self.timing = path / RESULTS, path / "timing.csv"
        self.shards = ResultShards(path / "parts", [*self.columns, SECONDS])
        self._runs, self._settings_file = path / "runs", path / "settings.json"

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.path, self._axes, self.settings)

    def of(self, run: Run) -> RunFolder:
        """Return the folder of a run, which may not exist yet."""
        return RunFolder(self._of(run.number), run, self.settings)

    def _of(self, number: int) -> Path:
        return self._runs / f"{number:05}"

    def write_common_files(self, sweep: Sweep) -> None:
        """Write the files that all runs have in common, the settings first, unless they exist."""
        _write_if_missing(self._settings_file, f"{json.dumps(self._settings_by_option)}\n".encode())
        for base in sweep.bases:
            _write_if_missing(self._scene_file(base), base.text.encode())
            for source, copy in base.grain_files.values():
                _write_if_missing(self.path / GRAINS / copy, source.read_bytes())
        self._require_common_files(sweep)

    def _scene_file(self, base: BaseScene) -> Path:
        return self.path / "scenes" / f"{base.name}.toml"

    @property
    def _settings_by_option(self) -> dict[str, Any]:
        """Content of the file of the settings, which is no TOML: in a folder, that would be a scene."""
        settings = self.settings
        return {"measure": list(settings.measured), "until": settings.until, "region": settings.region}

    def create_or_check(self, sweep: Sweep, share: list[Run], resume: bool) -> None:
        """Create the folder, or check that a share of runs may continue; rename damaged shards."""
        make_folder(self.path)
        self._require_common_files(sweep)
        in_shards, with_folders = self.in_shards(sweep.runs), self.with_folders()
        self.shards.set_damaged_aside()
        for run in share:
            if run.number in in_shards and not resume:
                raise InputError(f"'{self.path}' has results: {HOW_TO_CONTINUE}")
            if run.number in with_folders:
                folder = self.of(run)
                if folder.scene_file.exists() and not resume:
                    raise InputError(f"'{folder.path}' exists: {HOW_TO_CONTINUE}")
                folder.require_this_sweep()

    def _require_common_files(self, sweep: Sweep) -> None:
        """Raise OutputError if the folder holds other settings, or other scenes or files of these names."""
        self._require_settings(sweep)
        for base in sweep.bases:
            scene = self._scene_file(base)
            if scene.exists() and read_regular(scene) != base.text.encode():
                raise OutputError(f"'{scene}' is of a sweep with another scene: choose another -o")
            for source, name in base.grain_files.values():
                copy = self.path / GRAINS / name
                if copy.exists() and read_regular(copy) != source.read_bytes():
                    raise OutputError(f"'{copy}' is damaged: delete it to have it copied from '{source}'")

    def _require_settings(self, sweep: Sweep) -> None:
        """Raise OutputError if the settings in the folder differ, or are missing next to its other files.

        `write_common_files` writes them first; they are searched last, to find those of another process.
        """
        others = [path for path in (self.results, *map(self._scene_file, sweep.bases)) if path.exists()]
        others += self.shards.path.glob("[0-9]*.csv")
        file, own = self._settings_file, self._settings_by_option
        if not file.exists():
            if others:
                missing = f"'{file}', which every sweep has, does not exist"
                raise OutputError(f"refusing to overwrite '{others[0]}': {missing}")
            return
        content, found = read_regular(file), None
        with suppress(ValueError, RecursionError):
            found = json.loads(content)
        if not isinstance(found, dict) or found.keys() != own.keys():
            raise OutputError(
                f"'{file}' does not hold the settings of a sweep: restore it, or choose another -o"
            )
        differing = [_option(name, value) for name, value in found.items() if value != own[name]]
        if differing:
            raise OutputError(f"'{file}' is of a sweep with {' and '.join(differing)}: choose another -o")

    def unfinished(self, runs: Sequence[Run]) -> list[Run]:
        """Return those of some runs that have no result."""
        in_folders, in_shards = self._finished(runs)
        return [run for run in runs if run.number not in in_folders and run.number not in in_shards]

    def with_folders(self) -> set[int]:
        """Return the numbers of the runs that have a folder."""
        try:
            with os.scandir(self._runs) as entries:
                return {int(entry.name) for entry in entries if entry.name.isdecimal()}
        except FileNotFoundError:
            return set()

    def in_shards(self, runs: Sequence[Run]) -> set[int]:
        """Return which of some runs have a result in a shard; OutputError if it is of another sweep."""
        numbers = {run.number for run in runs}
        new = self.shards.refresh(numbers)
        for run in runs:
            if run.number in new:
                self.shards.require_this_run(run.number, run.labels())
        return numbers & self.shards.lines.keys()

    def _finished(self, runs: Sequence[Run]) -> tuple[set[int], set[int]]:
        """Return the numbers of those of some runs with a result, or failure, in a folder, and in a shard."""
        in_shards, candidates = self.in_shards(runs), {run.number for run in runs} & self.with_folders()
        return {number for number in candidates if (self._of(number) / RESULT).exists()}, in_shards

    def write_tables(self, sweep: Sweep) -> Outcomes:
        """Write the tables of all finished runs, and return their numbers by outcome.

        They are written again if more have finished meanwhile: of several processes, the last tables are
        complete.
        """
        in_folders, in_shards = self._finished(sweep.runs)
        while True:
            finished = in_folders | in_shards
            if not finished:
                return Outcomes(finished, {}, set(), None if self.settings.until is None else set(), set())
            results, timing = [csv_line(self.columns)], [csv_line(["run", SECONDS])]
            for run in sweep.runs:
                if run.number in finished:
                    has_folder = run.number in in_folders
                    line = self.of(run).line() if has_folder else self.shards.lines[run.number]
                    result, _, seconds = line.rpartition(b",")
                    results.append(result + b"\n")
                    timing.append(b"%d,%b" % (run.number, seconds))
            _write(self.results, results)
            _write(self.timing, timing)
            in_folders, in_shards = self._finished(sweep.runs)
            if in_folders | in_shards == finished:
                return self._outcomes(finished, results)

    def _outcomes(self, finished: set[int], results: list[bytes]) -> Outcomes:
        """Return the numbers of runs by outcome from the lines of the table of results."""
        met = [] if self.settings.until is None else [MET]
        found = columns_of(map(bytes.decode, results), lambda _: ("run", "error", "unconverged", AREA, *met))
        numbers = list(map(int, found["run"]))
        errors = {number: error for number, error in zip(numbers, found["error"], strict=True) if error}

        def good(column: str, *values: str) -> set[int]:
            cells = zip(numbers, found[column], strict=True)
            return {number for number, cell in cells if cell in values and number not in errors}

        unconverged = set(numbers) - errors.keys() - good("unconverged", "0", "")
        unmet = good(MET, "0") if met else None
        return Outcomes(finished, errors, unconverged, unmet, good(AREA, "nan"))


def _option(name: str, value: Any) -> str:
    """Return the option of the command line that gives a setting."""
    text = ",".join(map(str, value)) if isinstance(value, list) else value
    return f"--{name} {text or 'none'}"


def _write_if_missing(path: Path, content: bytes) -> None:
    """Write a file, unless it exists: of several processes that write it, the first one does."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, content, writer(), replace=False)


def _write(table: Path, lines: Iterable[bytes]) -> None:
    content = b"".join(lines)
    if not table.is_file() or table.read_bytes() != content:
        write_atomically(table, content, writer())
