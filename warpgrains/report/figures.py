"""Figures of the report: error over iterations and wall time, error over dt, and overlap after equal work.

Runs of equal work have the same number of iterations per simulated time, in long or in short steps.
"""

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from warpgrains.report.rows import (
    COSTS,
    SCHEMES,
    SWEEPING,
    Configuration,
    FrontierRow,
    PathRow,
    StepRow,
    fitted_order,
)

# Okabe and Ito, Color Universal Design: distinct for color-blind readers, and by lightness in print.
_BLUE, _ORANGE, _GREEN, _GREY = "#0072b2", "#d55e00", "#009e73", "0.6"
_COLOR = {"gauss-seidel": _BLUE, "accelerated": _ORANGE, "exact": _GREEN}
_SCHEME_COLOR = dict(zip(SCHEMES, ("black", _ORANGE), strict=True))
_DASHES = {"sequential": "-", "color": "--"}
_LEAST_OVERLAP = 1e-13  # m; smaller values are rounding errors
_BELOW: dict[str, Any] = {"loc": "outside lower center", "ncols": 3, "fontsize": "small", "frameon": False}
_MARKER = {16: "o", 160: "s", 1600: "^"}


def draw_steps(rows: Sequence[StepRow]) -> Figure:
    """Draw the error of steps of a scene over iterations and wall time, one column of axes for each step."""
    moments = list(dict.fromkeys(row.moment for row in rows))
    figure = Figure(figsize=(1.0 + 3.2 * len(moments), 6.2), layout="constrained")
    grid = figure.subplots(2, len(moments), squeeze=False, sharey="col")
    for (over_iterations, over_time), moment in zip(grid.T, moments, strict=True):
        here = [row for row in rows if row.moment == moment]
        first = here[0]
        title = f"{moment}: t = {first.time:.4g} s, {first.contacts} contacts"
        over_iterations.set_title(title, fontsize="medium")
        for configuration in dict.fromkeys(row.configuration for row in here):
            curve = [row for row in here if row.configuration == configuration]
            errors = [row.error for row in curve]
            _, method, _, threads = configuration
            if configuration.code == "warpgrains" and threads == 1 and method in SWEEPING:
                over_iterations.plot([row.iterations for row in curve], errors, **_style(configuration))
            over_time.plot([1e3 * row.wall_time for row in curve], errors, **_style(configuration))
        over_iterations.set_xlabel("iterations")
        over_time.set_xlabel("wall time of the step [ms]")
        for axes in (over_iterations, over_time):
            axes.axhline(first.error_of_exact, color=_GREY, linewidth=1.0, linestyle=":")
            _make_logarithmic(axes)
    for axes in grid[:, 0]:
        axes.set_ylabel("error of the velocities [m/s]")
    handles, labels = grid[1, 0].get_legend_handles_labels()
    handles.append(grid[1, 0].lines[-1])
    labels.append("the exact solution's own error")
    figure.suptitle(f"{rows[0].scene}: one step of {rows[0].grains} grains", fontsize="large")
    figure.legend(handles, labels, **_BELOW)
    return figure


def _style(configuration: Configuration) -> dict[str, Any]:
    """Return the line style: color by method, dashes by order, markers by number of threads."""
    code, method, order, threads = configuration
    if code != "warpgrains":
        return {"color": "black", "linewidth": 1.2, "marker": "x", "markersize": 4, "label": code}
    two = threads > 1
    return {
        "color": _COLOR[method],
        "linestyle": _DASHES[order],
        "linewidth": 0.8 if two else 1.5,
        "marker": "o" if two else None,
        "markersize": 3,
        "markerfacecolor": "white",
        "label": f"{method}, {order}, {threads} thread{'s' * two}",
    }


def draw_paths(paths: Sequence[PathRow], frontier: Sequence[FrontierRow]) -> Figure:
    """Draw the error of trajectories of a scene over dt and CPU time, and the overlap after equal work.

    `frontier` holds the runs of equal work.
    """
    figure = Figure(figsize=(13.5, 5.0), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    _draw_error(left, paths, "dt")
    left.set_title(f"trajectories over {paths[0].horizon:.3g} s from the first contact", fontsize="medium")
    _draw_error(middle, paths, "cpu_time")
    middle.set_title("the same over what it costs", fontsize="medium")
    _draw_overlap(right, frontier)
    figure.suptitle(f"{paths[0].scene}: iterations, or shorter steps", fontsize="large")
    handles, labels = right.get_legend_handles_labels()
    title = "right: iterations spent in one of the scene's own steps"
    figure.legend(handles, labels, title=title, title_fontsize="small", **_BELOW)
    return figure


def _draw_error(axes: Axes, rows: Sequence[PathRow], over: str) -> None:
    """Draw the error of trajectories over the attribute `over` of the rows: "dt" or "cpu_time".

    Over dt, the legend gives the fitted orders.
    """
    for scheme, color in _SCHEME_COLOR.items():
        here = [row for row in rows if row.scheme == scheme]
        order = fitted_order(here) if over == "dt" else None
        label = scheme if order is None else f"{scheme}: order {order:.2f}"
        x, error = [getattr(row, over) for row in here], [row.error for row in here]
        axes.plot(x, error, color=color, marker="o", markersize=4, label=label)
    if over == "dt":
        own = rows[0].finest_error
        axes.axhline(
            own, color=_GREY, linestyle=":", linewidth=1.0, label="the finest trajectory's own error"
        )
    axes.set(xlabel="dt [s]" if over == "dt" else "CPU time [s]", ylabel="error of the positions [m]")
    _make_logarithmic(axes)
    axes.legend(fontsize="small", frameon=False)


def _draw_overlap(axes: Axes, rows: Sequence[FrontierRow]) -> None:
    """Draw the worst overlap over dt, with a curve for each method and each `cost` of `FrontierRow`."""
    for method in SWEEPING:
        for cost in COSTS:
            here = [row for row in rows if (row.method, row.cost) == (method, cost)]
            dt, left = [row.dt for row in here], [row.overlap for row in here]
            (line,) = axes.plot(dt, left, color=_COLOR[method], linewidth=1.2, marker=_MARKER[cost])
            line.set(markersize=4, label=f"{method}, {cost} iterations")
    best = [row for row in rows if (row.method, row.cost) == ("accelerated", COSTS[-1])]
    floor = [row.wall_floor for row in best]
    if any(floor):
        axes.plot([row.dt for row in best], floor, color=_GREY, linestyle="--", label="(v dt)² / (2 R_out)")
    axes.set_title(f"equal work, over {rows[0].horizon:.3g} s from the hardest step", fontsize="medium")
    axes.set(xlabel="dt [s]", ylabel="overlap left [m]")
    _make_logarithmic(axes)
    axes.set_ylim(bottom=max(axes.get_ylim()[0], _LEAST_OVERLAP))


def _make_logarithmic(axes: Axes) -> None:
    """Make axes logarithmic, with a light grid and few labels."""
    axes.set(xscale="log", yscale="log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(numticks=8))
        low, high = axis.get_view_interval()
        if high > 10.0 * low:
            axis.set_minor_formatter(NullFormatter())
    axes.grid(color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
