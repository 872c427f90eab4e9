"""Time series of quantities of a simulation during a run, as a table and as a CSV file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self, TypedDict

import numpy as np

from warpgrains.analysis.quantities import find, names_of, quantities, require_effect
from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import InputError, OutputError
from warpgrains.base.files import read_table, require_writable_path, table_text, write_atomically
from warpgrains.base.locks import Lock
from warpgrains.base.shown import number_of
from warpgrains.base.tables import dataset, library
from warpgrains.scene.snapshot import Snapshot

if TYPE_CHECKING:
    import pandas
    import xarray

    from warpgrains.simulation.simulation import Simulation

FIRST = ("step", "time")


class Measuring(TypedDict, total=False):
    """Keywords of `Series` that `Simulation.measure` takes."""

    region: Mapping[str, Any] | None
    mean: bool
    path: str | Path | None


class Average(NamedTuple):
    """A mean over time."""

    mean: float
    error: float
    """Standard error of the mean."""


def _mean(mean: float, before: float, value: float, weight: float) -> float:
    """Return (before * mean + weight * value) / (before + weight), the mean after another value.

    If one of the two weights is 0, the number with this weight may be NaN.
    """
    if not weight:
        return mean
    return mean + (value - mean) * weight / (before + weight) if before else value


def block_average(values: FloatArray, blocks: int, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the weighted means of `values` over the first axis, and their standard errors.

    `values` and `weight` have the shape (rows, quantities). The rows are divided into `blocks` blocks of
    successive rows, and errors follow from the means of the blocks. Values of weight 0 may be NaN. InputError
    if there are fewer rows than blocks.
    """
    if len(values) < checks.whole_number("blocks", blocks, least=2):
        left = number_of(len(values), "measurement")
        raise InputError(f"blocks is {blocks}: only {left} from this time on")
    sums = np.where(weight > 0.0, values, 0.0) * weight, weight
    with np.errstate(invalid="ignore", divide="ignore"):
        total, share = (own.sum(axis=0) for own in sums)
        parts = [
            part.sum(axis=0) / own.sum(axis=0)
            for part, own in zip(*(np.array_split(own, blocks) for own in sums), strict=True)
        ]
        return total / share, np.std(parts, axis=0, ddof=1) / np.sqrt(blocks)


class Series:
    """Table of quantities, measured during a run: ``simulation.run(observer=series)``.

    Parameters
    ----------
    measure : str or iterable of str
        Names of `QUANTITIES` or `GROUPS`, of a wall such as "force_x:top", or of the slices of a profile such
        as "height_profile:20"; a single text may hold several, separated by commas.
    every : int
        Steps between two rows. Rows are at multiples of this number.
    path : str or Path, optional
        CSV file, written completely at each checkpoint and at the end. It is locked until `close` or the end
        of a ``with`` block.
    resume_at : int, optional
        Step up to which existing rows of the file are kept and continued.
    first_step : int
        Step at which the run to be continued began.
    region : mapping, optional
        Region for those quantities that take one, see `quantities`.
    mean : bool
        Whether to measure after every step, and to write means over the steps since the previous row. Then
        the first row is that of step `every`. By default a row holds the values of its step.

    Attributes
    ----------
    names : tuple of str
        Names of the quantities.
    means : tuple of float
        Means over the steps since the last row, in the order of the names.
    rows : list of dict
        Measurements: `step`, `time` [s] and the quantities, in the units of `QUANTITIES`.

    Raises
    ------
    InputError
        A name is unknown, no quantity takes the region, or the file cannot be written or continued. It is an
        `OutputError` if another process writes the file, or the file is no series.

    Examples
    --------
    >>> series = analysis.Series("coordination", every=100)
    >>> other = wg.Simulation(simulation.scene)
    >>> summary = other.run(duration=2.0, observer=series)
    >>> [row["step"] for row in series.rows], series.names
    ([0, 100, 200], ('coordination_number', 'rattlers'))
    """

    def __init__(
        self,
        measure: str | Iterable[str],
        every: int = 10,
        path: str | Path | None = None,
        *,
        resume_at: int | None = None,
        first_step: int = 0,
        region: Mapping[str, Any] | None = None,
        mean: bool = False,
    ) -> None:
        if not isinstance(measure, Iterable):
            given = checks.shown(measure)
            raise InputError(f"measure is {given}: it must be names of quantities, such as 'kinetic_energy'")
        self.names = names_of(measure)
        self._weights = [(name, find(name).weight) for name in self.names]
        self._interval = checks.whole_number("every", every)
        self.region, self._is_mean = region, checks.boolean("mean", mean)
        require_effect(region, self.names)
        self.every = 1 if mean else self._interval
        self.means: tuple[float, ...] = ()
        self._seen, self._count = resume_at, 0
        self.rows: list[dict[str, float]] = []
        self._path = None if path is None else Path(path)
        self._lock: Lock | None = None
        self._written = 0
        if self._path is not None:
            require_writable_path("series", self._path, ".csv")
            self._lock = Lock(self._path)
            try:
                self._read_rows(self._path, resume_at, first_step)
            except BaseException:
                self.close()
                raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def observe(self, simulation: Simulation | Snapshot) -> None:
        """Measure the present step, unless it is measured already.

        Append a row if the step is a multiple of `every`.
        """
        step, seen = simulation.steps, self._seen
        if seen is not None and step <= seen:
            return
        self._seen = step
        if self._is_mean and seen is None:
            return  # no step precedes the start
        found = quantities(simulation, self.names, self.region)
        if self._is_mean:
            self._count = self._count + 1 if self.means else 1
            means = dict(zip(found, self.means or found.values(), strict=True))
            of_steps = {name: (means[own], found[own]) if own else (1.0, 1.0) for name, own in self._weights}
            self.means = tuple(
                _mean(means[name], (self._count - 1) * before, found[name], weight)
                for name, (before, weight) in of_steps.items()
            )
            found = dict(zip(found, self.means, strict=True))
        if step % self._interval == 0:
            self.rows.append({"step": step, "time": simulation.time, **found})
            self.means = ()

    def flush(self) -> None:
        """Write all rows so far to the file, if one was given."""
        if self._path is not None and len(self.rows) > self._written:
            write_atomically(self._path, table_text(self.rows).encode())
            self._written = len(self.rows)

    def average(self, after: float = 0.0, blocks: int = 10) -> dict[str, Average]:
        """Return the means of the rows from a time on, with standard errors, by name of the quantity.

        Velocities, spins and temperatures of slices are weighted by their packing fractions.

        Errors follow from the means of blocks of successive rows. They are right if a block is longer than
        the correlation time of the quantity.

        Parameters
        ----------
        after : float
            Time from which rows count [s].
        blocks : int
            Number of blocks, at least 2.

        Raises
        ------
        InputError
            There are fewer rows than blocks.
        """
        rows = [row for row in self.rows if row["time"] >= after]
        values, weights = (
            np.array([[row[name] if name else 1.0 for name in names] for row in rows])
            for names in zip(*self._weights, strict=True)
        )
        mean, error = (part.tolist() for part in block_average(values, blocks, weights))
        return {name: Average(*own) for name, *own in zip(self.names, mean, error, strict=True)}

    def to_pandas(self) -> pandas.DataFrame:
        """Return the rows as a DataFrame, with the step as index.

        Raises
        ------
        InputError
            pandas is not installed; the extra ``[data]`` installs it.
        """
        columns = [*FIRST, *self.names]
        return library("pandas", "to_pandas").DataFrame(self.rows, columns=columns).set_index("step")

    def to_xarray(self) -> xarray.Dataset:
        """Return the rows as a dataset over the steps, with units.

        Raises
        ------
        InputError
            pandas or xarray is not installed; the extra ``[data]`` installs them.
        """
        return dataset(self.to_pandas(), {"time": "s"} | {name: find(name).unit for name in self.names})

    def close(self) -> None:
        """Release the lock on the file."""
        if self._lock is not None:
            self._lock.release()

    def _read_rows(self, path: Path, resume_at: int | None, first_step: int) -> None:
        """Read the rows up to step `resume_at` from the file; without a `resume_at`, only check the file.

        `first_step` is the step at which the run began. OutputError if the file is no series. InputError if
        it has other columns or lacks rows.
        """
        rows = read_table(path) if path.exists() else []
        if path.exists() and (not rows or tuple(rows[0])[:2] != FIRST):
            raise OutputError(f"refusing to overwrite '{path}': not a series of warpgrains")
        if resume_at is None:
            return
        if rows and tuple(rows[0]) != (*FIRST, *self.names):
            raise InputError(
                f"'{path}' has other columns than --measure: choose another --series, or the same --measure"
            )
        try:
            for row in rows:
                if int(row["step"]) <= resume_at:
                    numbers = {name: float(cell) for name, cell in row.items()}
                    self.rows.append(numbers | {"step": int(row["step"])})
        except (ValueError, TypeError):
            raise InputError(f"'{path}' holds a value that is not a number") from None
        last = int(self.rows[-1]["step"]) if self.rows else first_step - (not self._is_mean)
        self._count = resume_at - last
        if resume_at // self._interval > last // self._interval:
            raise InputError(f"'{path}' lacks rows before step {resume_at}: the series cannot be continued")
