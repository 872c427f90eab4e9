"""`warpgrains batch`: carry out the runs of a sweep, or those that are left, and tell what came of them."""

from __future__ import annotations

import gc
from argparse import Namespace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from warpgrains.console import in_columns, progress_bar, start_warp, stdout_kept_clean
from warpgrains.drawing.frame_times import DEFAULT_RATE
from warpgrains.errors import SceneError, missing_extra
from warpgrains.scene import checks
from warpgrains.simulation.options import ExecutionOptions
from warpgrains.simulation.until import rest_bounds
from warpgrains.sweep.folder import RESULTS, SweepFolder, Tables
from warpgrains.sweep.results import Columns
from warpgrains.sweep.sweep import Run, Sweep

if TYPE_CHECKING:
    from warpgrains.sweep.plot import SweepPlot


_BAR = "{percentage:3.0f}%|{bar}| {n:.1f}/{total} runs [{elapsed}, {remaining} left, {rate_fmt}]"


def run(arguments: Namespace) -> bool:
    """Carry out a sweep, or what is left of it, and draw its results if asked to.

    Returns
    -------
    bool
        Whether some run has failed, or is not finished.
    """
    path, plot = Path(arguments.output), _plot(arguments)
    if arguments.sweep is None:
        if plot is None:
            raise SceneError("SWEEP is missing, or --plot to draw the results that are there")
        print(plot.draw(path / RESULTS))
        return False
    sweep = Sweep.load(arguments.sweep)
    gc.freeze()  # no run becomes garbage, and to look at a million of them again and again takes long
    columns = Columns(sweep.axes, _measured(arguments), _until(arguments))
    folder = SweepFolder(path.absolute(), columns)
    if plot is not None:
        plot.require_columns(columns.all)
    share = _share(sweep, arguments)
    start, left = perf_counter(), folder.unfinished(sweep, share, arguments.resume)
    try:
        with stdout_kept_clean():
            reasons = _finish(folder, sweep, left, len(share), arguments)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("to go on: the same command with --resume") from None
    finally:
        tables = folder.write_tables(sweep)
    print(_lines(path / RESULTS, share, left, tables, reasons, perf_counter() - start))
    if plot is not None:
        print(in_columns({"picture": plot.draw(path / RESULTS)}))
    return any(run.number in tables.failed or run.number not in tables.finished for run in share)


def _plot(arguments: Namespace) -> SweepPlot | None:
    """Return the picture that is asked for, if any; a bad one is refused before hours of runs."""
    if arguments.plot is None:
        return None
    try:
        from warpgrains.sweep.plot import SweepPlot
    except ModuleNotFoundError as error:
        raise missing_extra("--plot", error) from error
    return SweepPlot.parse(arguments.plot)


def _measured(arguments: Namespace) -> tuple[str, ...]:
    """Return which quantities are to be measured."""
    if arguments.every is not None:
        checks.whole_number("--every", arguments.every)
    if arguments.measure is None:
        if arguments.every is not None:
            raise SceneError("--every needs --measure")
        return ()
    from warpgrains.analysis.quantities import names_of

    return names_of(name.strip() for name in arguments.measure.split(","))


def _until(arguments: Namespace) -> str | None:
    """Return what ends each run before its last step; raise SceneError if it is no criterion."""
    if arguments.until is not None:
        rest_bounds(arguments.until)
    until: str | None = arguments.until
    return until


def _share(sweep: Sweep, arguments: Namespace) -> list[Run]:
    """Return the runs of this process: all of them, or every so many."""
    index, count = arguments.index, arguments.count
    if (index is None) != (count is None):
        raise SceneError("--index and --count go together")
    if count is None:
        return sweep.runs
    count = checks.whole_number("--count", count)
    return sweep.runs[checks.whole_number("--index", index, least=0, most=count - 1) :: count]


def _finish(
    folder: SweepFolder, sweep: Sweep, left: list[Run], total: int, arguments: Namespace
) -> dict[str, str]:
    """Finish what is left, here or on a cluster; return why some runs are not finished, by their numbers."""
    execution = _execution(arguments)
    with progress_bar(total, total - len(left), unit="run", bar_format=_BAR) as bar:
        if arguments.scheduler is None and arguments.slurm is None:
            start_warp()
            from warpgrains.solver.tuning import find_device
            from warpgrains.sweep.runner import finish_runs

            find_device(execution.device)
            folder.prepare(sweep)
            return finish_runs(folder, left, execution, bar.update)
        from warpgrains.sweep.cluster import connected, finish_on_cluster

        with connected(arguments.scheduler, arguments.slurm) as client:
            folder.prepare(sweep)
            return finish_on_cluster(folder, left, execution, bar.update, client)


def _execution(arguments: Namespace) -> ExecutionOptions:
    """Return with what the runs are carried out."""
    if arguments.threads is not None:
        checks.thread_count("--threads", arguments.threads)
    if arguments.slurm is not None:
        checks.whole_number("--slurm", arguments.slurm)
    if arguments.fps is not None and not arguments.usd:
        raise SceneError("--fps needs --usd")
    fps = DEFAULT_RATE if arguments.fps is None else checks.positive("--fps", arguments.fps)
    fps_or_none = fps if arguments.usd else None
    return ExecutionOptions(
        device=arguments.device,
        threads=arguments.threads,
        fps=fps_or_none,
        folders=arguments.folders,
        measure_every=arguments.every,
    )


def _lines(
    results: Path,
    share: list[Run],
    left: list[Run],
    tables: Tables,
    reasons: dict[str, str],
    seconds: float,
) -> str:
    failed = {run.number: tables.failed[run.number] for run in share if run.number in tables.failed}
    missing = {
        run.number: reasons.get(str(run.number), "") for run in share if run.number not in tables.finished
    }
    rows = {
        "runs": f"{len(share)}, {len(share) - len(left)} of them finished before",
        "failed": f"{len(failed)}{_first(failed)}",
        "not finished": f"{len(missing)}{' (--resume goes on)' if missing else ''}{_first(missing)}",
        "not converged": f"some step of {sum(run.number in tables.unconverged for run in share)} runs",
    }
    if tables.unmet is not None:
        rows["not at rest"] = f"{sum(run.number in tables.unmet for run in share)} runs"
    rows |= {
        "time": f"{seconds:.2f} s, {len(left) / seconds:.2f} runs/s",
        "results": f"{results}",
    }
    return in_columns(rows)


def _first(reasons: dict[int, str]) -> str:
    """Name the first of some runs, and its reason."""
    return next((f", first run {number}: {reason}" for number, reason in reasons.items() if reason), "")
