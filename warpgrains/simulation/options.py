"""What a run is to do beside simulating its scene: all that a resumed run must know again."""

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

from warpgrains.scene import checks


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """How long a run is, and what it writes.

    Parameters
    ----------
    steps : int
        Time steps in all.
    record : str, optional
        USD file to write the frames to.
    fps : float
        Wanted frames per second of simulated time [1/s].
    color_by, forces, as_spheres
        What the frames show, see `Recorder`.
    checkpoint : str, optional
        File that is to hold the state, and all that it takes to resume the run.
    every : int
        Steps between two checkpoints; the start and the end of a run have one anyway.

    Raises
    ------
    SceneError
        A number of steps is none.
    """

    steps: int
    record: str | None = None
    fps: float = 60.0
    color_by: str = "palette"
    forces: bool = False
    as_spheres: bool = False
    checkpoint: str | None = None
    every: int = 1000

    def __post_init__(self) -> None:
        object.__setattr__(self, "steps", checks.whole_number("steps", self.steps, least=0))
        object.__setattr__(self, "every", checks.whole_number("every", self.every))

    def checkpoint_after(self, steps: int) -> Path | None:
        """Return the checkpoint to write after so many steps, if one is due then."""
        is_due = steps % self.every == 0 or steps == self.steps
        return Path(self.checkpoint) if self.checkpoint is not None and is_due else None

    def stored(self, checkpoint: Path) -> dict[str, Any]:
        """Return what a checkpoint keeps: the recording as seen from there, so that both may be moved."""
        record = None if self.record is None else os.path.relpath(self.record, checkpoint.parent)
        return {**asdict(self), "record": record, "checkpoint": checkpoint.name}

    @classmethod
    def restored(cls, stored: dict[str, Any], checkpoint: Path) -> Self:
        """Return the options that a checkpoint keeps; the next checkpoints are to replace it."""
        record = stored["record"]
        if record is not None:
            record = os.path.normpath(checkpoint.parent / record)
        return cls(**{**stored, "record": record, "checkpoint": str(checkpoint)})
