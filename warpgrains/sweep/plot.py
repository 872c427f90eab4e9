"""A picture of a sweep: one column of its results over another."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure

from warpgrains.analysis.plots import save_figure
from warpgrains.arrays import FloatArray
from warpgrains.errors import SceneError
from warpgrains.files import Row, read_table
from warpgrains.scene import checks
from warpgrains.sweep.results import UNITS

_SIZE = (6.0, 3.6)  # inches
LEAST_RATIO_FOR_LOG = 10.0  # of the largest to the smallest value on a logarithmic axis


@dataclass(frozen=True)
class SweepPlot:
    """What is drawn: a point a run, and a line through the means at each x."""

    x: str
    y: str
    """Both are columns of the results."""
    color: str | None = None
    """Column whose values have a color and a line each."""

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return what a text such as "x=physics.drag, y=pile_height, color=scene" asks for."""
        keys: dict[str, str] = {}
        for part in text.split(","):
            key, equals, column = part.strip().partition("=")
            if not (equals and column):
                raise SceneError(f"--plot {text!r}: it must be x=COLUMN,y=COLUMN")
            checks.one_of("key of --plot", key, ("x", "y", "color"))
            keys[key] = column.strip()
        if not {"x", "y"} <= keys.keys():
            raise SceneError(f"--plot {text!r}: it must name x and y")
        return cls(**keys)

    def require_columns(self, columns: Iterable[str]) -> None:
        """Raise SceneError unless all that is drawn is among the columns."""
        for name in (self.x, self.y, self.color):
            if name is not None:
                checks.one_of("column to plot", name, columns)

    def draw(self, results: Path) -> Path:
        """Draw the results in a table, and return the picture, which is beside it.

        Raises
        ------
        SceneError
            The table cannot be read, has no such columns, or nothing to draw in them.
        """
        rows = read_table(results)
        self.require_columns(rows[0] if rows else ())
        rows = [row for row in rows if not row["error"]]
        if not rows:
            raise SceneError(f"'{results}' holds nothing to draw: no run has come to its end")
        figure = Figure(figsize=_SIZE, layout="constrained")
        self.draw_on(figure.subplots(), rows)
        picture = results.with_name(f"{self.y}-{self.x}.png")
        save_figure(figure, picture)
        return picture

    def draw_on(self, axes: Axes, rows: list[Row]) -> None:
        """Draw the rows of a table, none of them of a run that failed."""
        x, y = _numbers(axes.xaxis, rows, self.x), _numbers(axes.yaxis, rows, self.y)
        groups = np.array([row[self.color] if self.color else "" for row in rows])
        names = list(dict.fromkeys(groups.tolist()))
        for name, shade in zip(names, colormaps["viridis"](np.linspace(0.0, 0.85, len(names))), strict=True):
            own = groups == name
            axes.plot(x[own], y[own], "o", color=shade, alpha=0.4, markersize=4.0, markeredgewidth=0.0)
            places = np.unique(x[own])
            means = [y[own & (x == place)].mean() for place in places]
            axes.plot(places, means, "-", color=shade, linewidth=1.2, label=name)
        axes.set(xlabel=_label(self.x), ylabel=_label(self.y))
        if _is_geometric(x):
            axes.set_xscale("log")
        if _is_geometric(y):
            axes.set_yscale("log")
        axes.grid(alpha=0.25)
        if self.color is not None:
            axes.legend(title=self.color, fontsize="small", title_fontsize="small", frameon=False)


def _numbers(axis: Axis, rows: list[Row], column: str) -> FloatArray:
    """Return the numbers in a column; if it holds words, their places among all words, named on the axis."""
    cells = [row[column] for row in rows]
    try:
        return np.array([float(cell) for cell in cells])
    except ValueError:
        words = list(dict.fromkeys(cells))
        axis.set_ticks(range(len(words)), words)
        return np.array([words.index(cell) for cell in cells], dtype=np.float64)


def _is_geometric(values: FloatArray) -> bool:
    """Whether the middle value is nearer to the geometric than to the arithmetic mean of the extremes."""
    low, middle, high = np.quantile(np.unique(values), [0.0, 0.5, 1.0])
    if low <= 0.0 or high < LEAST_RATIO_FOR_LOG * low:
        return False
    return bool(middle**2 < 0.5 * (low + high) * np.sqrt(low * high))


def _label(column: str) -> str:
    unit = UNITS.get(column)
    return f"{column} [{unit}]" if unit else column
