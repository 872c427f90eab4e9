"""Options of a run, which its checkpoints keep, and of the execution of runs."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from warpgrains.described import described, described_fields
from warpgrains.errors import SceneError
from warpgrains.files import followed
from warpgrains.pictures.kinds import FASTEST, FILMS, STILLS
from warpgrains.scene import checks

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

OnProgress = Callable[[float], None]
"""Called with the progress since the last call [runs]."""

DEFAULT_RATE = 24.0
"""Frames per second [1/s] at which Blender plays unless it is told otherwise."""
FILES = ("record", "series")
"""Files that a run writes beside its checkpoint."""


def _file(field: str, name: Any) -> str:
    """Return the name of a file: of that to which it leads, if it is a symbolic link."""
    if checks.text(field, name) == "" or "\0" in name:
        raise SceneError(f"{field} is {name!r}: it must be the name of a file")
    return str(followed(Path(name))) if os.path.islink(name) else name


def _option(meaning: str, check: Callable[[str, Any], Any], metavar: str | None = None, **more: Any) -> Any:
    """Return an option of runs.

    It may have a `default`, another `flag` than its name, and an option which it `needs` to have an effect.
    One without metavar is on or off, or no option of the command line, where its flag is None.
    """
    return described(meaning, **({"default": None, "needs": None} | more), check=check, metavar=metavar)


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
    record: str | None = _option(
        "A USD file (.usdc, .usda, .usdz) or a film (.mp4, .gif, .webp) to write the frames to, the present"
        " state first; or a picture of the end (.png, .pdf, .svg).",
        _file,
        "OUT",
        flag="--output",
    )
    fps: float = _option(
        "Frames per second of simulated time [1/s], exactly; at most one a step.",
        checks.positive,
        "F",
        default=DEFAULT_RATE,
        needs="record",
    )
    color_by: str = _option(
        "Color of the grains: speed, pressure, radius, with friction spin or mobilized, or palette, which"
        " tells neighbors apart.",
        checks.text,
        "WHAT",
        default="speed",
        needs="record",
    )
    forces: bool = _option("Draw force chains.", checks.truth, default=False, needs="record")
    draw_as: str = _option(
        "What grains of a USD file are: points, discs or spheres.",
        checks.text,
        "FORM",
        flag="--as",
        default="points",
        needs="record",
    )
    checkpoint: str | None = _option(
        "An .npz file to save the run to as it goes, from which it can be resumed.", _file, "FILE"
    )
    every: int = _option(
        "Steps between two checkpoints; a run begins and ends with one anyway.",
        checks.whole_number,
        "K",
        default=1000,
        needs="checkpoint",
    )
    until: str | None = _option(
        "What ends the run earlier: rest[,speed=V][,energy=E][,time=T], see simulation/until.py.",
        checks.text,
        "rest",
    )
    measure: str | None = _option(
        "Quantities to measure as the run goes, such as energy,stress.",
        checks.text,
        "WHAT,...",
        needs="series",
    )
    series: str | None = _option(
        "A CSV file for what is measured, a row every K steps.", _file, "CSV", needs="measure"
    )
    measure_every: int = _option(
        "Steps between two rows of a series.", checks.whole_number, default=10, needs="series", flag=None
    )

    def __post_init__(self) -> None:
        checks.whole_number("steps", self.steps, least=0)
        for name, option in OPTIONS.items():
            value = getattr(self, name)
            if value is not None or option.default is not None:
                object.__setattr__(self, name, option.metadata["check"](name, value))
        for name, option in OPTIONS.items():
            needed = option.metadata["needs"]
            if needed is not None and getattr(self, needed) is None and getattr(self, name) != option.default:
                raise SceneError(f"{name} has no effect without {needed}")
        if self.shows is not None:
            self._require_no_recording(self.shows)

    @property
    def _suffix(self) -> str | None:
        return None if self.record is None else Path(self.record).suffix

    @property
    def shows(self) -> str | None:
        """The kind of picture that `record` is by its ending, "still" or "film"; None for a recording."""
        return "still" if self._suffix in STILLS else "film" if self._suffix in FILMS else None

    @property
    def rate(self) -> float:
        """Frames per second of simulated time [1/s] that are wanted, and that the kind of file can hold."""
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
        """Return what a checkpoint keeps; files are relative to it, so that all can be moved together."""
        files = {name: getattr(self, name) for name in FILES}
        seen = {name: file and os.path.relpath(file, checkpoint.parent) for name, file in files.items()}
        return {**asdict(self), **seen, "checkpoint": checkpoint.name}

    @classmethod
    def restored(cls, stored: dict[str, Any], checkpoint: Path) -> Self:
        """Return the options that a checkpoint keeps; the next checkpoint replaces it."""
        files = {name: _seen_from(checkpoint, name, stored[name]) for name in FILES}
        return cls(**{**stored, **files, "checkpoint": str(checkpoint)})


def steps_of(scene: Scene, steps: int | None, duration: float | None) -> int:
    """Return the number of steps of a run: as given, or of a duration [s], by default that of the scene."""
    if steps is not None and duration is not None:
        raise SceneError("a run has steps and duration: it needs one of them")
    if steps is not None:
        return checks.whole_number("steps", steps, least=0)
    return scene.steps if duration is None else scene.steps_in(duration)


def _seen_from(checkpoint: Path, field: str, stored: Any) -> str | None:
    """Return the path of a file whose path relative to a checkpoint is stored; None if none is."""
    if stored is None:
        return None
    name = _file(field, stored)
    if os.path.isabs(name):
        raise SceneError(f"{field} is {name!r}: it must be where it is as seen from the checkpoint")
    return os.path.normpath(checkpoint.parent / name)


OPTIONS = described_fields(RunOptions)
"""The described fields of `RunOptions`, by name."""
FLAGS: dict[str, str] = {
    name: flag
    for name, option in OPTIONS.items()
    if (flag := option.metadata.get("flag", f"--{name.replace('_', '-')}")) is not None
}
"""Their flags on the command line."""


@dataclass(frozen=True)
class ExecutionOptions:
    """Device and threads of runs, and what the runs of a sweep write."""

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
