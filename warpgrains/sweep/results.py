"""The result of a run, a row of a table.

First come the number of the run, the scene, and what it takes from the axes of the sweep, a column an axis.
Then those of `UNITS`, and before the last of them, `error`, what else is asked for: `met`, 1 if the run has
ended at its criterion and else 0, and what is measured. They are the same whenever, wherever and after
however many interruptions the run is done. The last is `seconds`, its wall time, which the table of all
results leaves out.
"""

from collections.abc import Iterable, Iterator
from itertools import repeat

import numpy as np

from warpgrains.analysis.quantities import OF_A_SWEEP, QUANTITIES
from warpgrains.analysis.snapshot import Snapshot
from warpgrains.errors import SceneError
from warpgrains.files import Row
from warpgrains.solver.ends import Ends
from warpgrains.solver.statistics import RunStatistics

UNITS = {
    "grains": "",
    "steps": "",
    "time": "s",  # simulated
    "iterations_mean": "",  # a step
    "iterations_max": "",
    "unconverged": "",  # steps that stopped short of the tolerance
    "worst_overlap": "m",  # after any step
    **{name: QUANTITIES[name].unit for name in OF_A_SWEEP},  # at the end of the run
    "error": "",  # why the run failed, if it did
}
"""Units of the columns that every sweep has, in their order."""
MET = "met"
COUNTS = ("grains", "steps", "iterations_max", "unconverged", MET)
"""Columns that are whole numbers."""
SECONDS = "seconds"
COUNTED = ("steps", "iterations", "iterations_max", "unconverged", "overlap", MET, SECONDS)
"""What results need of `RunStatistics`."""


def columns_of(more: Iterable[str]) -> list[str]:
    """Return the columns of results after the labels; `more` are `MET` and names of measured quantities."""
    *common, error = UNITS
    return [*common, *(name for name in more if name not in UNITS), error]


def more_columns(measured: Iterable[str], until: str | None) -> tuple[str, ...]:
    """Return the columns that not every sweep has, see `columns_of`."""
    return (*measured,) if until is None else (MET, *measured)


def result(labels: Row, end: Snapshot, done: RunStatistics, more: Iterable[str] = ()) -> Row:
    """Return the result of a run that has reached its end; its labels are the first columns."""
    counted = {name: np.array([value]) for name, value in vars(done).items() if name in COUNTED}
    columns = columns_of(more)
    (cells,) = results(Ends(end.grains, np.array([end.scene.dt]), counted), [end], columns)
    return labels | dict(zip([*columns, SECONDS], cells, strict=True))


def results(ends: Ends, each: Iterable[Snapshot], columns: Iterable[str]) -> Iterator[tuple[str, ...]]:
    """Return the results of runs that have reached their ends, without labels.

    Parameters
    ----------
    ends
        The runs.
    each
        Their ends one by one, which are asked for only where something more is measured.
    columns
        See `columns_of`.
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
        **{name: of_runs(grains) for name, of_runs in OF_A_SWEEP.items()},
    }
    if MET in columns:
        numbers[MET] = done[MET].astype(np.int64)
    measured = [name for name in columns if name not in (*UNITS, MET)]
    if measured:
        moments = list(each)
        numbers |= {name: np.array([QUANTITIES[name].of(moment) for moment in moments]) for name in measured}
    cells = [map(repr, numbers[name].tolist()) if name in numbers else repeat("") for name in columns]
    return zip(*cells, (f"{seconds:.3f}" for seconds in done[SECONDS].tolist()), strict=False)


def failure(labels: Row, reason: str, seconds: float = 0.0, more: Iterable[str] = ()) -> Row:
    """Return the result of a run that failed."""
    return labels | dict.fromkeys(columns_of(more), "") | {"error": reason, SECONDS: f"{seconds:.3f}"}


def require_result(rows: list[Row], labels: Row, more: Iterable[str] = ()) -> Row:
    """Return the one row of a run's table; raise SceneError unless it is a result with these labels."""
    columns = [*labels, *columns_of(more), SECONDS]
    if len(rows) != 1 or list(rows[0]) != columns or None in rows[0].values():
        raise SceneError("it is not one row of these columns")
    row = rows[0]
    if any(row[name] != label for name, label in labels.items()):
        raise SceneError("it is of another run")
    numbers = [SECONDS] if row["error"] else [name for name in columns[len(labels) :] if name != "error"]
    for name in numbers:
        try:
            (int if name in COUNTS else float)(row[name])
        except ValueError:
            raise SceneError(f"{name} is {row[name]!r}") from None
    return row
