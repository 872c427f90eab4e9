"""The folder of a sweep: a folder a run, and tables of all results, which are made of those folders alone.

The folder of one run holds

================== ==========================================================================================
scene.toml         what is simulated; alone it gives the run again
checkpoint.npz     its state, now and then and at the end: ``warpgrains run --resume`` takes it on from there
recording.usdc     its frames, if they are wanted
result.csv         a line of names and a line of values; it appears last: a run that has it is finished
================== ==========================================================================================
"""

import os
import shutil
import socket
from dataclasses import dataclass, replace
from pathlib import Path

from warpgrains.errors import OutputError, SceneError
from warpgrains.files import Row, read_table, table_text, write_whole
from warpgrains.locks import Lock
from warpgrains.scene.reader import scene_fields
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import first_state
from warpgrains.scene.toml_text import toml_value
from warpgrains.simulation.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from warpgrains.simulation.options import RunOptions
from warpgrains.solver.statistics import RunStatistics
from warpgrains.sweep.results import SECONDS, UNITS, failure, require_result
from warpgrains.sweep.sweep import Run, Sweep, copy_name

RESULTS = "results.csv"
TIMING = "timing.csv"
RESULT = "result.csv"

AGAIN = "delete the run's folder to do it again"

_RUNS, _GRAINS = "runs", "grains"


@dataclass(frozen=True)
class RunFolder:
    """The files of one run."""

    path: Path
    """The folder."""
    labels: Row
    """What tells it from others: the first columns of its result, "run" and "scene" among them."""
    text: str
    """Its scene file."""

    @property
    def scene_file(self) -> Path:
        """What is simulated."""
        return self.path / "scene.toml"

    @property
    def checkpoint(self) -> Path:
        """The state."""
        return self.path / "checkpoint.npz"

    @property
    def recording(self) -> Path:
        """The frames."""
        return self.path / "recording.usdc"

    @property
    def result(self) -> Path:
        """The result."""
        return self.path / RESULT

    @property
    def is_begun(self) -> bool:
        """Whether there is anything of this run."""
        return self.scene_file.exists()

    @property
    def is_finished(self) -> bool:
        """Whether the run has its result, good or bad."""
        return self.result.exists()

    def require_own(self) -> None:
        """Raise OutputError if what is there is a run of something else, and SceneError if it is damaged."""
        if not self.is_begun:
            return
        try:
            found = self.scene_file.read_bytes().decode()
        except UnicodeDecodeError:
            raise SceneError(f"'{self.scene_file}' is no text: {AGAIN}") from None
        if found != self.text:
            raise OutputError(
                f"'{self.scene_file}' is another scene than this run of the sweep: choose another -o"
            )

    def lock(self) -> Lock:
        """Return the lock on the run, that on its checkpoint: no sweep and no ``run --resume`` shares it."""
        self.path.mkdir(parents=True, exist_ok=True)
        return Lock(self.checkpoint)

    def begin(self, fps: float | None) -> Checkpoint:
        """Return where the run, which is locked, is: at its start, or where another process left it.

        If it is to be recorded, then with `fps` frames a second of simulated time [1/s]; but a run that is
        resumed keeps to what it was begun with.

        Raises
        ------
        SceneError
            Its scene is none, or its checkpoint is damaged; as an `OutputError`, if it is finished, or is
            the run of something else.
        """
        self.require_own()
        if self.is_finished:
            raise OutputError("another process has finished it")
        if self.checkpoint.exists():
            return self._kept()
        scene = Scene(**{**scene_fields(self.text, self.scene_file), "name": self.labels["scene"]})
        options = RunOptions(steps=scene.steps, checkpoint=str(self.checkpoint))
        if fps is not None:
            from warpgrains.usd.recorder import chunks_of

            shutil.rmtree(chunks_of(self.recording), ignore_errors=True)
            options = replace(options, record=str(self.recording), fps=fps)
        return Checkpoint(scene, first_state(scene), options, RunStatistics())

    def _kept(self) -> Checkpoint:
        """Return the checkpoint of this run; what it says of places counts for nothing."""
        kept = read_checkpoint(self.checkpoint)
        options = kept.options
        if options is None or kept.scene.text != self.text or options.steps != kept.scene.steps:
            raise SceneError(f"checkpoint '{self.checkpoint}' is of another run: {AGAIN}")
        record = None if options.record is None else str(self.recording)
        return replace(kept, options=replace(options, record=record, checkpoint=str(self.checkpoint)))

    def keep(self, reached: Checkpoint) -> None:
        """Save where the run is."""
        self._write_scene()
        write_checkpoint(self.checkpoint, reached)

    def finish(self, row: Row) -> None:
        """Save the result: from then on the run is finished."""
        self._write_scene()
        write_whole(self.result, table_text([row]).encode())

    def row(self) -> Row:
        """Return the result; if it cannot be read, that the run has failed for this reason."""
        try:
            return require_result(read_table(self.result), self.labels)
        except SceneError:
            return failure(self.labels, f"{RESULT} is damaged: {AGAIN}")

    def _write_scene(self) -> None:
        if not self.is_begun:
            write_whole(self.scene_file, self.text.encode())


@dataclass(frozen=True)
class SweepFolder:
    """Where a sweep writes."""

    path: Path
    """The folder."""

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
            rows = [self.of(run).row() for run in finished]
            seconds = [{"run": row["run"], SECONDS: row.pop(SECONDS)} for row in rows]
            write_whole(self.results, table_text(rows).encode(), _writer())
            write_whole(self.timing, table_text(seconds).encode(), _writer())
            if len(self._finished(sweep)) == len(finished):
                return rows
        return []

    def is_finished(self, run: Run) -> bool:
        """Whether a run has its result, good or bad."""
        return (self._path(run) / RESULT).exists()

    def _finished(self, sweep: Sweep) -> list[Run]:
        return [run for run in sweep.runs if self.is_finished(run)]

    def _path(self, run: Run) -> Path:
        return self.path / _RUNS / f"{run.number:05}"


def _cell(value: object) -> str:
    return value if isinstance(value, str) else toml_value(value)


def _writer() -> str:
    """Name this process among all that may write here."""
    return f".{socket.gethostname()}.{os.getpid()}"
