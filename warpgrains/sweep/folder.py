"""The folder of a sweep: results of runs, and tables of them all, which are made of those alone.

================== ==========================================================================================
results.csv        the results of all runs that are finished; timing.csv, how long they took
scenes/NAME.toml   what the runs of a scene have in common; their values on the axes are in their results
parts/             results of runs that left nothing else: see `Parts`
runs/00042/        the folder of a run that has one: since it is recorded, or asked for by ``--folders``; took
                   long; failed
grains/            copies of files of grains
================== ==========================================================================================
"""

import os
import socket
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from warpgrains.errors import OutputError
from warpgrains.files import csv_line, read_regular, write_whole
from warpgrains.sweep.parts import Parts
from warpgrains.sweep.results import MET, SECONDS, columns_of, more_columns
from warpgrains.sweep.run_folder import RESULT, RunFolder
from warpgrains.sweep.sweep import Base, Run, Sweep, copy_name

RESULTS = "results.csv"
TIMING = "timing.csv"

GRAINS = "grains"

_RUNS, _PARTS, _SCENES = "runs", "parts", "scenes"


class Tables(NamedTuple):
    """What the tables tell of the runs that are finished."""

    finished: set[int]
    failed: dict[int, str]
    """Why they failed."""
    unconverged: set[int]
    """Those with a step that stopped short of the tolerance."""
    unmet: set[int] | None
    """Those that have ended before their criterion was met; None if they have none."""


class SweepFolder:
    """Where a sweep writes.

    Parameters
    ----------
    path
        The folder.
    axes
        Keys of the axes of the sweep.
    measured
        Names of quantities that are measured.
    until
        What ends each run before its last step, see `criterion`.
    """

    def __init__(
        self,
        path: Path,
        axes: Iterable[str] = (),
        measured: Iterable[str] = (),
        until: str | None = None,
    ):
        self.path, self.axes, self.measured, self.until = path, tuple(axes), tuple(measured), until
        self.parts = Parts(path / _PARTS, [*self.columns, SECONDS])

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.path, self.axes, self.measured, self.until)

    @property
    def results(self) -> Path:
        """The results of all runs, none of which depends on when and where the run was done."""
        return self.path / RESULTS

    @property
    def timing(self) -> Path:
        """How long the runs took [s]."""
        return self.path / TIMING

    @property
    def columns(self) -> list[str]:
        """The columns of the results."""
        return ["run", "scene", *self.axes, *columns_of(self.more)]

    @property
    def more(self) -> tuple[str, ...]:
        """The columns of the results that not every sweep has."""
        return more_columns(self.measured, self.until)

    def of(self, run: Run) -> RunFolder:
        """Return the folder of a run, which need not be there."""
        scene = run.text(f"../../{GRAINS}")
        return RunFolder(self._path(run.number), run.labels(), scene, self.measured, self.until)

    def _common(self, base: Base) -> bytes:
        """Return the file of what the runs of a scene have in common."""
        head = "" if self.until is None else f"# Its runs end earlier, at {self.until}\n"
        return f"{head}{base.text}".encode()

    def prepare(self, sweep: Sweep) -> None:
        """Write what the runs have in common, so that the folder holds all that they are.

        Raises
        ------
        OutputError
            It is there, and other than this sweep's.
        """
        for base in sweep.bases:
            files = {self.path / _SCENES / f"{base.name}.toml": self._common(base)}
            copies = base.grain_files.values()
            files |= {self.path / GRAINS / copy_name(source): source.read_bytes() for source in copies}
            for path, content in files.items():
                if not path.exists():
                    path.parent.mkdir(parents=True, exist_ok=True)
                    write_whole(path, content, writer())

    def require_own(self, sweep: Sweep) -> None:
        """Raise OutputError or SceneError if results here are of another sweep."""
        for base in sweep.bases:
            scene = self.path / _SCENES / f"{base.name}.toml"
            if scene.exists() and read_regular(scene) != self._common(base):
                raise OutputError(
                    f"'{scene}' is another scene than this sweep starts from, or has another --until:"
                    " choose another -o"
                )
        self.parts.refresh(range(len(sweep.runs)))
        for run in sweep.runs:
            line = self.parts.lines.get(run.number)
            if line is not None and not line.startswith(csv_line(run.labels().values())[:-1] + b","):
                raise OutputError(
                    f"run {run.number} in '{self.parts.path}' is another than this sweep's: choose another -o"
                )

    def begun(self) -> set[int]:
        """Return the numbers of the runs that have a folder."""
        try:
            with os.scandir(self.path / _RUNS) as entries:
                return {int(entry.name) for entry in entries if entry.name.isdecimal()}
        except FileNotFoundError:
            return set()

    def finished(self, runs: Sequence[Run]) -> set[int]:
        """Return the numbers of those of some runs that have a result, good or bad."""
        numbers = {run.number for run in runs}
        self.parts.refresh(numbers)
        return (numbers & self.parts.lines.keys()) | self._with_result(numbers)

    def _with_result(self, numbers: set[int]) -> set[int]:
        """Return those that have a result in a folder."""
        return {number for number in numbers & self.begun() if (self._path(number) / RESULT).exists()}

    def write_tables(self, sweep: Sweep) -> Tables:
        """Write the tables of all finished runs, and return what they tell.

        Who finds, after writing, that more runs have finished meanwhile writes again. So when several
        processes share a sweep, whoever writes last has all results, without waiting for one another.
        """
        while True:
            finished = self.finished(sweep.runs)
            order = [run.number for run in sweep.runs if run.number in finished]
            lines, failed = self._lines(sweep, finished)
            if finished:
                split = [line[:-1].rpartition(b",") for line in lines]
                self._write(self.results, self.columns, (line for line, _, _ in split))
                seconds = (line.partition(b",")[0] + b"," + cell for line, _, cell in split)
                self._write(self.timing, ["run", SECONDS], seconds)
            if self.finished(sweep.runs) == finished:
                good = [(run, line) for run, line in zip(order, lines, strict=True) if run not in failed]
                unconverged = {
                    run for run, line in good if self._cell(line, "unconverged") not in (b"0", b"")
                }
                unmet = None
                if self.until is not None:
                    unmet = {run for run, line in good if self._cell(line, MET) == b"0"}
                return Tables(finished, failed, unconverged, unmet)

    def _lines(self, sweep: Sweep, finished: set[int]) -> tuple[list[bytes], dict[int, str]]:
        """Return the lines of finished runs in order, and why some failed."""
        lines, failed = dict(self.parts.lines), {}
        folders = self._with_result(finished)
        for run in sweep.runs:
            if run.number in folders:
                row = self.of(run).row()
                lines[run.number] = csv_line(row.values())
                if row["error"]:
                    failed[run.number] = row["error"]
        return [lines[run.number] for run in sweep.runs if run.number in finished], failed

    def _write(self, table: Path, columns: list[str], lines: Iterable[bytes]) -> None:
        content = csv_line(columns) + b"".join(line + b"\n" for line in lines)
        if not table.is_file() or table.read_bytes() != content:
            write_whole(table, content, writer())

    def _cell(self, line: bytes, column: str) -> bytes:
        """Return a number of the line of a run that has not failed."""
        after = len(self.columns) - self.columns.index(column)  # columns, the seconds among them
        return line.rsplit(b",", after + 1)[1]

    def _path(self, number: int) -> Path:
        return self.path / _RUNS / f"{number:05}"


def writer() -> str:
    """Name this process among all that may write here."""
    return f".{socket.gethostname()}.{os.getpid()}"
