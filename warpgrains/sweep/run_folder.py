"""The folder of one run, which holds what it takes to go on with it.

================== ==========================================================================================
scene.toml         what is simulated; alone it gives the run again
checkpoint.npz     its state, now and then and at the end: ``warpgrains run --resume`` takes it on from there
recording.usdc     its frames, if they are wanted
series.csv         what is measured as it goes, if that is wanted
result.csv         a line of names and a line of values; it appears last: a run that has it is finished
================== ==========================================================================================
"""

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from warpgrains.analysis.quantities import QUANTITIES
from warpgrains.analysis.snapshot import Snapshot
from warpgrains.errors import OutputError, SceneError
from warpgrains.files import Row, read_regular, read_table, table_text, write_whole
from warpgrains.locks import Lock
from warpgrains.scene.document import parse_toml
from warpgrains.scene.reader import scene_fields
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import State, first_state
from warpgrains.simulation.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from warpgrains.simulation.options import ExecutionOptions, RunOptions
from warpgrains.solver.statistics import RunStatistics
from warpgrains.sweep.parts import OTHERWISE
from warpgrains.sweep.results import (
    MET,
    SECONDS,
    columns_of,
    failure,
    more_columns,
    require_result,
    result,
)
from warpgrains.sweep.sweep import Run

RESULT = "result.csv"
AGAIN = "delete the run's folder to do it again"


class Start(NamedTuple):
    """Where a run with a folder begins."""

    run: Run
    state: State | None = None
    """Where it is if it has been carried out without a folder so far."""
    statistics: RunStatistics | None = None
    error: str | None = None
    """Why it failed meanwhile, if it did."""


@dataclass(frozen=True)
class RunFolder:
    """The files of one run."""

    path: Path
    """The folder."""
    labels: Row
    """What tells it from others: the first columns of its result, "run" and "scene" among them."""
    text: str
    """Its scene file."""
    measured: tuple[str, ...] = ()
    """Names of quantities that are measured."""
    until: str | None = None
    """What ends the run before its last step, see `criterion`."""

    @property
    def more(self) -> tuple[str, ...]:
        """The columns of its result that not every sweep has."""
        return more_columns(self.measured, self.until)

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
    def series(self) -> Path:
        """What is measured."""
        return self.path / "series.csv"

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
            found = read_regular(self.scene_file).decode()
        except UnicodeDecodeError:
            raise SceneError(f"'{self.scene_file}' is no text: {AGAIN}") from None
        except SceneError as error:
            raise SceneError(f"{error}: {AGAIN}") from None
        if self._is_of_another(found):
            raise OutputError(
                f"'{self.scene_file}' is another scene than this run of the sweep: choose another -o"
            )
        if found != self.text:
            raise SceneError(f"'{self.scene_file}' is damaged: {AGAIN}")
        if self.is_finished and self._measures_otherwise():
            raise OutputError(f"'{self.result}' {OTHERWISE}")

    def _is_of_another(self, found: str) -> bool:
        """Whether a scene file is whole, and that of another run: else it is this run's, or damaged.

        The first line names the run and its values, which the lines after it have too: in the file of another
        run, both differ.
        """
        (head, _, body), (own_head, _, own_body) = found.partition("\n"), self.text.partition("\n")
        if head == own_head or body == own_body or not head.startswith("# run "):
            return False
        try:
            parse_toml(found, self.scene_file)
        except SceneError:
            return False
        return True

    def lock(self) -> Lock:
        """Return the lock on the run, that on its checkpoint: no sweep and no ``run --resume`` shares it."""
        self.path.mkdir(parents=True, exist_ok=True)
        return Lock(self.checkpoint)

    def begin(self, execution: ExecutionOptions) -> Checkpoint:
        """Return where the run, which is locked, is: at its start, or where another process left it.

        What it records is as `execution` tells; but a run that is resumed keeps to what it was begun with.

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
        options = RunOptions(steps=scene.steps, checkpoint=str(self.checkpoint), until=self.until)
        if execution.fps is not None:
            from warpgrains.usd.recorder import log_of

            log_of(self.recording).unlink(missing_ok=True)
            options = replace(options, record=str(self.recording), fps=execution.fps)
        if execution.measure_every is not None:
            series: dict[str, Any] = {"measure": ",".join(self.measured), "series": str(self.series)}
            options = replace(options, **series, measure_every=execution.measure_every)
        return Checkpoint(scene, first_state(scene), options, RunStatistics())

    def _kept(self) -> Checkpoint:
        """Return the checkpoint of this run; what it says of places counts for nothing."""
        kept = read_checkpoint(self.checkpoint)
        options = kept.options
        steps = kept.statistics.steps if kept.statistics.met else kept.scene.steps
        if options is None or (kept.scene.text, options.until, options.steps) != (
            self.text,
            self.until,
            steps,
        ):
            raise SceneError(f"checkpoint '{self.checkpoint}' is of another run: {AGAIN}")
        record = None if options.record is None else str(self.recording)
        series = None if options.series is None else str(self.series)
        places: dict[str, Any] = {"record": record, "series": series, "checkpoint": str(self.checkpoint)}
        return replace(kept, options=replace(options, **places))

    def keep(self, reached: Checkpoint) -> None:
        """Save where the run is."""
        self._write_scene()
        write_checkpoint(self.checkpoint, reached)

    def finish(self, end: Snapshot, done: RunStatistics) -> None:
        """Save the result of the run, which is at its end: from then on it is finished."""
        self._finish(result(self.labels, end, done, self.more))

    def fail(self, reason: str, seconds: float = 0.0) -> None:
        """Save that the run has failed: from then on it is finished."""
        self._finish(failure(self.labels, reason, seconds, self.more))

    def row(self) -> Row:
        """Return the result; if it cannot be read, that the run has failed for this reason."""
        try:
            return require_result(read_table(self.result), self.labels, self.more)
        except SceneError:
            return failure(self.labels, f"{RESULT} is damaged: {AGAIN}", more=self.more)

    def _measures_otherwise(self) -> bool:
        """Whether the result has good columns, but not those of this sweep."""
        with suppress(OSError, SceneError):
            names = read_regular(self.result).partition(b"\n")[0].decode(errors="replace").split(",")
            columns = columns_of(name for name in names if name in (MET, *QUANTITIES))
            return names == [*self.labels, *columns, SECONDS] and columns != columns_of(self.more)
        return False

    def _finish(self, row: Row) -> None:
        self._write_scene()
        write_whole(self.result, table_text([row]).encode())

    def _write_scene(self) -> None:
        if not self.is_begun:
            write_whole(self.scene_file, self.text.encode())
