"""The result of a run: one row of a table.

The first columns are labels: the number of the run, the scene, and its value on each axis of the sweep. The
columns of `UNITS` follow. Before the last of them, `error`, are the optional columns: `met`, 1 if the run
ended by its criterion, else 0, and measured quantities. All these do not depend on when, where and with how
many interruptions the run is done. The last column is `seconds`, the wall time, which the table of all
results omits.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np

from warpgrains.analysis.quantities import QUANTITIES, SWEEP_QUANTITIES, quantities
from warpgrains.analysis.snapshot import Snapshot
from warpgrains.errors import InputError
from warpgrains.files import Row
from warpgrains.solver.final_states import FinalStates
from warpgrains.solver.statistics import RunStatistics

UNITS = {
    "grains": "",
    "steps": "",
    "time": "s",
    "iterations_mean": "",
    "iterations_max": "",
    "unconverged": "",
    "worst_overlap": "m",
    **{name: QUANTITIES[name].unit for name in SWEEP_QUANTITIES},
    "error": "",
}
"""Columns of every sweep in order, and their units."""
MEANINGS = {
    "grains": "number of grains",
    "steps": "number of time steps",
    "time": "simulated time",
    "iterations_mean": "iterations of a step, mean",
    "iterations_max": "iterations of a step, maximum",
    "unconverged": "number of steps that stopped short of the tolerance",
    "worst_overlap": "largest overlap after any step",
    **{name: f"{QUANTITIES[name].meaning}, at the end of the run" for name in SWEEP_QUANTITIES},
    "error": "reason of the failure, if the run failed",
}
"""Meanings of these columns, for the documentation."""
MET = "met"
COUNTS = ("grains", "steps", "iterations_max", "unconverged", MET)
"""Columns of integers."""
SECONDS = "seconds"
COUNTED = ("steps", "iterations", "iterations_max", "unconverged", "overlap", MET, SECONDS)
"""Fields of `RunStatistics` that results depend on."""

RunResult = tuple[Any, ...]
"""A result without labels, in the order of `Columns.after_labels`, followed by the seconds."""


class Columns(NamedTuple):
    """The columns of a sweep's results."""

    axes: tuple[str, ...] = ()
    """Keys of the axes of the sweep."""
    measured: tuple[str, ...] = ()
    """Names of measured quantities."""
    until: str | None = None
    """Criterion that ends each run early, see `criterion`."""

    @property
    def after_labels(self) -> list[str]:
        """Columns after the labels, without the seconds."""
        *common, error = UNITS
        met = [] if self.until is None else [MET]
        return [*common, *met, *(name for name in self.measured if name not in UNITS), error]

    @property
    def all(self) -> list[str]:
        """Columns of the table of all results."""
        return ["run", "scene", *self.axes, *self.after_labels]


def results(ends: FinalStates, snapshots: Iterable[Snapshot], columns: Sequence[str]) -> Iterator[RunResult]:
    """Return the results of finished runs, without labels.

    Parameters
    ----------
    ends
        Final states of the runs.
    snapshots
        Final states as snapshots, which are used only if quantities are measured.
    columns
        See `Columns.after_labels`.
    """
    grains, dt, done = ends
    steps = done["steps"]
    numbers = {
        "grains": np.full(len(steps), grains.mass.shape[1]),
        "steps": steps,
        "time": steps * dt,
        "iterations_mean": done["iterations"] / np.maximum(1, steps),
        "iterations_max": done["iterations_max"],
        "unconverged": done["unconverged"],
        "worst_overlap": done["overlap"],
        **{name: of_runs(grains) for name, of_runs in SWEEP_QUANTITIES.items()},
    }
    if MET in columns:
        numbers[MET] = done[MET].astype(np.int64)
    measured = [name for name in columns if name not in (*UNITS, MET)]
    if measured:
        found = [quantities(state, measured) for state in snapshots]
        numbers |= {name: np.array([one[name] for one in found]) for name in measured}
    values = [numbers[name].tolist() if name in numbers else repeat("") for name in columns]
    return zip(*values, (f"{seconds:.3f}" for seconds in done[SECONDS].tolist()), strict=False)


def result(end: Snapshot, done: RunStatistics, columns: Sequence[str]) -> RunResult:
    """Return the result of a finished run, see `results`."""
    counted = {name: np.array([getattr(done, name)]) for name in COUNTED}
    return next(results(FinalStates(end.grains, np.array([end.scene.dt]), counted), [end], columns))


def failure(reason: str, columns: Sequence[str], seconds: float = 0.0) -> RunResult:
    """Return the result of a failed run."""
    return (*("" for _ in columns[:-1]), reason, f"{seconds:.3f}")


def require_result(rows: list[Row], labels: Row, columns: Sequence[str]) -> Row:
    """Return the only row of a run's table. Raises InputError unless it is a result with these labels."""
    if len(rows) != 1 or list(rows[0]) != [*labels, *columns, SECONDS] or None in rows[0].values():
        raise InputError("it does not have one row with the columns of this sweep")
    row = rows[0]
    if any(row[name] != label for name, label in labels.items()):
        raise InputError("it is of another run")
    for name in [SECONDS] if row["error"] else [*columns[:-1], SECONDS]:
        try:
            (int if name in COUNTS else float)(row[name])
        except ValueError:
            raise InputError(f"{name} is {row[name]!r}") from None
    return row
