"""A run of a sweep. It may have a folder with outputs and a checkpoint, from which the run continues.

================== ==========================================================================================
scene.toml         the scene, which suffices to repeat the run
checkpoint.npz     the state at intervals and at the end; ``warpgrains run --resume`` continues from it
recording.usdc     the frames, if requested
series.csv         quantities over time, if requested
================== ==========================================================================================
"""

from __future__ import annotations

from contextlib import ExitStack, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpgrains.analysis.series import Series
from warpgrains.base.errors import InputError, LockedError, MissingExtraError, SimulationError
from warpgrains.base.files import write_atomically
from warpgrains.base.frame_log import is_complete, log_of
from warpgrains.base.locks import Lock
from warpgrains.simulation.checkpoint import Checkpoint, read_checkpoint
from warpgrains.simulation.options import RunOptions
from warpgrains.simulation.run import SceneRun
from warpgrains.sweep.execution import RunSettings
from warpgrains.sweep.results import OF_ERROR, OF_MEAN

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.loaded_scene import LoadedScene
    from warpgrains.sweep.sweep import Run

SCENE, CHECKPOINT, RECORDING, SERIES = "scene.toml", "checkpoint.npz", "recording.usdc", "series.csv"
HOW_TO_REPEAT = "delete the folder of the run to repeat it"


class SweepRun(SceneRun):
    """A run of a sweep.

    Attributes
    ----------
    run : Run
        Number of the run, and its values on the axes.
    folder : Path or None
        Folder of the run, if any. It is locked until `close`, so that no other process continues the run.
    is_alone : bool
        Whether the run needs its own group: several threads share it, or a group lacked memory for it.
    waits : bool
        Whether the run has lacked memory in its present group, and waits for its own.
    """

    def __init__(self, run: Run, scene: Scene, settings: RunSettings, is_alone: bool) -> None:
        super().__init__(scene, _options(scene.steps, settings.until))
        self.run, self.labels, self.is_alone = run, run.labels(), is_alone
        self.folder: Path | None = None
        self.waits = False
        self._held = ExitStack()

    @property
    def steps_due(self) -> int:
        """Number of steps to the next output or to the end; 0 if the run `waits` for its own group."""
        return 0 if self.waits else super().steps_due

    @property
    def progress(self) -> float:
        """Fraction of the steps of the run that are done."""
        return self.statistics.steps / self.options.steps

    def open(self, folder: Path, text: str, settings: RunSettings, held: ExitStack) -> None:
        """Open a folder for the run, with a scene file of this text; continue from a checkpoint in it.

        The run is open until `close`, or until `held` is closed.

        Raises
        ------
        LockedError
            Another process holds the run.
        InputError
            The checkpoint is damaged or of another run, or an output would replace a file of another kind.
        """
        statistics = self.statistics if self.statistics.steps else None
        scene = self.scene.replace(text=text)
        options = folder_options(folder, scene.steps, settings)
        folder.mkdir(parents=True, exist_ok=True)
        with ExitStack() as own:
            own.enter_context(Lock(folder / CHECKPOINT))
            try:
                kept = _kept(folder, scene, options) if (folder / CHECKPOINT).exists() else None
                if kept is not None and statistics is not None:
                    raise LockedError("another process has begun it")
                if kept is None:
                    # a process that ended before its first checkpoint left frames: they are recorded again
                    log_of(folder / RECORDING).unlink(missing_ok=True)
                    self._begin(scene, options, 0, self.state, statistics)
                else:
                    self._begin(kept.scene, kept.options or options, 0, kept.state, kept.statistics)
                own.enter_context(self.opened())
            except (LockedError, MissingExtraError):
                raise
            except InputError as error:
                raise InputError(f"{error}: {HOW_TO_REPEAT}") from None
            self.folder, self._held = folder, held.enter_context(own.pop_all())

    def _lock(self, held: ExitStack) -> None:
        """Do nothing, because `open` locks the checkpoint before reading it."""

    def write_due(self, now: LoadedScene) -> None:
        """Measure and record what is due after this step. The run fails if a frame cannot be recorded."""
        try:
            super().write_due(now)
        except InputError as error:
            self.error = str(error)

    def means(self, after: float | None) -> dict[str, float]:
        """Return means over the series from time `after` [s] on, and their standard errors, by column.

        {} if `after` is None. InputError if the run was too short.
        """
        if after is None:
            return {}
        assert isinstance(self.observer, Series)
        found = self.observer.average(after).items()
        return {
            f"{name}{end}": value
            for name, own in found
            for end, value in zip((OF_MEAN, OF_ERROR), own, strict=True)
        }

    def save_state(self) -> None:
        """Save `state` as a checkpoint, if the run has a folder and no frame is missing in its recording."""
        if self.folder is None or self.state is None or self.missing_frames:
            return
        if not (self.folder / SCENE).exists():
            write_atomically(self.folder / SCENE, self.scene.text.encode())
        self.save(self.state, self.scene)

    def close(self) -> str | None:
        """Complete the outputs. If the run has failed before its first frame, discard the recording.

        Return the reason why the recording cannot be completed, or None.
        """
        try:
            with suppress(SimulationError), self._held:
                if self.error is not None and self.statistics.frames == 0:
                    raise SimulationError(self.error)
        except OSError as trouble:
            return str(trouble)
        return None


@cache
def _options(steps: int, until: str | None) -> RunOptions:
    """Return the options of runs without a folder, from a cache: thousands of runs share one object."""
    return RunOptions(steps=steps, until=until)


def folder_options(folder: Path, steps: int, settings: RunSettings) -> RunOptions:
    """Return the options of a new run whose checkpoint and outputs are files in `folder`."""
    wanted: dict[str, Any] = {}
    if settings.fps is not None:
        wanted = {"record": str(folder / RECORDING), "fps": settings.fps}
    if settings.every is not None:
        wanted |= {
            "measure": ",".join(settings.measured),
            "measure_every": settings.every,
            "series": str(folder / SERIES),
            "region": settings.region,
            "mean": settings.mean,
        }
    return RunOptions(steps=steps, checkpoint=str(folder / CHECKPOINT), until=settings.until, **wanted)


def _kept(folder: Path, scene: Scene, wanted: RunOptions) -> Checkpoint | None:
    """Return the checkpoint from which the run in a folder continues; InputError if another run wrote it.

    None means: start again, because the run failed, so that its recording was closed before its end. `wanted`
    are the options of a new run here, of which `steps` and `until` must be those of the checkpoint.
    """
    kept = read_checkpoint(folder / CHECKPOINT)
    options, own = kept.options, (scene.text, wanted.until, wanted.steps)
    if options is None or (kept.scene.text, options.until, options.steps) != own:
        raise InputError(f"checkpoint '{folder / CHECKPOINT}' is of another run")
    has_ended = kept.statistics.met or kept.statistics.steps == options.steps
    is_over = options.record is not None and is_complete(folder / RECORDING)
    return None if is_over and not has_ended else kept
