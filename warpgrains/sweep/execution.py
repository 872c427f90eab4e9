"""Settings of the runs of a sweep, options of their execution, and the size of groups of runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from warpgrains.space.region import table_of

GROWTH = 8  # largest ratio of the size of a group or bundle to the previous one

OnFraction = Callable[[float], None]
"""Callback that receives the progress since its last call, in runs: 0.25 is a quarter of one run."""


class RunSettings(NamedTuple):
    """Settings of all runs of a sweep, which determine their files. A resumed sweep needs equal settings."""

    measured: tuple[str, ...] = ()
    """Names of measured quantities."""
    until: str | None = None
    """End criterion of each run, see `criterion`."""
    region: str | None = None
    """Region of the quantities that take one, as a text for `table_of`."""
    fps: float | None = None
    """Frames per second of simulated time [1/s]; None if runs are not recorded."""
    every: int | None = None
    """Steps between two rows of the series of a run; None without series."""
    mean: bool = False
    """Whether rows of series hold means over these steps."""
    after: float | None = None
    """Time [s] from which results hold means over the series of a run; None without means."""

    @property
    def table(self) -> dict[str, Any] | None:
        """`region` as a table, see `table_of`, or None."""
        return None if self.region is None else table_of("region", self.region)


@dataclass(frozen=True)
class ExecutionOptions:
    """Device and threads of the runs of a sweep, and whether they have folders."""

    device: str = "cpu"
    """A Warp device, "cpu" or "cuda:0"."""
    threads: int | None = None
    """OS threads on a CPU; None for the number of cores."""
    folders: bool = False
    """Whether every run has a folder. If not, only runs that do not end in the time of one group have one."""


def next_size(size: int, seconds: float, wanted: float, most: float, least: int = 1) -> int:
    """Return the size of a group that would take `wanted` seconds, if one of `size` runs took `seconds`.

    It is between `least` and `most`, or `most` if this is less than `least`, and at most `GROWTH` times
    `size` unless `least` is larger.
    """
    paced = size * min(GROWTH, wanted / max(seconds, 1e-3))
    return max(1, int(min(max(least, paced), most)))
