"""`warpgrains report`: measure speed against error, and write tables, figures and a text."""

import os
import platform
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from warpgrains import __version__
from warpgrains.base.console import progress_bar
from warpgrains.base.errors import InputError
from warpgrains.base.files import make_folder, table_text, write_atomically
from warpgrains.base.locks import Lock
from warpgrains.pictures.still import save_figure
from warpgrains.reference.reference import find_c_reference
from warpgrains.report.figures import draw_paths, draw_steps
from warpgrains.report.rows import (
    SCHEMES,
    SWEEPING,
    Budget,
    Findings,
    FrontierRow,
    PathRow,
    StepRow,
    fitted_order,
)
from warpgrains.report.steps import follow_history, measure_steps
from warpgrains.report.trajectories import measure_frontier, measure_paths
from warpgrains.scene.scene import Scene

DOTS_PER_INCH = 80
REPORT = "report.md"
RELATIVE = {"1e-3": 1e-3, "1e-6": 1e-6}  # errors in the table, relative to the free velocities' error

_HEAD = """# Speed against error

warpgrains {version}, {machine}, {cores} cores. Wall times are medians of {repeats}; a step that takes more
than {longest} s is timed once, and no more iterations are tried. C reference: {reference}.

The error of a step is the largest difference of a velocity component from the exact solution of the step's
convex problem, found by clarabel. A step is solved with 1, 3, 10, 30, ... iterations, and by the exact method
to ever smaller residuals, where iterations are sweeps and factorizations. The tables give the first number of
iterations whose error is below 1e-3 and 1e-6 of that of the free velocities (of a step without contacts), and
the wall time of the step. The rows are in steps.csv, trajectories.csv and
frontier.csv, all in m, s and m/s.
"""


def why_not(scene: Scene) -> str:
    """Return the reason why a scene cannot be in a report, as a clause for messages; empty if it can."""
    reasons = {
        "has friction, with which a step has no one exact solution": scene.has_friction,
        "has driven walls, whose exact step is not computed": scene.has_driven_walls,
        "has sources or sinks, which the reference does not know": scene.exchanges_grains,
        "has restitution, with which trajectories part": scene.has_restitution,
    }
    return next((reason for reason, holds in reasons.items() if holds), "")


def write_report(scenes: Sequence[Scene], folder: Path, progress: bool = False) -> list[Path]:
    """Measure speed against error of scenes, write a report, and return its files, report.md first.

    The files are written after each scene. An interrupted report therefore covers the scenes that were
    complete.
    """
    name, count = Counter(scene.name for scene in scenes).most_common(1)[0]
    if count > 1:
        raise InputError(
            f"two scenes have the name '{name}': rename one, because a report identifies scenes by their"
            " names"
        )
    for scene in scenes:
        if reason := why_not(scene):
            raise InputError(f"scene '{scene.name}' {reason}: leave it out of the report")
    make_folder(folder)
    budget, found = Budget(), Findings()
    pictures: list[Path] = []
    with (
        Lock(folder / REPORT),
        progress_bar(len(scenes), shown=progress, unit="scene") as bar,
    ):
        for scene in scenes:
            for stage in _measure(scene, budget, found):
                bar.set_postfix_str(f"{scene.name}: {stage}")
            own = found.of(scene.name)
            drawn = {"steps": draw_steps(own.steps), "dt": draw_paths(own.paths, own.frontier)}
            for what, figure in drawn.items():
                pictures.append(folder / f"{scene.name}-{what}.png")
                save_figure(figure, pictures[-1], dpi=DOTS_PER_INCH, pil_kwargs={"optimize": True})
            texts = _write_texts(folder, found, budget)
            bar.update()
    return texts + pictures


def _measure(scene: Scene, budget: Budget, found: Findings) -> Iterator[str]:
    """Measure a scene and add the rows to `found`; yield the name of each measurement, for progress."""
    yield "history"
    history = follow_history(scene, budget.history)
    for snapshot in history.snapshots:
        for step in measure_steps(scene, snapshot, budget):
            found.steps.append(step)
            yield f"{snapshot.name}, {step.method}, {step.order}, {step.iterations} iterations"
    for path in measure_paths(scene, history.first, budget.horizon):
        found.paths.append(path)
        yield f"trajectory, {path.scheme}, dt {path.dt:.3g} s"
    for run in measure_frontier(scene, history.hardest, budget.horizon):
        found.frontier.append(run)
        yield f"equal work, {run.method}, dt {run.dt:.3g} s"


def _write_texts(folder: Path, found: Findings, budget: Budget) -> list[Path]:
    """Write the text and the tables of all rows so far; return their files."""
    tables: dict[str, Sequence[Any]] = {
        "steps": found.steps,
        "trajectories": found.paths,
        "frontier": found.frontier,
    }
    texts = {REPORT: markdown(found, budget)}
    texts |= {f"{name}.csv": table_text([*map(asdict, rows)]) for name, rows in tables.items()}
    for name, text in texts.items():
        write_atomically(folder / name, text.encode())
    return [folder / name for name in texts]


def markdown(found: Findings, budget: Budget) -> str:
    """Return the text of the report."""
    where = {"version": __version__, "machine": platform.machine(), "cores": os.cpu_count()}
    sections = [_HEAD.format(**where, **vars(budget), reference=find_c_reference().status)]
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
    """Return a table of iterations and wall times, a row for each configuration.

    It has a column for each step and each error of `RELATIVE`.
    """
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
    """Return the cell of the table for solutions of a step, in the order of their iterations.

    It gives iterations and time of the first solution whose error is at most `relative` times that of the
    free velocities. If there is none, it gives the ratio of these errors for the last solution.
    """
    for row in measured:
        if row.error <= relative * row.error_of_nothing:
            return f"{row.iterations}: {1e3 * row.wall_time:.3g} ms"
    last = measured[-1]
    return f"{last.error / last.error_of_nothing:.0e} after {last.iterations}"


def _path_text(paths: Sequence[PathRow]) -> str:
    """Return sentences on the duration of trajectories and the fitted orders of their errors."""
    fits = []
    for scheme in SCHEMES:
        here = [path for path in paths if path.scheme == scheme]
        order, shortest = fitted_order(here), here[-1]
        fit = "no error to fit an order to" if order is None else f"error of order {order:.2f} in dt"
        fits.append(f"{scheme}: {fit}, {shortest.error:.1e} m at dt {shortest.dt:.2g} s")
    return (
        f"Trajectories cover {paths[0].horizon:.3g} s from the first contact: four steps of the scene, and"
        " more while two trajectories with fine steps differ by less than 1 % of the smallest radius."
        f" {'; '.join(fits)}."
    )


def _frontier_table(rows: Sequence[FrontierRow]) -> str:
    """Return a table that shows, for each cost and method, the run (time step) with the least overlap."""
    head = "iterations in one of the scene's own steps"
    lines = [[head, *(f"least overlap, {method}" for method in SWEEPING)]]
    for cost in dict.fromkeys(row.cost for row in rows):
        cells = [str(cost)]
        for method in SWEEPING:
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
    """Return a Markdown table whose first line is the head."""
    rule = ["---"] * len(lines[0])
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (lines[0], rule, *lines[1:]))
