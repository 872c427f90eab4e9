"""The folder of one run, which holds all that it takes to continue it.

================== ==========================================================================================
scene.toml         what is simulated; alone it gives the run again
checkpoint.npz     its state, now and then and at the end: ``warpgrains run --resume`` takes it on from there
recording.usdc     its frames, if they are wanted
series.csv         what is measured as it goes, if that is wanted
result.csv         a line of names and a line of values; it appears last: a run that has it is finished
================== ==========================================================================================
"""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from warpgrains.analysis.quantities import QUANTITIES
from warpgrains.errors import InputError, OutputError
from warpgrains.files import csv_line, read_regular, read_table, table_text, write_whole
from warpgrains.locks import Lock
from warpgrains.scene.document import parse_toml
from warpgrains.scene.reader import scene_fields
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import first_state
from warpgrains.simulation.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from warpgrains.simulation.options import ExecutionOptions, RunOptions
from warpgrains.solver.statistics import RunStatistics
from warpgrains.sweep.results import MET, SECONDS, Columns, Values, failure, require_result
from warpgrains.sweep.shards import OTHERWISE
from warpgrains.sweep.sweep import Run

RESULT = "result.csv"
GRAINS = "grains"
AGAIN = "delete the folder of the run to repeat it"


class RunFolder:
    """The files of one run.

    Parameters
    ----------
    path : Path
        The folder.
    run : Run
    columns : Columns
        Of the results of the sweep.

    Attributes
    ----------
    labels : dict of str to str
        The first columns of its result.
    """

    def __init__(self, path: Path, run: Run, columns: Columns):
        self.path, self.labels, self.columns = path, run.labels(), columns
        self.number, self._text = run.number, run.text(f"../../{GRAINS}")
        self.scene_file, self.checkpoint = path / "scene.toml", path / "checkpoint.npz"
        self.recording, self.series = path / "recording.usdc", path / "series.csv"
        self.result = path / RESULT

    def require_own(self) -> None:
        """Raise OutputError if the folder is that of another run, and InputError if it is damaged."""
        if not self.scene_file.exists():
            return
        try:
            found = read_regular(self.scene_file).decode()
        except UnicodeDecodeError:
            raise InputError(f"'{self.scene_file}' is not text: {AGAIN}") from None
        except InputError as error:
            raise InputError(f"{error}: {AGAIN}") from None
        if self._is_of_another(found):
            raise OutputError(f"'{self.scene_file}' is the scene of another sweep: choose another -o")
        if found != self._text:
            raise InputError(f"'{self.scene_file}' is damaged: {AGAIN}")
        if self.result.exists() and self._measures_otherwise():
            raise OutputError(f"'{self.result}' {OTHERWISE}")

    def require_no_other(self) -> None:
        """Raise OutputError if the folder is that of another run; damage makes the run fail in its turn."""
        try:
            self.require_own()
        except OutputError:
            raise
        except (InputError, OSError):
            pass

    def _is_of_another(self, found: str) -> bool:
        """Return whether a scene file is whole, and that of another run: else it is this run's, or damaged.

        The first line names the run and its values, which the lines after it have too: in the file of another
        run, both differ.
        """
        (head, _, body), (own_head, _, own_body) = found.partition("\n"), self._text.partition("\n")
        if head == own_head or body == own_body or not head.startswith("# run "):
            return False
        try:
            parse_toml(found, self.scene_file)
        except InputError:
            return False
        return True

    def _measures_otherwise(self) -> bool:
        """Return whether the result has good columns, but not those of this sweep."""
        with suppress(OSError, InputError):
            names = read_regular(self.result).partition(b"\n")[0].decode(errors="replace").split(",")
            until = "rest" if MET in names else None
            columns = Columns(
                measured=tuple(filter(QUANTITIES.__contains__, names)), until=until
            ).after_labels
            return names == [*self.labels, *columns, SECONDS] and columns != self.columns.after_labels
        return False

    def lock(self) -> Lock:
        """Return the lock on the run, that on its checkpoint: no sweep and no ``run --resume`` shares it."""
        self.path.mkdir(parents=True, exist_ok=True)
        return Lock(self.checkpoint)

    def begin(self, execution: ExecutionOptions) -> Checkpoint:
        """Return where the run, which is locked, is: at its start, or where another process left it.

        It is recorded as `execution` says; but a run that is resumed keeps to what it was begun with.

        Raises
        ------
        InputError
            Its scene is none, or its checkpoint is damaged; as an `OutputError`, if it is finished, or the
            folder is that of another run.
        """
        self.require_own()
        if self.result.exists():
            raise OutputError("another process has finished it")
        if self.checkpoint.exists():
            return self._kept()
        scene = Scene(**{**scene_fields(self._text, self.scene_file), "name": self.labels["scene"]})
        wanted: dict[str, Any] = {}
        if execution.fps is not None:
            from warpgrains.usd.recorder import log_of

            log_of(self.recording).unlink(missing_ok=True)
            wanted = {"record": str(self.recording), "fps": execution.fps}
        if execution.measure_every is not None:
            measure = ",".join(self.columns.measured)
            wanted |= {
                "measure": measure,
                "measure_every": execution.measure_every,
                "series": str(self.series),
            }
        options = RunOptions(
            steps=scene.steps, checkpoint=str(self.checkpoint), until=self.columns.until, **wanted
        )
        return Checkpoint(scene, first_state(scene), options, RunStatistics())

    def _kept(self) -> Checkpoint:
        """Return the checkpoint of this run; the places that it names count for nothing."""
        kept = read_checkpoint(self.checkpoint)
        options = kept.options
        steps = kept.statistics.steps if kept.statistics.met else kept.scene.steps
        own = (self._text, self.columns.until, steps)
        if options is None or (kept.scene.text, options.until, options.steps) != own:
            raise InputError(f"checkpoint '{self.checkpoint}' is of another run: {AGAIN}")
        record = None if options.record is None else str(self.recording)
        series = None if options.series is None else str(self.series)
        places: dict[str, Any] = {"record": record, "series": series, "checkpoint": str(self.checkpoint)}
        return replace(kept, options=replace(options, **places))

    def keep(self, reached: Checkpoint) -> None:
        """Save where the run is."""
        self._write_scene()
        write_checkpoint(self.checkpoint, reached)

    def finish(self, values: Values) -> None:
        """Save the result of the run: from then on it is finished."""
        self._write_scene()
        names = (*self.columns.after_labels, SECONDS)
        row = self.labels | dict(zip(names, values, strict=True))
        write_whole(self.result, table_text([row]).encode())

    def fail(self, reason: str, seconds: float = 0.0) -> None:
        """Save that the run has failed: from then on it is finished."""
        self.finish(failure(reason, self.columns.after_labels, seconds))

    def line(self) -> bytes:
        """Return the line of its result; if it cannot be read, that the run has failed for this reason."""
        columns = self.columns.after_labels
        try:
            return csv_line(require_result(read_table(self.result), self.labels, columns).values())
        except InputError:
            lost = failure(f"{RESULT} is damaged: {AGAIN}", columns)
            return csv_line([*self.labels.values(), *lost])

    def _write_scene(self) -> None:
        if not self.scene_file.exists():
            write_whole(self.scene_file, self._text.encode())
