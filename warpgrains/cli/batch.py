"""`warpgrains batch`: execute the unfinished runs of a sweep, and print a summary."""

from __future__ import annotations

import gc
from argparse import Namespace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from warpgrains.base import checks
from warpgrains.base.console import in_columns, progress_bar, stdout_to_stderr
from warpgrains.base.errors import InputError, OutputError, requiring
from warpgrains.base.shown import number_of
from warpgrains.base.warp_start import find_device
from warpgrains.drawing.looks import DEFAULT_RATE
from warpgrains.simulation.until import bounds_of
from warpgrains.space.region import RANGES, table_of
from warpgrains.sweep.execution import ExecutionOptions, OnFraction, RunSettings
from warpgrains.sweep.results import MET
from warpgrains.sweep.sweep import Run, Sweep
from warpgrains.sweep.sweep_folder import AREA, RESULTS, UNCONVERGED, SweepFolder

if TYPE_CHECKING:
    from warpgrains.sweep.plot import SweepPlot


_BAR = "{percentage:3.0f}%|{bar}| {n:.1f}/{total} runs [{elapsed}, {remaining} left, {rate_fmt}]"


def run(arguments: Namespace) -> bool:
    """Execute the unfinished runs of a sweep; return whether some run has failed or is unfinished.

    Without a sweep, draw existing results with `--plot`.
    """
    path, plot = Path(arguments.output), _plot(arguments)
    results = path / RESULTS
    if arguments.sweep is None:
        if plot is None:
            raise InputError("SWEEP is missing: give a sweep, or --plot to draw existing results")
        if not results.is_file():
            told = f"`warpgrains batch SWEEP -o {path}` makes them"
            raise InputError(f"'{path}' holds no results: {told}")
        print(plot.draw(results))
        return False
    sweep = Sweep.load(arguments.sweep)
    gc.freeze()  # no run becomes garbage, and repeated scans of a million runs would take long
    settings, execution = _settings(arguments), _execution(arguments)
    folder = SweepFolder(path.absolute(), sweep.axes, settings)
    if plot is not None:
        plot.require_columns(folder.columns)
    share = _share(sweep, arguments)
    start = perf_counter()
    folder.create_or_check(sweep, share, arguments.resume)
    left = folder.unfinished(share)
    try:
        with (
            stdout_to_stderr(),
            progress_bar(len(share), len(share) - len(left), unit="run", bar_format=_BAR) as bar,
        ):
            reasons = _finish(folder, sweep, left, execution, bar.update, arguments)
    except OutputError:
        raise  # writes no tables, because tables in the folder are of another sweep
    except BaseException as error:
        folder.write_tables(sweep)
        if isinstance(error, KeyboardInterrupt):
            raise KeyboardInterrupt("to continue: the same command with --resume") from None
        raise
    cells = folder.write_tables(sweep)
    seconds, numbers = perf_counter() - start, list(map(int, cells["run"]))
    finished, own = set(numbers), {run.number for run in share}
    missing = {number: reasons.get(number, "") for number in sorted(own - finished)}
    kept = [k for k, number in enumerate(numbers) if number in own]
    failed = {numbers[k]: cells["error"][k] for k in kept if cells["error"][k]}

    good = [k for k in kept if not cells["error"][k]]
    unconverged = sum(cells[UNCONVERGED][k] != "0" for k in good)
    without = sum(cells[AREA][k] == "nan" for k in good)
    unmet = sum(cells[MET][k] == "0" for k in good) if MET in cells else None
    done = finished.intersection(run.number for run in left)
    rows = {
        "runs": f"{len(share)}, {len(share) - len(left)} of them finished before",
        "failed": f"{len(failed)}{_first(failed)}",
        "not finished": f"{len(missing)}{' (continue with --resume)' if missing else ''}{_first(missing)}",
        "not converged": f"{number_of(unconverged, 'run')}, in one step or more",
        **({} if unmet is None else {"not at rest": number_of(unmet, "run")}),
        "time": f"{seconds:.2f} s, {len(done) / seconds:.2f} runs/s",
        **({"results": str(results)} if finished else {}),
        **({"no area": f"{number_of(without, 'run')}: {AREA} is nan"} if without else {}),
    }
    print(in_columns(rows))
    if plot is not None:
        has_succeeded = "" in cells["error"]
        print(in_columns({"picture": plot.draw(results) if has_succeeded else "none: no run has succeeded"}))
    return bool(failed or missing)


def _plot(arguments: Namespace) -> SweepPlot | None:
    """Return the requested plot, if any. An invalid plot raises InputError here, before hours of runs."""
    if arguments.plot is None:
        return None
    with requiring("--plot"):
        from warpgrains.sweep.plot import SweepPlot
    return SweepPlot.parse(arguments.plot)


def _settings(arguments: Namespace) -> RunSettings:
    """Return the settings of all runs. Raises InputError if a quantity or the end criterion is invalid."""
    if arguments.every is not None:
        checks.whole_number("--every", arguments.every)
        if arguments.measure is None:
            raise InputError("--every needs --measure")
    if arguments.mean and arguments.every is None:
        raise InputError("--mean needs --every")
    if arguments.after is not None:
        if arguments.every is None:
            raise InputError("--after needs --every")
        checks.not_negative("--after", arguments.after)
    measured: tuple[str, ...] = ()
    if arguments.measure is not None:
        from warpgrains.analysis.quantities import names_of

        measured = names_of(arguments.measure)
    if arguments.until is not None:
        bounds_of(arguments.until)
    if arguments.region is not None:
        from warpgrains.analysis.quantities import require_effect
        from warpgrains.analysis.region_table import KEYS

        if arguments.measure is None:
            raise InputError("--region needs --measure")
        require_effect(arguments.region, measured)
        for key, value in table_of("--region", arguments.region).items():
            checks.one_of("key of --region", key, KEYS)
            if key in RANGES:
                checks.interval(f"--region: {key}", value)
    if arguments.fps is not None and not arguments.usd:
        raise InputError("--fps needs --usd")
    fps = DEFAULT_RATE if arguments.fps is None else checks.positive("--fps", arguments.fps)
    outputs = fps if arguments.usd else None, arguments.every, arguments.mean, arguments.after
    return RunSettings(measured, arguments.until, arguments.region, *outputs)


def _share(sweep: Sweep, arguments: Namespace) -> list[Run]:
    """Return the runs of this process: all or, with `--count`, every `--count`-th run from `--index` on."""
    index, count = arguments.index, arguments.count
    if (index is None) != (count is None):
        raise InputError("--index and --count must be given together")
    if count is None:
        return sweep.runs
    count = checks.whole_number("--count", count)
    return sweep.runs[checks.whole_number("--index", index, least=0, most=count - 1) :: count]


def _finish(
    folder: SweepFolder,
    sweep: Sweep,
    left: list[Run],
    execution: ExecutionOptions,
    on_progress: OnFraction,
    arguments: Namespace,
) -> dict[int, str]:
    """Finish the runs `left`, in this process or on a cluster.

    Returns the reasons why runs remain unfinished, by the number of the run. Common files are written only
    after the device or the cluster has been found.
    """
    if not left:
        folder.write_common_files(sweep)
        return {}
    if arguments.scheduler is None and arguments.slurm is None:
        find_device(execution.device)  # starts Warp, which `runner` imports
        from warpgrains.sweep.runner import finish_runs

        folder.write_common_files(sweep)
        return finish_runs(folder, left, execution, on_progress)
    from warpgrains.sweep.cluster import connected, finish_on_cluster

    with connected(arguments.scheduler, arguments.slurm) as client:
        folder.write_common_files(sweep)
        return finish_on_cluster(folder, left, execution, on_progress, client)


def _execution(arguments: Namespace) -> ExecutionOptions:
    if arguments.threads is not None:
        checks.thread_count("--threads", arguments.threads)
    if arguments.slurm is not None:
        checks.whole_number("--slurm", arguments.slurm)
    has_outputs = arguments.folders or arguments.usd or arguments.every is not None
    return ExecutionOptions(arguments.device, arguments.threads, has_outputs or arguments.device != "cpu")


def _first(reasons: dict[int, str]) -> str:
    return next((f", first run {number}: {reason}" for number, reason in reasons.items() if reason), "")
