"""The folder of one run: its outputs, and a checkpoint from which it continues.

================== ==========================================================================================
scene.toml         the scene, which suffices to repeat the run
checkpoint.npz     the state at intervals and at the end; ``warpgrains run --resume`` continues from it
recording.usdc     the frames, if requested
series.csv         quantities over time, if requested
================== ==========================================================================================
"""

from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Self

from warpgrains.analysis.quantities import takes_region
from warpgrains.base.errors import InputError, LockedError, MissingExtraError, SimulationError
from warpgrains.base.files import write_atomically
from warpgrains.base.frame_log import is_complete, log_of
from warpgrains.base.locks import Lock
from warpgrains.scene.state import State
from warpgrains.simulation.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from warpgrains.simulation.options import RunOptions
from warpgrains.simulation.run import OpenRun
from warpgrains.sweep.execution import ExecutionOptions, RunSettings

SCENE, CHECKPOINT, RECORDING, SERIES = "scene.toml", "checkpoint.npz", "recording.usdc", "series.csv"
HOW_TO_REPEAT = "delete the folder of the run to repeat it"


class FolderRun(OpenRun):
    """A run with a folder and open outputs, which no other process continues, because it is locked."""

    def __init__(self, folder: Path, start: Checkpoint, is_resumed: bool):
        assert start.options is not None
        statistics = start.statistics if is_resumed else None
        super().__init__(start.scene, start.options, statistics, is_locked=True)
        self.start, self._folder, self._held = start.state, folder, ExitStack()

    @classmethod
    def open(cls, folder: Path, start: Checkpoint, held: ExitStack) -> Self:
        """Open a run, of which `start` is the start if the folder has no checkpoint, until `close`.

        Raises
        ------
        LockedError
            Another process has the run.
        InputError
            The checkpoint is damaged or of another run, or an output would replace a file of another kind.
        """
        folder.mkdir(parents=True, exist_ok=True)
        with ExitStack() as own:
            own.enter_context(Lock(folder / CHECKPOINT))
            try:
                kept = _kept(folder, start) if (folder / CHECKPOINT).exists() else None
                if kept is None:
                    # frames of a process that ended before its first checkpoint: they are recorded again
                    log_of(folder / RECORDING).unlink(missing_ok=True)
                elif start.statistics.steps > 0:
                    raise LockedError("another process has begun it")
                run = cls(folder, kept or start, kept is not None or start.statistics.steps > 0)
                own.enter_context(run.opened())
            except (LockedError, MissingExtraError):
                raise
            except InputError as error:
                raise InputError(f"{error}: {HOW_TO_REPEAT}") from None
            run._held = held.enter_context(own.pop_all())
        return run

    def save(self, state: State) -> None:
        """Save a checkpoint, unless the last frame before it could not be recorded."""
        if self.missing_frames:
            return
        if not (self._folder / SCENE).exists():
            write_atomically(self._folder / SCENE, self.scene.text.encode())
        write_checkpoint(self._folder / CHECKPOINT, self.flush_and_checkpoint(state))

    def close(self, error: str | None) -> str | None:
        """Complete the outputs, but discard a recording without frames of a run that has failed.

        Return the reason why the recording cannot be completed, or None.
        """
        try:
            with suppress(SimulationError), self._held:
                if error is not None and self.statistics.frames == 0:
                    raise SimulationError(error)
        except OSError as trouble:
            return str(trouble)
        return None


def run_options(folder: Path, steps: int, settings: RunSettings, execution: ExecutionOptions) -> RunOptions:
    """Return the options of a new run in a folder."""
    wanted: dict[str, Any] = {}
    if execution.fps is not None:
        wanted = {"record": str(folder / RECORDING), "fps": execution.fps}
    if execution.measure_every is not None:
        wanted |= {
            "measure": ",".join(settings.measured),
            "measure_every": execution.measure_every,
            "series": str(folder / SERIES),
            "region": settings.region if takes_region(settings.measured) else None,
            "mean": execution.mean,
        }
    return RunOptions(steps=steps, checkpoint=str(folder / CHECKPOINT), until=settings.until, **wanted)


def _kept(folder: Path, start: Checkpoint) -> Checkpoint | None:
    """Return the checkpoint in a folder; None if its run has failed, and its recording is complete."""
    kept = read_checkpoint(folder / CHECKPOINT)
    options, wanted = kept.options, start.options
    assert wanted is not None
    own = start.scene.text, wanted.until, wanted.steps
    if options is None or (kept.scene.text, options.until, options.steps) != own:
        raise InputError(f"checkpoint '{folder / CHECKPOINT}' is of another run")
    has_ended = kept.statistics.met or kept.statistics.steps == options.steps
    is_over = options.record is not None and is_complete(folder / RECORDING)
    return None if is_over and not has_ended else kept
