"""Options of runs.

A checkpoint stores the options of its run, but not the options of the execution, such as device and threads.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypedDict

from warpgrains.described import described, described_fields
from warpgrains.drawing.kinds import FILM, FILMS, KINDS, Kind, described_kinds, frame_of, size_of
from warpgrains.errors import InputError
from warpgrains.files import resolve_link, suffix_of
from warpgrains.scene import checks

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

DEFAULT_RATE = 24.0
"""Frames per second [1/s] at which Blender plays by default."""
FILES = ("record", "series")
"""Options that name the files of a run other than its checkpoint."""


def _file_name(field: str, name: Any) -> str:
    name = checks.path(field, name)
    if name == "" or "\0" in name:
        raise InputError(f"{field} is {name!r}: it must be the name of a file")
    return str(name)


def _file(field: str, name: Any) -> str:
    """Return the name of an output; a symbolic link is resolved."""
    name = _file_name(field, name)
    return str(resolve_link(Path(name))) if os.path.islink(name) else name


def _output(field: str, name: Any) -> str:
    """Return the name of an output, whose suffix is one of `KINDS`."""
    name = _file(field, name)
    if suffix_of(name) not in KINDS:
        raise InputError(f"output '{name}' must end in {', '.join(KINDS)}")
    return name


def _region(field: str, text: Any) -> str:
    """Return the text of a region, which is a table."""
    from warpgrains.scene.region import table_of  # NumPy, which --help does not need

    table_of(field, text)
    return str(text)


def _readable_by(read: Callable[[str, Any], object]) -> Callable[[str, Any], str]:
    """Return the check of a text that a function reads."""

    def check(field: str, text: Any) -> str:
        read(field, text)
        return str(text)

    return check


def _option(meaning: str, check: Callable[[str, Any], Any], metavar: str | None = None, **more: Any) -> Any:
    """Return a field for an option of runs, a switch without metavar.

    `more`: its `default`, a `flag` other than its name (None: none), and the option that it `needs` to have
    an effect.
    """
    return described(meaning, **({"default": None, "needs": None} | more), check=check, metavar=metavar)


class Outputs(TypedDict, total=False):
    """Keywords of `Simulation.run` that are fields of `RunOptions`, so that type checkers find wrong ones."""

    record: str | Path | None
    fps: float
    color_by: str
    forces: bool
    draw_as: str
    size: str | None
    frame: str | None
    checkpoint: str | Path | None
    every: int


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Length and outputs of a run. Raises InputError where a value is invalid or has no effect."""

    steps: int
    """Planned number of time steps."""
    record: str | None = _option(f"File to write: {described_kinds()}.", _output, "OUT", flag="--output")
    fps: float = _option(
        "Frames per second of simulated time [1/s], exactly; at most one per step.",
        checks.positive,
        "F",
        default=DEFAULT_RATE,
        needs="record",
    )
    color_by: str = _option(
        "Color of the grains: speed, pressure, radius, with friction spin or mobilized, or palette (a"
        " different color for neighbors).",
        checks.text,
        "WHAT",
        default="speed",
        needs="record",
    )
    forces: bool = _option("Draw force chains.", checks.boolean, default=False, needs="record")
    draw_as: str = _option(
        "Form of the grains in a USD file: points, discs or spheres.",
        checks.text,
        "FORM",
        flag="--as",
        default="points",
        needs="record",
    )
    size: str | None = _option(
        "Width and height of a film or a picture [pixels]; without it, they follow from the frame.",
        _readable_by(size_of),
        "WIDTHxHEIGHT",
        needs="record",
    )
    frame: str | None = _option(
        "Rectangle to show [m], also by the camera of a USD file; without it, the grains and the walls that"
        " they can touch.",
        _readable_by(frame_of),
        "X0,Y0,X1,Y1",
        needs="record",
    )
    checkpoint: str | None = _option(
        "An .npz file to save the run to as it goes, from which it can be resumed.", _file, "FILE"
    )
    every: int = _option(
        "Steps between two checkpoints; the first and the last state are always saved.",
        checks.whole_number,
        "K",
        default=1000,
        needs="checkpoint",
    )
    until: str | None = _option(
        "End criterion of the run: rest[,speed=V][,energy=E][,time=T], with bounds in m/s, J and s.",
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
        "A CSV file for the measured quantities, one row every K steps.", _file, "CSV", needs="measure"
    )
    measure_every: int = _option(
        "Steps between two rows of a series.", checks.whole_number, default=10, needs="series", flag=None
    )
    region: str | None = _option(
        "Region of the measured quantities that have one, such as 'x = [-1.0, 0.0], below = \"surface\"'.",
        _region,
        "RANGES",
        needs="measure",
    )
    mean: bool = _option(
        "Measure in every step; rows hold the means of the K steps up to their own.",
        checks.boolean,
        default=False,
        needs="series",
    )

    def __post_init__(self) -> None:
        checks.whole_number("steps", self.steps, least=0)
        for name, option in OPTIONS.items():
            value = getattr(self, name)
            if value is not None or option.default is not None:
                object.__setattr__(self, name, option.metadata["check"](name, value))
        require_needed([name for name, option in OPTIONS.items() if getattr(self, name) != option.default])
        if self.mean and 0 < self.steps < self.measure_every:
            raise InputError(
                f"steps is {self.steps}: no mean over {self.measure_every} steps ends within them"
            )
        if self.shows is not None:
            self._require_effect(self.shows)

    @property
    def shows(self) -> Kind | None:
        """Kind of output that `record` is by its suffix; None without it."""
        return None if self.record is None else KINDS[suffix_of(self.record)]

    @property
    def pixels(self) -> tuple[int, int] | None:
        """Width and height of a film or a picture [pixels], if given."""
        return None if self.size is None else size_of("size", self.size)

    @property
    def rate(self) -> float:
        """Requested frames per second of simulated time [1/s], limited by what the file can store."""
        film = FILMS.get(suffix_of(self.record or ""))
        return self.fps if film is None else min(self.fps, film.fastest)

    def _require_effect(self, kind: Kind) -> None:
        """Raise InputError for options that have no effect on this kind of output."""
        for name in kind.lacks:
            if getattr(self, name) != getattr(type(self), name):
                raise InputError(f"{name} has no effect on a {kind.name}, '{self.record}'")
        if self.pixels is not None and kind is FILM:
            size_of("size", self.size, is_film=True)
        if self.checkpoint is not None and not kind.continues:
            raise InputError(
                f"'{self.record}' cannot be continued from a checkpoint: record a .usdc file, then plot it"
            )

    def stored(self, checkpoint: Path) -> dict[str, Any]:
        """Return the options as checkpoints store them, with file names relative to the checkpoint."""
        files = {name: getattr(self, name) for name in FILES}
        seen = {name: file and os.path.relpath(file, checkpoint.parent) for name, file in files.items()}
        return {**asdict(self), **seen, "checkpoint": checkpoint.name}

    @classmethod
    def restored(cls, stored: dict[str, Any], checkpoint: Path) -> Self:
        """Return the options that a checkpoint stores; the next checkpoint of the run replaces it."""
        files = {name: _path_relative_to(checkpoint, name, stored[name]) for name in FILES}
        return cls(**{**stored, **files, "checkpoint": str(checkpoint)})


def steps_of(scene: Scene, steps: int | None, duration: float | None) -> int:
    """Return the steps of a run: `steps`, those of a duration [s], or the scene's."""
    if steps is not None and duration is not None:
        raise InputError("give steps or duration, not both")
    if steps is not None:
        return checks.whole_number("steps", steps, least=0)
    return scene.steps if duration is None else scene.steps_in(checks.positive("duration", duration))


def require_needed(given: Collection[str], named: Callable[[str], str] = str) -> None:
    """Raise InputError if an option is given without the one that it needs; `named` returns their names."""
    for name in given:
        needed = OPTIONS[name].metadata["needs"]
        if needed is not None and needed not in given:
            raise InputError(f"{named(name)} has no effect without {named(needed)}")


def _path_relative_to(checkpoint: Path, field: str, stored: Any) -> str | None:
    """Return the path of a file that is stored relative to a checkpoint; None if none is stored."""
    if stored is None:
        return None
    name = _file_name(field, stored)
    if os.path.isabs(name):
        raise InputError(f"{field} is {name!r}: it must be a path relative to the checkpoint")
    return os.path.normpath(checkpoint.parent / name)


OPTIONS = described_fields(RunOptions)
"""The described fields of `RunOptions`, by name."""
FLAGS: dict[str, str] = {
    name: flag
    for name, option in OPTIONS.items()
    if (flag := option.metadata.get("flag", f"--{name.replace('_', '-')}")) is not None
}
"""Flags of these options on the command line."""
