"""The folder of one run, with everything that is needed to continue it.

================== ==========================================================================================
scene.toml         the scene, which suffices to repeat the run
checkpoint.npz     the state at intervals and at the end; ``warpgrains run --resume`` continues from it
recording.usdc     the frames, if requested
series.csv         quantities over time, if requested
result.csv         a line of names and a line of values; a run is finished if this file exists
================== ==========================================================================================
"""

from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

from warpgrains.analysis.quantities import takes_region
from warpgrains.errors import InputError, OutputError
from warpgrains.files import Row, csv_line, read_regular, read_table, table_text, write_atomically
from warpgrains.locks import Lock
from warpgrains.scene.reader import scene_fields
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import first_state
from warpgrains.simulation.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from warpgrains.simulation.options import RunOptions
from warpgrains.solver.statistics import Summary
from warpgrains.sweep.execution import ExecutionOptions, RunSettings
from warpgrains.sweep.results import SECONDS, RunResult, failure, require_result, value_columns
from warpgrains.sweep.sweep import GRAINS, Run

RESULT = "result.csv"
HOW_TO_REPEAT = "delete the folder of the run to repeat it"


class RunFolder:
    """The files of one run, and its number; `value_columns` are those of its result after the labels."""

    def __init__(self, path: Path, run: Run, settings: RunSettings):
        self.path, self.number, self.settings, self._run = path, run.number, settings, run
        self.value_columns = value_columns(settings)
        self.scene_file, self.checkpoint = path / "scene.toml", path / "checkpoint.npz"
        self.recording, self.series = path / "recording.usdc", path / "series.csv"
        self.result = path / RESULT

    @cached_property
    def labels(self) -> Row:
        return self._run.labels()

    @cached_property
    def _text(self) -> bytes:
        return self._run.text(f"../../{GRAINS}").encode()

    def require_this_sweep(self) -> None:
        """Raise OutputError if the folder belongs to another sweep, whether or not it is damaged.

        The first line of a scene file names the run and its values, which are also in the others: if one
        differs, it is damage.
        """
        try:
            found = read_regular(self.scene_file)
        except (InputError, OSError):
            return
        (head, end, body), (own_head, _, own_body) = found.partition(b"\n"), self._text.partition(b"\n")
        is_whole = bool(end) and head.startswith(b"# run %d of" % self.number)
        if is_whole and head != own_head and body != own_body:
            raise OutputError(f"'{self.scene_file}' is the scene of another sweep: choose another -o")

    def _require_intact(self) -> None:
        """Raise InputError if the scene file exists and is not that of the run."""
        if self.scene_file.exists():
            try:
                found = read_regular(self.scene_file)
            except InputError as error:
                raise InputError(f"{error}: {HOW_TO_REPEAT}") from None
            if found != self._text:
                raise InputError(f"'{self.scene_file}' is damaged: {HOW_TO_REPEAT}")

    def lock(self) -> Lock:
        """Lock the run by its checkpoint, so that no other sweep and no ``run --resume`` executes it."""
        self.path.mkdir(parents=True, exist_ok=True)
        return Lock(self.checkpoint)

    def start_or_checkpoint(
        self, execution: ExecutionOptions, scene: Scene | None = None
    ) -> tuple[Checkpoint, bool]:
        """Return the start of the locked run, or its checkpoint; and whether it is resumed from that.

        `execution` determines the outputs of a new run; a resumed one keeps its own. InputError if the scene
        is invalid or the checkpoint damaged, OutputError if the run is finished or the folder another's.
        """
        self.require_this_sweep()
        self._require_intact()
        if self.result.exists():
            raise OutputError("another process has finished it")
        is_resumed = self.checkpoint.exists()
        start = self._read_checkpoint() if is_resumed else self._start(execution, scene or self._scene())
        return start, is_resumed

    def _scene(self) -> Scene:
        return Scene(**scene_fields(self._text.decode(), self.scene_file))

    def _start(self, execution: ExecutionOptions, scene: Scene) -> Checkpoint:
        """Return the start of a new run of a scene, which gets the name and the text of its file."""
        scene = scene.with_settings(name=self.labels["scene"], text=self._text.decode())
        wanted: dict[str, Any] = {}
        if execution.fps is not None:
            wanted = {"record": str(self.recording), "fps": execution.fps}
        if execution.measure_every is not None:
            wanted |= {
                "measure": ",".join(self.settings.measured),
                "measure_every": execution.measure_every,
                "series": str(self.series),
                "region": self.settings.region if takes_region(self.settings.measured) else None,
                "mean": execution.mean,
            }
        options = RunOptions(
            steps=scene.steps, checkpoint=str(self.checkpoint), until=self.settings.until, **wanted
        )
        return Checkpoint(scene, first_state(scene), options, Summary())

    def _read_checkpoint(self) -> Checkpoint:
        """Return the checkpoint of this run; file names that it contains are ignored."""
        kept = read_checkpoint(self.checkpoint)
        options = kept.options
        own = (self._text.decode(), self.settings.until, kept.scene.steps)
        if options is None or (kept.scene.text, options.until, options.steps) != own:
            raise InputError(f"checkpoint '{self.checkpoint}' is of another run: {HOW_TO_REPEAT}")
        record = None if options.record is None else str(self.recording)
        series = None if options.series is None else str(self.series)
        places: dict[str, Any] = {"record": record, "series": series, "checkpoint": str(self.checkpoint)}
        return replace(kept, options=replace(options, **places))

    def save_checkpoint(self, reached: Checkpoint) -> None:
        self._write_scene()
        write_checkpoint(self.checkpoint, reached)

    def finish(self, values: RunResult) -> None:
        """Save the result of the run, which is finished from then on."""
        self._write_scene()
        names = (*self.value_columns, SECONDS)
        row = self.labels | dict(zip(names, values, strict=True))
        write_atomically(self.result, table_text([row]).encode())

    def fail(self, reason: str, seconds: float = 0.0) -> None:
        """Save a failure as the result of the run, which is finished from then on."""
        self.finish(failure(reason, self.value_columns, seconds))

    def line(self) -> bytes:
        """Return the line of the run's result; if it cannot be read, a failure for this reason."""
        try:
            return csv_line(require_result(read_table(self.result), self.labels, self.value_columns).values())
        except InputError:
            lost = failure(f"{RESULT} is damaged: {HOW_TO_REPEAT}", self.value_columns)
            return csv_line([*self.labels.values(), *lost])

    def _write_scene(self) -> None:
        if not self.scene_file.exists():
            write_atomically(self.scene_file, self._text)
