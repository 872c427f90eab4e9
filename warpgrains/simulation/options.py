"""What a run is to do beside simulating its scene, which a resumed run must know again, and by what means."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from warpgrains.drawing.frame_times import DEFAULT_RATE
from warpgrains.errors import SceneError
from warpgrains.files import followed
from warpgrains.pictures.kinds import FASTEST, FILMS, STILLS
from warpgrains.scene import checks

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

OnProgress = Callable[[float], None]
"""Hears of progress, in runs."""

NEEDS = dict.fromkeys(("fps", "color_by", "forces", "draw_as"), "record") | {
    "every": "checkpoint",
    "measure": "series",
    "measure_every": "series",
    "series": "measure",
}
"""What options are of no effect without."""
FILES = ("record", "series")
"""What a run writes beside its checkpoint."""


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """How long a run is, and what it writes.

    Raises
    ------
    SceneError
        A value is not what it must be, or is of no effect, such as `forces` without `record`.
    """

    steps: int
    """Time steps in all."""
    record: str | None = None
    """USD file or film to write the frames to, or picture of the end."""
    fps: float = DEFAULT_RATE
    """Wanted frames per second of simulated time [1/s]."""
    color_by: str = "speed"
    forces: bool = False
    draw_as: str = "points"
    """These three say what the frames show, see `Recorder`."""
    checkpoint: str | None = None
    """File that is to hold the state, and all that it takes to resume the run."""
    every: int = 1000
    """Steps between two checkpoints; the start and the end of a run have one anyway."""
    until: str | None = None
    """What ends the run before its last step, see `criterion`."""
    measure: str | None = None
    """Quantities that a series is of, by name, with commas between them."""
    series: str | None = None
    """CSV file to write it to."""
    measure_every: int = 10
    """Steps between two of its rows."""

    def __post_init__(self) -> None:
        checked: dict[str, Any] = {
            "steps": checks.whole_number("steps", self.steps, least=0),
            "every": checks.whole_number("every", self.every),
            "fps": checks.positive("fps", self.fps),
            "color_by": checks.text("color_by", self.color_by),
            "forces": checks.truth("forces", self.forces),
            "draw_as": checks.text("draw_as", self.draw_as),
            "measure_every": checks.whole_number("measure_every", self.measure_every),
            **{
                name: None if value is None else checks.text(name, value)
                for name, value in (("measure", self.measure), ("until", self.until))
            },
            **{name: _file(name, getattr(self, name)) for name in FILES},
            "checkpoint": _file("checkpoint", self.checkpoint),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        for name, needed in NEEDS.items():
            if checked[needed] is None and checked[name] != getattr(type(self), name):
                raise SceneError(f"{name} has no effect without {needed}")
        if self.shows is not None:
            self._require_no_recording(self.shows)

    @property
    def _suffix(self) -> str | None:
        return None if self.record is None else Path(self.record).suffix

    @property
    def shows(self) -> str | None:
        """What is drawn instead of recorded, by the ending of its file: a "still", a "film" or nothing."""
        return "still" if self._suffix in STILLS else "film" if self._suffix in FILMS else None

    @property
    def rate(self) -> float:
        """Wanted frames per second of simulated time [1/s], as far as the kind of file has them."""
        return min(self.fps, FASTEST.get(self._suffix, self.fps))

    def _require_no_recording(self, kind: str) -> None:
        """Raise SceneError for what only recordings have, or pictures have not."""
        for name in ["draw_as"] + ["fps"] * (kind == "still"):
            if getattr(self, name) != getattr(type(self), name):
                raise SceneError(f"{name} has no effect on a {kind}, '{self.record}'")
        if self.checkpoint is not None:
            raise SceneError(f"a run with a checkpoint cannot continue a {kind}: record .usdc, and plot that")

    def checkpoint_after(self, steps: int) -> Path | None:
        """Return the checkpoint to write after so many steps, if one is due then."""
        is_due = steps % self.every == 0 or steps == self.steps
        return Path(self.checkpoint) if self.checkpoint is not None and is_due else None

    def stored(self, checkpoint: Path) -> dict[str, Any]:
        """Return what a checkpoint keeps: other files as seen from there, so that all may be moved."""
        files = {name: getattr(self, name) for name in FILES}
        seen = {name: file and os.path.relpath(file, checkpoint.parent) for name, file in files.items()}
        return {**asdict(self), **seen, "checkpoint": checkpoint.name}

    @classmethod
    def restored(cls, stored: dict[str, Any], checkpoint: Path) -> Self:
        """Return the options that a checkpoint keeps; the next checkpoints are to replace it."""
        if stored.pop("as_spheres", False):  # of earlier releases
            stored = {**stored, "draw_as": "spheres"}
        if stored["record"] is None:  # what earlier releases kept beside it has no effect
            stored = {name: value for name, value in stored.items() if NEEDS.get(name) != "record"}
        files = {name: _seen_from(checkpoint, name, stored.get(name)) for name in FILES}
        return cls(**{**stored, **files, "checkpoint": str(checkpoint)})


def steps_of(scene: Scene, steps: int | None, duration: float | None) -> int:
    """Return how many steps a run of a scene has: so many, or for a duration [s]; by default, for its own."""
    if steps is not None and duration is not None:
        raise SceneError("a run has steps and duration: it needs one of them")
    if steps is not None:
        return checks.whole_number("steps", steps, least=0)
    return scene.steps if duration is None else scene.steps_in(duration)


def _seen_from(checkpoint: Path, field: str, stored: Any) -> str | None:
    """Return the name of a file, if there is one, that a checkpoint keeps."""
    name = _file(field, stored)
    if name is not None and os.path.isabs(name):
        raise SceneError(f"{field} is {name!r}: it must be where it is as seen from the checkpoint")
    return name and os.path.normpath(checkpoint.parent / name)


def _file(field: str, name: Any) -> str | None:
    """Return the name of a file, if there is one: that to which it leads, if it is a symbolic link."""
    if name is None:
        return None
    if checks.text(field, name) == "" or "\0" in name:
        raise SceneError(f"{field} is {name!r}: it must be the name of a file")
    return str(followed(Path(name))) if os.path.islink(name) else name


@dataclass(frozen=True)
class ExecutionOptions:
    """With what runs are executed."""

    device: str = "cpu"
    """A Warp device, "cpu" or "cuda:0"."""
    threads: int | None = None
    """OS threads on a CPU; None for as many as there are cores."""
    fps: float | None = None
    """Frames recorded a second of simulated time [1/s], if runs are to be recorded."""
    folders: bool = False
    """Whether runs of a sweep are to have a folder each, even if they are short."""
    measure_every: int | None = None
    """Steps between two rows of the series of a run, if runs are to have one."""

    @property
    def needs_folders(self) -> bool:
        """Whether each run of a sweep has a folder."""
        return self.folders or self.fps is not None or self.measure_every is not None
