"""The folder of one run of a sweep.

================== ==========================================================================================
scene.toml         what is simulated; alone it gives the run again
checkpoint.npz     its state, now and then and at the end: ``warpgrains run --resume`` takes it on from there
recording.usdc     its frames, if they are wanted
result.csv         a line of names and a line of values; it appears last: a run that has it is finished
================== ==========================================================================================
"""

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

from warpgrains.errors import SceneError
from warpgrains.files import write_whole
from warpgrains.scene.reader import scene_fields
from warpgrains.scene.scene import Scene
from warpgrains.scene.state_checks import first_state
from warpgrains.simulation.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from warpgrains.simulation.options import RunOptions
from warpgrains.solver.statistics import RunStatistics
from warpgrains.tables import Row, table_text

RESULT = "result.csv"


@dataclass(frozen=True)
class RunFolder:
    """The files of one run.

    Attributes
    ----------
    path : Path
        The folder.
    labels : dict
        What tells it from others: the first columns of its result, "run" and "scene" among them.
    text : str
        Its scene file.
    """

    path: Path
    labels: Row
    text: str

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
        """Raise SceneError if what is there is a run of something else."""
        if self.is_begun and self.scene_file.read_text(encoding="utf-8") != self.text:
            raise SceneError(
                f"'{self.scene_file}' is another scene than this run of the sweep: choose another -o"
            )

    def begin(self, fps: float | None) -> Checkpoint:
        """Return where the run is: at its start, or where an interrupted process left it.

        Parameters
        ----------
        fps
            Frames recorded a second of simulated time [1/s], if the run is to be recorded. A run that is
            resumed keeps to what it was begun with.

        Raises
        ------
        SceneError
            Its scene is none, or its checkpoint is damaged.
        """
        self.path.mkdir(parents=True, exist_ok=True)
        if self.checkpoint.exists():
            return read_checkpoint(self.checkpoint)
        scene = Scene(**{**scene_fields(self.text, self.scene_file), "name": self.labels["scene"]})
        options = RunOptions(steps=scene.steps, checkpoint=str(self.checkpoint))
        if fps is not None:
            from warpgrains.usd.recorder import chunks_of

            shutil.rmtree(chunks_of(self.recording), ignore_errors=True)
            options = replace(options, record=str(self.recording), fps=fps)
        return Checkpoint(scene, first_state(scene), options, RunStatistics())

    def keep(self, reached: Checkpoint) -> None:
        """Save where the run is."""
        self._write_scene()
        write_checkpoint(self.checkpoint, reached)

    def finish(self, row: Row) -> None:
        """Save the result: from then on the run is finished."""
        self._write_scene()
        write_whole(self.result, table_text([row]).encode())

    def _write_scene(self) -> None:
        if not self.is_begun:
            write_whole(self.scene_file, self.text.encode())
