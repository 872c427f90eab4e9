"""The words and tables of a report: report.md."""

import os
import platform
from collections.abc import Sequence

import numpy as np

from warpgrains import __version__
from warpgrains.reference.reference import find_c_reference
from warpgrains.report.rows import Budget, Findings, FrontierRow, PathRow, StepRow, fitted_order
from warpgrains.scene.scene import METHODS

RELATIVE = {"1e-3": 1e-3, "1e-6": 1e-6}  # errors that the table asks for, of that of the free velocities

_HEAD = """# Speed against error

warpgrains {version}, {machine}, {cores} cores. Wall times are medians of {repeats}; a step that takes more
than {longest} s is timed once, and no more iterations are tried. C reference: {reference}.

The error of a step is the largest difference of a velocity component from the exact solution of the step's
convex problem, found by clarabel. A step is solved with 1, 3, 10, 30, ... iterations; the tables give the
first of these whose error is below a thousandth and a millionth of that of the free velocities (of a step
without contacts), and the wall time of the step. The rows are in steps.csv, trajectories.csv and
frontier.csv, all in m, s and m/s.
"""


def markdown(found: Findings, budget: Budget) -> str:
    """Return the report."""
    head = _HEAD.format(
        version=__version__,
        machine=platform.machine(),
        cores=os.cpu_count(),
        repeats=budget.repeats,
        longest=budget.longest,
        reference=find_c_reference().status,
    )
    sections = [head]
    for scene in dict.fromkeys(row.scene for row in found.steps):
        own = found.of(scene)
        sections += [
            f"## {scene}\n",
            f"![Error of one step against iterations and wall time]({scene}-steps.png)\n",
            _step_table(own.steps) + "\n",
            f"![Error against dt, and overlap left by equal work]({scene}-dt.png)\n",
            _path_text(own.paths) + "\n",
            _frontier_table(own.frontier) + "\n",
        ]
    return "\n".join(sections)


def _step_table(rows: Sequence[StepRow]) -> str:
    """Return a table with a line a configuration, and for each moment the iterations and time it needs."""
    moments = list(dict.fromkeys(row.moment for row in rows))
    columns = [f"{moment}, to {name}" for moment in moments for name in RELATIVE]
    lines = [["code", "method", "order", "threads", *columns]]
    for configuration in dict.fromkeys(row.configuration for row in rows):
        cells = [str(part) for part in configuration]
        for moment in moments:
            measured = [row for row in rows if (row.configuration, row.moment) == (configuration, moment)]
            cells += [_first_below(measured, relative) for relative in RELATIVE.values()]
        lines.append(cells)
    return table(lines)


def _first_below(measured: Sequence[StepRow], relative: float) -> str:
    """Return iterations and time of the first step whose error is small enough, or how far it came."""
    for row in measured:
        if row.error <= relative * row.error_of_nothing:
            return f"{row.iterations}: {1e3 * row.wall_time:.3g} ms"
    last = measured[-1]
    return f"{last.error / last.error_of_nothing:.0e} after {last.iterations}"


def _path_text(paths: Sequence[PathRow]) -> str:
    order = fitted_order(list(paths))
    fit = "no error to fit an order to" if order is None else f"error of order {order:.2f} in dt"
    return (
        f"Trajectories over {paths[0].horizon:.3g} s from the first contact (four of the scene's own steps,"
        f" and on while two of fine steps stay within 1 % of the smallest radius of each other): {fit}."
    )


def _frontier_table(rows: Sequence[FrontierRow]) -> str:
    """Return a table with a line a cost, and for each method the steps that leave least overlap."""
    head = "iterations in one of the scene's own steps"
    lines = [[head, *(f"least overlap, {method}" for method in METHODS)]]
    for cost in dict.fromkeys(row.cost for row in rows):
        cells = [str(cost)]
        for method in METHODS:
            runs = [row for row in rows if (row.cost, row.method) == (cost, method)]
            left = [row for row in runs if np.isfinite(row.overlap)]
            best = min(left, key=lambda row: row.overlap, default=None)
            cells.append(
                "none: a grain was lost"
                if best is None
                else f"{best.overlap:.1e} m: {best.iterations} in a step of {best.dt:.3g} s"
            )
        lines.append(cells)
    return table(lines)


def table(lines: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table, its head first."""
    rule = ["---"] * len(lines[0])
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (lines[0], rule, *lines[1:]))
