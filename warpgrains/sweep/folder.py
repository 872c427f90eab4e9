"""The folder of a sweep: a folder a run, and tables of all results, which are made of those folders alone."""

import os
import socket
from dataclasses import dataclass
from pathlib import Path

from warpgrains.files import write_whole
from warpgrains.scene.toml_text import toml_value
from warpgrains.sweep.results import SECONDS, UNITS
from warpgrains.sweep.run_folder import RESULT, RunFolder
from warpgrains.sweep.sweep import Run, Sweep, copy_name
from warpgrains.tables import Row, read_table, table_text

RESULTS = "results.csv"
TIMING = "timing.csv"

_RUNS, _GRAINS = "runs", "grains"


@dataclass(frozen=True)
class SweepFolder:
    """Where a sweep writes.

    Attributes
    ----------
    path : Path
        The folder.
    """

    path: Path

    @property
    def results(self) -> Path:
        """The results of all runs, none of which depends on when and where the run was done."""
        return self.path / RESULTS

    @property
    def timing(self) -> Path:
        """How long the runs took [s]."""
        return self.path / TIMING

    def columns(self, sweep: Sweep) -> list[str]:
        """Return the columns of the results."""
        return ["run", "scene", *sweep.axes, *UNITS]

    def of(self, run: Run) -> RunFolder:
        """Return the folder of a run."""
        labels = {"run": str(run.number), "scene": run.base.name}
        labels |= {key: _cell(value) for key, value in run.values.items()}
        return RunFolder(self._path(run), labels, run.text(f"../../{_GRAINS}"))

    def copy_grain_files(self, sweep: Sweep) -> None:
        """Copy the files of grains that the runs read, so that the folder holds all that the runs are."""
        for base in {run.base for run in sweep.runs}:
            for source in base.grain_files.values():
                copy = self.path / _GRAINS / copy_name(source)
                if not copy.exists():
                    copy.parent.mkdir(parents=True, exist_ok=True)
                    write_whole(copy, source.read_bytes(), _writer())

    def write_tables(self, sweep: Sweep) -> list[Row]:
        """Write the tables of all finished runs, and return the results.

        Who finds, after writing, that more runs have finished meanwhile writes again. So when several
        processes share a sweep, whoever writes last has all results, without waiting for one another.
        """
        while finished := self._finished(sweep):
            rows = [read_table(result)[0] for result in finished]
            seconds = [{"run": row["run"], SECONDS: row.pop(SECONDS)} for row in rows]
            write_whole(self.results, table_text(rows).encode(), _writer())
            write_whole(self.timing, table_text(seconds).encode(), _writer())
            if len(self._finished(sweep)) == len(finished):
                return rows
        return []

    def is_finished(self, run: Run) -> bool:
        """Whether a run has its result, good or bad."""
        return self._result(run).exists()

    def _finished(self, sweep: Sweep) -> list[Path]:
        return [self._result(run) for run in sweep.runs if self.is_finished(run)]

    def _result(self, run: Run) -> Path:
        return self._path(run) / RESULT

    def _path(self, run: Run) -> Path:
        return self.path / _RUNS / f"{run.number:05}"


def _cell(value: object) -> str:
    return value if isinstance(value, str) else toml_value(value)


def _writer() -> str:
    """Name this process among all that may write here."""
    return f".{socket.gethostname()}.{os.getpid()}"
