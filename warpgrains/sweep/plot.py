"""Plot of a sweep: one column of its results over another."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure

from warpgrains.analysis.plots import save_figure
from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray, IndexArray
from warpgrains.base.errors import InputError
from warpgrains.base.files import read_columns
from warpgrains.sweep.results import unit_of
from warpgrains.sweep.shards import writer

_SIZE = (6.0, 3.6)  # inches
MOST_POINTS = 50_000
LEAST_RATIO_FOR_LOG = 10.0  # least ratio of largest to smallest value for a logarithmic axis

Columns = Mapping[str, list[str]]


@dataclass(frozen=True)
class SweepPlot:
    """A plot with one point per run, and a line through the means at each x."""

    x: str
    y: str
    """Columns of the results on the axes x and y."""
    color: str | None = None
    """Column that determines the color. Each value in it has its own line."""

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the plot that a text describes, such as "x=physics.drag, y=pile_height, color=scene"."""
        keys: dict[str, str] = {}
        for part in text.split(","):
            key, equals, column = part.strip().partition("=")
            if not (equals and column):
                raise InputError(f"--plot {text!r}: it must be x=COLUMN,y=COLUMN")
            checks.one_of("key of --plot", key, ("x", "y", "color"))
            keys[key] = column.strip()
        if not {"x", "y"} <= keys.keys():
            raise InputError(f"--plot {text!r}: it must name x and y")
        return cls(**keys)

    def require_columns(self, columns: Iterable[str]) -> None:
        """Raise InputError unless all columns of the plot are among `columns`."""
        for name in (self.x, self.y, self.color):
            if name is not None:
                checks.one_of("column to plot", name, columns)

    def draw(self, results: Path) -> Path:
        """Draw the plot from the table of results, and return the path of the picture.

        InputError if no run succeeded.
        """
        columns = read_columns(results, self._columns)
        good = [k for k, error in enumerate(columns["error"]) if not error]
        if not good:
            raise InputError(f"'{results}' holds nothing to draw: no run has succeeded")
        columns = {name: [cells[k] for k in good] for name, cells in columns.items()}
        figure = Figure(figsize=_SIZE, layout="constrained")
        self.draw_on(figure.subplots(), columns)
        picture = results.with_name(f"{self.y}-{self.x}.png")
        save_figure(figure, picture, writer())
        return picture

    def _columns(self, head: list[str]) -> Iterable[str]:
        self.require_columns(head)
        return {self.x, self.y, self.color or "error", "error"}

    def draw_on(self, axes: Axes, columns: Columns) -> None:
        """Draw the plot from columns of the results, without failed runs.

        Of more than `MOST_POINTS` points, every k-th is drawn.
        """
        x, y = _numbers(axes.xaxis, columns[self.x]), _numbers(axes.yaxis, columns[self.y])
        names, group = _coded(columns[self.color] if self.color else [""] * len(x))
        every = -(-len(x) // MOST_POINTS)
        for k, shade in enumerate(colormaps["viridis"](np.linspace(0.0, 0.85, len(names)))):
            own = np.flatnonzero(group == k)
            shown = own if every == 1 else own[np.argsort(x[own], kind="stable")][::every]
            axes.plot(x[shown], y[shown], "o", color=shade, alpha=0.4, markersize=4.0, markeredgewidth=0.0)
            places, place = np.unique(x[own], return_inverse=True)
            means = np.bincount(place, y[own]) / np.bincount(place)
            axes.plot(places, means, "-", color=shade, linewidth=1.2, label=names[k])
        if every > 1:
            axes.set_title(f"{len(x)} runs, a point for one of {every}", fontsize="small")
        axes.set(xlabel=_label(self.x), ylabel=_label(self.y))
        if _is_geometric(x):
            axes.set_xscale("log")
        if _is_geometric(y):
            axes.set_yscale("log")
        axes.grid(alpha=0.25)
        if self.color is not None:
            axes.legend(title=self.color, fontsize="small", title_fontsize="small", frameon=False)


def _numbers(axis: Axis, cells: list[str]) -> FloatArray:
    """Return the cells of a column as numbers; words become indices of words, which label the axis."""
    try:
        return np.array([float(cell) for cell in cells])
    except ValueError:
        words, indices = _coded(cells)
        axis.set_ticks(range(len(words)), words)
        return indices.astype(np.float64)


def _coded(cells: list[str]) -> tuple[list[str], IndexArray]:
    """Return the distinct words in order of appearance, and the index of each word among them."""
    indices = {word: index for index, word in enumerate(dict.fromkeys(cells))}
    return list(indices), np.array([indices[cell] for cell in cells])


def _is_geometric(values: FloatArray) -> bool:
    """Return whether values are spaced like a geometric series, so that the axis should be logarithmic.

    The median is then closer to the geometric than to the arithmetic mean of the extremes.
    """
    low, middle, high = np.quantile(np.unique(values), [0.0, 0.5, 1.0])
    if low <= 0.0 or high < LEAST_RATIO_FOR_LOG * low:
        return False
    return bool(middle**2 < 0.5 * (low + high) * np.sqrt(low * high))


def _label(column: str) -> str:
    unit = unit_of(column)
    return f"{column} [{unit}]" if unit else column
