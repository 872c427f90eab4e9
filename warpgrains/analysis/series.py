"""Time series: quantities of a simulation as it runs, kept in a table and written as CSV."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Self

from warpgrains.analysis.quantities import QUANTITIES, names_of, quantities
from warpgrains.analysis.snapshot import Snapshot
from warpgrains.errors import InputError, OutputError
from warpgrains.files import Row, read_table, require_place, table_text, write_whole
from warpgrains.locks import Lock
from warpgrains.scene import checks
from warpgrains.tables import library

if TYPE_CHECKING:
    import pandas
    import xarray

    from warpgrains.simulation.simulation import Simulation

FIRST = ("step", "time")


class Series:
    """Measures quantities of a simulation while it runs: ``simulation.run(observer=series)``.

    Parameters
    ----------
    measure : str or iterable of str
        Names of `QUANTITIES` or `GROUPS`; in one text, with commas between them.
    every : int
        Steps between two rows: there is one at each step that is a multiple of it.
    path : str or Path, optional
        CSV file to write the rows to, whole, at each checkpoint and in the end. It is locked until `close`,
        or the end of a ``with`` block.
    resume_at : int, optional
        Continue the rows that the file has up to this step.

    Attributes
    ----------
    names : tuple of str
        The quantities.
    rows : list of dict
        What was measured: `step`, `time` [s] and the quantities, in the units of `QUANTITIES`.

    Raises
    ------
    InputError
        A name is unknown, or the file cannot be written or continued; as an `OutputError`, if another process
        writes it, or it is no series.

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
        resume_at: int | None = None,
    ) -> None:
        wanted = measure.split(",") if isinstance(measure, str) else measure
        self.names = names_of(name.strip() for name in wanted)
        self.every = checks.whole_number("every", every)
        self.rows: list[dict[str, float]] = []
        self._path = None if path is None else Path(path)
        self._lock: Lock | None = None
        self._written = 0
        if self._path is not None:
            require_place("series", self._path, ".csv")
            self._lock = Lock(self._path)
            try:
                self._take_up(self._path, resume_at)
            except BaseException:
                self.close()
                raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def observe(self, simulation: Simulation | Snapshot) -> None:
        """Measure, unless this step is measured already."""
        if not self.rows or self.rows[-1]["step"] < simulation.steps:
            found = quantities(simulation, self.names)
            self.rows.append({"step": simulation.steps, "time": simulation.time, **found})

    def flush(self) -> None:
        """Write all rows so far to the file, if there is one."""
        if self._path is not None and len(self.rows) > self._written:
            write_whole(self._path, table_text(self.rows).encode())
            self._written = len(self.rows)

    def to_pandas(self) -> pandas.DataFrame:
        """Return the rows as a frame, by step.

        Raises
        ------
        InputError
            pandas is not installed; it comes with the extra ``[data]``.
        """
        columns = [*FIRST, *self.names]
        return library("pandas", "to_pandas").DataFrame(self.rows, columns=columns).set_index("step")

    def to_xarray(self) -> xarray.Dataset:
        """Return the rows as a dataset over time, with units.

        Raises
        ------
        InputError
            xarray is not installed; it comes with the extra ``[data]``.
        """
        columns = {name: [row[name] for row in self.rows] for name in (*FIRST, *self.names)}
        return library("xarray", "to_xarray").Dataset(
            {name: ("time", columns[name], {"units": QUANTITIES[name].unit}) for name in self.names},
            coords={"time": ("time", columns["time"], {"units": "s"}), "step": ("time", columns["step"])},
        )

    def close(self) -> None:
        """Release the lock on the file."""
        if self._lock is not None:
            self._lock.release()

    def _take_up(self, path: Path, resume_at: int | None) -> None:
        """Refuse to replace a file that is no series; read the rows to continue."""
        if not path.exists():
            rows: list[Row] = []
        else:
            rows = read_table(path)
            if not rows or tuple(rows[0])[:2] != FIRST:
                raise OutputError(f"refusing to overwrite '{path}': not a series of warpgrains")
        if resume_at is None:
            return
        if rows and tuple(rows[0]) != (*FIRST, *self.names):
            raise InputError(
                f"'{path}' has other columns than --measure: choose another --series, or the same --measure"
            )
        try:
            kept = [row for row in rows if int(row["step"]) <= resume_at]
            self.rows = [{name: float(cell) for name, cell in row.items()} for row in kept]
        except (ValueError, TypeError):
            raise InputError(f"'{path}' holds a value that is not a number") from None
        for row in self.rows:
            row["step"] = int(row["step"])
        if not self.rows or self.rows[-1]["step"] <= resume_at - self.every:
            raise InputError(f"'{path}' lacks rows before step {resume_at}: the series cannot be continued")
