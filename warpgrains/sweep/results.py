"""The result of a run: one row of a table.

The first columns are labels: the number of the run, the scene, and its value on each axis of the sweep. Those
of `COLUMNS` follow, and before the last of them, `error`, the measured quantities. All these do not depend on
when, where and with how many interruptions the run is done. The last column is `seconds`, the time for
the steps of the run and for completing its recording. The table of all results omits it.

`results` finds all columns of finished runs, from their `FinalStates`. Those of short runs are arrays of
thousands of runs in memory (`SetSteps.ended`), that of a long run is made of its last state (`result`).
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpgrains.analysis.quantities import QUANTITIES, SWEEP_QUANTITIES, quantities, takes_region
from warpgrains.arrays import FloatArray
from warpgrains.errors import InputError
from warpgrains.files import Row
from warpgrains.scene.snapshot import Snapshot, Snapshots
from warpgrains.solver.final_states import FinalStates
from warpgrains.solver.statistics import Summary, stacked
from warpgrains.sweep.execution import RunSettings


class Column(NamedTuple):
    """A column of the results that every sweep has, or every sweep with an end criterion."""

    meaning: str
    of_runs: Callable[[FinalStates], NDArray[Any]]
    """Values of many runs at once, shape (m,)."""
    unit: str = ""
    kind: type[float] = float


def _counted(field: str, meaning: str) -> Column:
    """Return the column of a count of `Summary`."""
    return Column(meaning, lambda ends: ends.done[field].astype(np.int64), kind=int)


def _at_the_end(name: str, of_runs: Callable[[Snapshots], FloatArray]) -> Column:
    """Return the column of a quantity of the final state."""
    quantity = QUANTITIES[name]
    return Column(
        f"{quantity.meaning}, at the end of the run", lambda ends: of_runs(ends.grains), quantity.unit
    )


MET = "met"
SECONDS = "seconds"
COLUMNS = {
    "grains": Column(
        "number of grains", lambda ends: np.full(len(ends.dt), ends.grains.mass.shape[1]), kind=int
    ),
    "steps": _counted("steps", "number of time steps"),
    "time": Column("simulated time", lambda ends: ends.done["steps"] * ends.dt, "s"),
    "iterations_mean": Column(
        "iterations of a step, mean", lambda ends: ends.done["iterations"] / np.maximum(1, ends.done["steps"])
    ),
    "iterations_max": _counted("iterations_max", "iterations of a step, maximum"),
    "unconverged": _counted("unconverged", "number of steps that stopped short of the tolerance"),
    "worst_overlap": Column("largest overlap after any step", lambda ends: ends.done["overlap"], "m"),
    **{name: _at_the_end(name, of_runs) for name, of_runs in SWEEP_QUANTITIES.items()},
    MET: Column(
        "with `--until`: 1 if the run was at rest, else 0",
        lambda ends: ends.done[MET].astype(np.int64),
        kind=int,
    ),
    "error": Column("reason of the failure, if the run failed", lambda ends: np.full(len(ends.dt), "")),
}
"""Columns in order; `met` is that of sweeps with an end criterion."""
UNITS = {name: found.unit for name, found in (QUANTITIES | COLUMNS).items()}
"""Units of these columns and of the measured quantities."""

RunResult = tuple[Any, ...]
"""A result without labels, in the order of `value_columns`, followed by the seconds."""


def value_columns(settings: RunSettings) -> list[str]:
    """Return the columns of results after the labels, without the seconds."""
    *common, error = (name for name in COLUMNS if name != MET or settings.until is not None)
    return [*common, *(name for name in settings.measured if name not in COLUMNS), error]


def results(ends: FinalStates, snapshots: Iterable[Snapshot], settings: RunSettings) -> Iterator[RunResult]:
    """Return the results of finished runs, without labels; snapshots serve the measured quantities."""
    columns, region = value_columns(settings), settings.table
    in_region = [name for name in SWEEP_QUANTITIES if region is not None and takes_region([name])]
    measured = [name for name in columns if name not in COLUMNS or name in in_region]
    values = {name: COLUMNS[name].of_runs(ends).tolist() for name in columns if name not in measured}
    if measured:
        found = [quantities(state, measured, region) for state in snapshots]
        values |= {name: [float(one[name]) for one in found] for name in measured}
    seconds = (f"{wall_time:.3f}" for wall_time in ends.done[SECONDS].tolist())
    return zip(*(values[name] for name in columns), seconds, strict=True)


def result(end: Snapshot, done: Summary, settings: RunSettings) -> RunResult:
    ends = FinalStates(end.grains, np.array([end.scene.dt]), stacked([done]))
    return next(results(ends, [end], settings))


def failure(reason: str, columns: Sequence[str], seconds: float = 0.0) -> RunResult:
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
            (COLUMNS[name].kind if name in COLUMNS else float)(row[name])
        except ValueError:
            raise InputError(f"{name} is {row[name]!r}") from None
    return row
