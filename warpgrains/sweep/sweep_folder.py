"""The folder of a sweep: results of runs, and tables that are made only from these results.

================== ==========================================================================================
results.csv        the results of all runs that are finished; timing.csv, how long they took
settings.json      the settings of all runs, see `RunSettings`, and their scenes and axes
scenes/NAME.toml   the common part of the runs of a scene; their values on the axes are in their results
parts/             results of runs, see `ResultShards`
runs/00042/        outputs and checkpoint of a run, see `SweepRun`
grains/            copies of files of grains
================== ==========================================================================================
"""

import json
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from warpgrains.base.errors import InputError, OutputError
from warpgrains.base.files import columns_of, csv_line, make_folder, read_regular, write_atomically
from warpgrains.sweep.execution import RunSettings
from warpgrains.sweep.results import MET, SECONDS, value_columns
from warpgrains.sweep.shards import ResultShards, has_failed, writer
from warpgrains.sweep.sweep import GRAINS, BaseScene, Run, Sweep, have_same_runs

RESULTS = "results.csv"
COUNTED = UNCONVERGED, AREA = "unconverged", "pile_packing_fraction"
HOW_TO_CONTINUE = "use --resume to continue the sweep, or choose another -o"


class SweepFolder:
    """The output folder of a sweep.

    `results` is the path of the table of all results, which do not depend on when and where a run was done.
    `timing` is the path of a table of times [s], for the steps of each run and for completing its recording.
    `shards` has the results of groups of runs.
    """

    def __init__(self, path: Path, axes: tuple[str, ...], settings: RunSettings):
        self.path, self.settings, self._axes = path, settings, axes
        self.columns = ["run", "scene", *axes, *value_columns(settings)]
        self.results, self.timing = path / RESULTS, path / "timing.csv"
        self.shards = ResultShards(path / "parts", [*self.columns, SECONDS])
        self._runs, self._settings_file = path / "runs", path / "settings.json"

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.path, self._axes, self.settings)

    def of(self, run: Run) -> Path:
        """Return the folder of a run, which may not exist yet."""
        return self._runs / f"{run.number:05}"

    def write_common_files(self, sweep: Sweep) -> None:
        """Write the files that all runs have in common, the settings first, unless they exist."""
        _write_if_missing(self._settings_file, f"{json.dumps(self._settings_of(sweep))}\n".encode())
        for base in sweep.bases:
            _write_if_missing(self._scene_file(base), base.text.encode())
            for source, copy in base.grain_files.values():
                _write_if_missing(self.path / GRAINS / copy, source.read_bytes())
        self._require_common_files(sweep)

    def _scene_file(self, base: BaseScene) -> Path:
        return self.path / "scenes" / f"{base.name}.toml"

    def _settings_of(self, sweep: Sweep) -> dict[str, Any]:
        """Return the content of the settings file, which is JSON, because TOML files are read as scenes."""
        own = self.settings._asdict()
        return {"measure": list(own.pop("measured")), **own, "runs": sweep.plan}

    def create_or_check(self, sweep: Sweep, share: list[Run], resume: bool) -> None:
        """Create the folder, or check that the runs `share` may be done in it; rename damaged shards.

        OutputError if the folder is of another sweep. InputError if one of these runs has a result or
        outputs, unless `resume`.
        """
        make_folder(self.path)
        self._require_common_files(sweep)
        finished, with_folders = self.finished(sweep.runs), self.with_folders()
        self.shards.set_damaged_aside()
        if not resume:
            for run in share:
                if run.number in finished:
                    raise InputError(f"'{self.path}' has results: {HOW_TO_CONTINUE}")
                if run.number in with_folders and any(self.of(run).glob("[!.]*")):
                    raise InputError(f"'{self.of(run)}' exists: {HOW_TO_CONTINUE}")

    def _require_common_files(self, sweep: Sweep) -> None:
        """Raise OutputError if settings, scenes or files of grains in the folder differ from the sweep's."""
        self._require_settings(sweep)
        for base in sweep.bases:
            scene = self._scene_file(base)
            if scene.exists() and read_regular(scene) != base.text.encode():
                raise OutputError(f"'{scene}' is of a sweep with another scene or [set]: choose another -o")
            for source, name in base.grain_files.values():
                copy = self.path / GRAINS / name
                if copy.exists() and read_regular(copy) != source.read_bytes():
                    raise OutputError(f"'{copy}' is damaged: delete it to have it copied from '{source}'")

    def _require_settings(self, sweep: Sweep) -> None:
        """Raise OutputError if the settings in the folder differ, or are missing next to its other files.

        `write_common_files` writes settings before other files; this method searches other files first. So a
        folder that another process is creating passes.
        """
        others = [path for path in (self.results, *map(self._scene_file, sweep.bases)) if path.exists()]
        others += self.shards.path.glob("[0-9]*.csv")
        file, own = self._settings_file, self._settings_of(sweep)
        if not file.exists():
            if others:
                missing = f"'{file}', which every sweep has, does not exist"
                raise OutputError(f"refusing to overwrite '{others[0]}': {missing}")
            return
        content, own = read_regular(file), json.loads(json.dumps(own))
        try:
            found = dict(json.loads(content))
            has_same_runs = have_same_runs(found.pop("runs"), own.pop("runs"))
            is_whole = found.keys() == own.keys()
        except (ValueError, TypeError, LookupError, AttributeError, RecursionError):
            is_whole = False
        if not is_whole:
            raise OutputError(
                f"'{file}' does not hold the settings of a sweep: restore it, or choose another -o"
            )
        differing = [_option(name, value) for name, value in found.items() if value != own[name]]
        if not has_same_runs:
            differing.append("with other scenes or axes")
        if differing:
            how = "give the same options and sweep file, or choose another -o"
            raise OutputError(f"'{self.path}' holds a sweep {' and '.join(differing)}: {how}")

    def unfinished(self, runs: Sequence[Run]) -> list[Run]:
        """Return those of the runs that have no result, and those that failed in an earlier process."""
        found = self.finished(runs)
        self.shards.repeated |= {number for number in found if has_failed(self.shards.lines[number])}
        found -= self.shards.repeated
        return [run for run in runs if run.number not in found]

    def finished(self, runs: Sequence[Run]) -> set[int]:
        """Return the numbers of those runs that need not be done (again).

        They have a result, or have failed in this process. OutputError if a result is of another sweep.
        """
        self._has_more(runs)
        return ({run.number for run in runs} & self.shards.lines.keys()) - self.shards.repeated

    def _has_more(self, runs: Sequence[Run]) -> bool:
        """Read results of these runs that other processes have written; return whether there are new ones."""
        new = self.shards.refresh({run.number for run in runs})
        for run in runs:
            if run.number in new:
                self.shards.require_this_run(run.number, run.labels())
        return bool(new)

    def with_folders(self) -> set[int]:
        """Return the numbers of all runs that have a folder."""
        try:
            with os.scandir(self._runs) as entries:
                return {int(entry.name) for entry in entries if entry.name.isdecimal()}
        except FileNotFoundError:
            return set()

    def write_tables(self, sweep: Sweep) -> dict[str, list[str]]:
        """Write both tables of all finished runs; return the columns that a summary needs, as cells by name.

        The tables are written again if other processes have finished runs meanwhile, so that the last process
        writes complete tables.
        """
        wanted = ["run", "error", *COUNTED, *({MET} & set(self.columns))]
        self._has_more(sweep.runs)
        while True:
            results, timing = [csv_line(self.columns)], [csv_line(["run", SECONDS])]
            for run in sweep.runs:
                if run.number in self.shards.lines:
                    result, _, seconds = self.shards.lines[run.number].rpartition(b",")
                    results.append(result + b"\n")
                    timing.append(b"%d,%b" % (run.number, seconds))
            if len(results) > 1:
                _write(self.results, results)
                _write(self.timing, timing)
            if not self._has_more(sweep.runs):
                return columns_of(map(bytes.decode, results), lambda _: wanted)


def _option(name: str, value: Any) -> str:
    """Return text for messages on an option of a sweep, such as "with --until rest" or "without --until"."""
    text = ",".join(map(str, value)) if isinstance(value, list) else value
    return f"with --{name} {text}" if text else f"without --{name}"


def _write_if_missing(path: Path, content: bytes) -> None:
    """Write a file unless it exists. If several processes write it at once, the first file stays."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, content, writer(), replace=False)


def _write(table: Path, lines: Iterable[bytes]) -> None:
    content = b"".join(lines)
    if not table.is_file() or table.read_bytes() != content:
        write_atomically(table, content, writer())
