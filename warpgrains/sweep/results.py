"""The result of a run, a row of a table.

First come the number of the run, the scene, and what it takes from the axes of the sweep, a column an axis.
Then those of `UNITS`, the same whenever, wherever and after however many interruptions the run is done. The
last is `seconds`, its wall time, which the table of all results leaves out.
"""

from warpgrains.analysis.quantities import OF_A_SWEEP, QUANTITIES
from warpgrains.analysis.snapshot import Snapshot
from warpgrains.errors import SceneError
from warpgrains.files import Row
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
COUNTS = ("grains", "steps", "iterations_max", "unconverged")
"""Those that are whole numbers."""
SECONDS = "seconds"


def result(labels: Row, end: Snapshot, done: RunStatistics) -> Row:
    """Return the result of a run that has reached its end; its labels are the first columns."""
    values = {
        "grains": end.n,
        "steps": done.steps,
        "time": done.steps * end.scene.dt,
        "iterations_mean": done.iterations / max(1, done.steps),
        "iterations_max": done.iterations_max,
        "unconverged": done.unconverged,
        "worst_overlap": done.overlap,
        **{name: QUANTITIES[name].of(end) for name in OF_A_SWEEP},
    }
    return _row(labels, {name: repr(value) for name, value in values.items()}, done.seconds)


def failure(labels: Row, reason: str, seconds: float = 0.0) -> Row:
    """Return the result of a run that failed."""
    return _row(labels, {"error": reason}, seconds)


def require_result(rows: list[Row], labels: Row) -> Row:
    """Return the one row of a run's table; raise SceneError unless it is a result with these labels."""
    columns = [*labels, *UNITS, SECONDS]
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


def _row(labels: Row, values: Row, seconds: float) -> Row:
    return labels | dict.fromkeys(UNITS, "") | values | {SECONDS: f"{seconds:.3f}"}
