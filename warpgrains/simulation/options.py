"""Options of runs.

A checkpoint stores the options of its run, but not the options of the execution, such as device and threads.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from warpgrains.base import checks
from warpgrains.base.described import described_fields
from warpgrains.base.errors import InputError
from warpgrains.base.files import resolve_link
from warpgrains.drawing.frames import FrameTimes
from warpgrains.drawing.kinds import FILM, FILMS, KINDS, Kind, described_kinds, form_of, size_of
from warpgrains.drawing.looks import Look, Looks, option

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

_BRIEF = 1.0  # films of a shorter simulated time [s] are slowed down
_SLOWER = [digit * 10.0**k for k in range(9) for digit in (1, 2, 5)]
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
    """Return the name of an output; InputError unless its form (suffix) is one of `KINDS`."""
    name = _file(field, name)
    if form_of(name) not in KINDS:
        raise InputError(f"output '{name}' must end in {', '.join(KINDS)}")
    return name


def _region(field: str, text: Any) -> str:
    """Return the text of a region; InputError unless it describes a table."""
    from warpgrains.space.region import table_of  # imports NumPy, which --help does not need

    table_of(field, text)
    return str(text)


class Outputs(Looks, total=False):
    """Fields of `RunOptions` that are keywords of `Simulation.run`: type checkers report wrong keywords."""

    record: str | Path | None
    draw_as: str
    checkpoint: str | Path | None
    every: int


@dataclass(frozen=True, kw_only=True)
class RunOptions(Look):
    """Length and outputs of a run. Raises InputError where a value is invalid or has no effect."""

    steps: int
    """Planned number of time steps."""
    record: str | None = option(f"File to write: {described_kinds()}.", _output, "OUT", flag="--output")
    draw_as: str = option(
        "Form of the grains in a USD file: points, discs or spheres.",
        checks.text,
        "FORM",
        flag="--draw-as",
        default="points",
        needs="record",
    )
    checkpoint: str | None = option(
        "An .npz file to save the run to as it goes, from which it can be resumed.", _file, "FILE"
    )
    every: int = option(
        "Steps between two checkpoints; the first and the last state are always saved.",
        checks.whole_number,
        "K",
        default=1000,
        needs="checkpoint",
    )
    until: str | None = option(
        "End criterion of the run: rest[,speed=V][,energy=E][,time=T], with bounds in m/s, J and s.",
        checks.text,
        "rest",
    )
    measure: str | None = option(
        "Quantities to measure as the run goes, such as energy,stress.",
        checks.text,
        "WHAT,...",
        needs="series",
    )
    series: str | None = option(
        "A CSV file for the measured quantities, one row every K steps.", _file, "CSV", needs="measure"
    )
    measure_every: int = option(
        "Steps between two rows of a series.", checks.whole_number, default=10, needs="series", flag=None
    )
    region: str | None = option(
        "Region of the measured quantities that have one, such as 'x = [-1.0, 0.0], below = \"surface\"'.",
        _region,
        "RANGES",
        needs="measure",
    )
    mean: bool = option(
        "Measure in every step; rows hold the means of the K steps up to their own.",
        checks.boolean,
        default=False,
        needs="series",
    )

    def __post_init__(self) -> None:
        checks.whole_number("steps", self.steps, least=0)
        super().__post_init__()
        require_needed([name for name, one in OPTIONS.items() if getattr(self, name) != one.default])
        if self.mean and 0 < self.steps < self.measure_every:
            raise InputError(
                f"steps is {self.steps}: no mean over {self.measure_every} steps ends within them; give more"
                " steps, or means over fewer"
            )
        if self.shows is not None:
            self._require_effect(self.shows)

    @property
    def shows(self) -> Kind | None:
        """Kind of output, by the suffix of `record`; None without `record`."""
        return None if self.record is None else KINDS[form_of(self.record)]

    def times(self, scene: Scene, first_step: int) -> FrameTimes | None:
        """Return the times of the frames of a run that begins at step `first_step`; None without frames.

        The kind of the file can limit the frames per second.
        """
        if self.shows is None or not self.shows.has_frames:
            return None
        film = FILMS.get(form_of(self.record or ""))
        rate = self.fps if film is None else min(self.fps, film.fastest)
        slow = self.slow or (1.0 if film is None else self._slow_enough(self.steps * scene.dt, scene.dt))
        return FrameTimes.of(scene.dt, rate, first_step, scene.time, slow)

    def _slow_enough(self, duration: float, dt: float) -> float:
        """Return the factor by which the film of a run plays slower than the run, if `slow` is not given.

        It is more than 1 only for a brief `duration` of the run [s] and the default of `fps`, and so small
        that the film has at most one frame per step.
        """
        if not 0.0 < duration < _BRIEF or self.fps != type(self).fps:
            return 1.0
        enough = (slow for slow in _SLOWER if slow * duration >= 2.0 * _BRIEF)
        most = [slow for slow in _SLOWER if slow * self.fps * dt <= 1.0]
        return min(next(enough, _SLOWER[-1]), max(most, default=1.0))

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
        """Return the options that a checkpoint stores. The next checkpoints of the run replace it."""
        files = {name: _path_relative_to(checkpoint, name, stored[name]) for name in FILES}
        return cls(**{**stored, **files, "checkpoint": str(checkpoint)})


def steps_of(scene: Scene, steps: int | None, duration: float | None) -> int:
    """Return the number of steps of a run: `steps`, or those in `duration` [s], by default the scene's."""
    if steps is not None and duration is not None:
        raise InputError("give steps or duration, not both")
    if isinstance(steps, str):
        raise InputError(
            f"steps is {steps!r}: it must be a whole number; an end criterion is until={steps!r}"
        )
    if steps is not None:
        return checks.whole_number("steps", steps, least=0)
    return scene.steps if duration is None else scene.steps_in(checks.positive("duration", duration))


def require_needed(given: Collection[str], named: Callable[[str], str] = str) -> None:
    """Raise InputError if one of the options `given` has no effect without another one, which is missing.

    `named` returns the name of an option for messages.
    """
    for name in given:
        needed = OPTIONS[name].metadata["needs"]
        if needed is not None and needed not in given:
            raise InputError(f"{named(name)} has no effect without {named(needed)}")


def spacing(
    every: int | None, checkpoint: Any, series: Any, named: Callable[[str], str] = str
) -> dict[str, int]:
    """Return `every` [steps] by option: "every", between checkpoints; "measure_every", between rows.

    An option is included if its file, `checkpoint` or `series`, is not None. The result is {} if `every` is
    None; InputError if it has no effect. `named` returns the name of an option for messages.
    """
    if every is None:
        return {}
    if checkpoint is series is None:
        raise InputError(
            f"{named('every')} has no effect without {named('checkpoint')} or {named('measure')}"
        )
    files = {"every": checkpoint, "measure_every": series}
    return {name: every for name, file in files.items() if file is not None}


def _path_relative_to(checkpoint: Path, field: str, stored: Any) -> str | None:
    """Return the path of the file `stored`, a name relative to the folder of a checkpoint; None for None."""
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
    for name, one in OPTIONS.items()
    if (flag := one.metadata.get("flag", f"--{name.replace('_', '-')}")) is not None
}
"""Flags on the command line of the options that have one, by name in `OPTIONS`."""
