"""The result of a run: one row of a table.

The first columns are labels: the number of the run, the scene, and the value of the run on each axis. The
columns of `COLUMNS` follow; the measured quantities are inserted before the last one, `error`. The values do
not depend on when, where and with how many interruptions the run was done. The last column is `seconds`, the
time for the steps of the run and for completing its recording. The table of all results omits this column.

`results` computes all columns except labels, from the final states of thousands of runs in memory.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from warpgrains.analysis.quantities import find, quantities
from warpgrains.base.errors import InputError
from warpgrains.scene.scene import Scene
from warpgrains.scene.snapshot import Snapshot, Snapshots
from warpgrains.solver.statistics import Summary
from warpgrains.sweep.execution import RunSettings


class Column(NamedTuple):
    """A column that the results of every sweep have; but only sweeps with an end criterion have `met`."""

    meaning: str
    of_runs: Callable[[Snapshots, Sequence[Summary]], Sequence[Any]]
    """Function that returns the values of m runs, from their final states and summaries."""
    unit: str = ""


def _of_each(value: Callable[[Scene, Summary], Any], meaning: str, unit: str = "") -> Column:
    """Return a column with the cell value(scene, summary) for each run."""
    return Column(meaning, lambda ends, done: list(map(value, ends.scenes, done)), unit)


def _at_the_end(name: str) -> Column:
    """Return the column of the quantity `name`, measured in the final states."""
    own = find(name)
    return Column(
        f"{own.meaning}, at the end of the run", lambda ends, _: own.function(ends).tolist(), own.unit
    )


AT_THE_END = "kinetic_energy", "potential_energy", "pile_height", "pile_packing_fraction"
"""Quantities that every sweep measures in the final states. Their functions take many states: `Snapshots`."""
OF_MEAN, OF_ERROR = ":mean", ":error"
"""Suffixes of the names of columns with means over a series, and with the standard errors of these."""
MET = "met"
SECONDS = "seconds"
COLUMNS = {
    "grains": _of_each(lambda scene, _: scene.n, "number of grains"),
    "steps": _of_each(lambda _, done: done.steps, "number of time steps"),
    "time": _of_each(lambda scene, done: done.steps * scene.dt, "simulated time", "s"),
    "iterations_mean": _of_each(lambda _, done: done.iterations_mean, "iterations of a step, mean"),
    "iterations_max": _of_each(lambda _, done: done.iterations_max, "iterations of a step, maximum"),
    "unconverged": _of_each(
        lambda _, done: done.unconverged, "number of steps that stopped short of the tolerance"
    ),
    "worst_overlap": _of_each(lambda _, done: done.overlap, "largest overlap after any step", "m"),
    **{name: _at_the_end(name) for name in AT_THE_END},
    MET: _of_each(lambda _, done: int(done.met), "with `--until`: 1 if the run was at rest, else 0"),
    "error": _of_each(lambda *_: "", "reason of the failure, if the run failed"),
}
"""Columns by name, in order. Only sweeps with an end criterion have `met`."""


def unit_of(column: str) -> str | None:
    """Return the unit of a column, "" without a unit; None for a label."""
    if column in COLUMNS:
        return COLUMNS[column].unit
    try:
        return find(column.removesuffix(OF_MEAN).removesuffix(OF_ERROR)).unit
    except InputError:
        return None


RunResult = tuple[Any, ...]
"""The cells of a result after its labels: values of `value_columns`, then the seconds."""


def value_columns(settings: RunSettings) -> list[str]:
    """Return the names of the columns after the labels, except that of the seconds."""
    *common, error = (name for name in COLUMNS if name != MET or settings.until is not None)
    means = () if settings.after is None else settings.measured
    averaged = (f"{name}{end}" for name in means for end in (OF_MEAN, OF_ERROR))
    return [*common, *(name for name in settings.measured if name not in COLUMNS), *averaged, error]


def results(
    ends: Snapshots,
    done: Sequence[Summary],
    snapshots: Iterable[Snapshot],
    means: Sequence[Mapping[str, float]],
    settings: RunSettings,
) -> Iterator[RunResult]:
    """Return the values of each of m runs in all columns but the labels; `done` are their summaries.

    `ends` and `snapshots` both hold the final states: as arrays of all runs, for `COLUMNS`, and one by one,
    for the quantities that `settings` measures besides. `means` maps columns of means to values, by run.
    """
    columns, averaged = value_columns(settings), [*means[0]]
    measured = [name for name in columns if name not in {*COLUMNS, *averaged}]
    values = {name: COLUMNS[name].of_runs(ends, done) for name in columns if name in COLUMNS}
    values |= {name: [one[name] for one in means] for name in averaged}
    if measured:
        found = [quantities(state, measured, settings.table) for state in snapshots]
        values |= {name: [float(one[name]) for one in found] for name in measured}
    seconds = (f"{one.seconds:.3f}" for one in done)
    return zip(*(values[name] for name in columns), seconds, strict=True)


def failure(reason: str, settings: RunSettings, seconds: float = 0.0) -> RunResult:
    return (*("" for _ in value_columns(settings)[:-1]), reason, f"{seconds:.3f}")
