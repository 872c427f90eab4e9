"""Runs on an existing dask cluster: dask schedules, watches and restarts; here runs are only put in bundles.

All machines must see the folder of the sweep: workers write there what a local process would. A bundle whose
worker died is done by another one, from the checkpoints, without the runs that are finished.
"""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from threading import Lock
from time import perf_counter
from typing import TYPE_CHECKING

from warpgrains.console import interrupts_end_at_once, start_warp
from warpgrains.errors import InputError, missing_extra
from warpgrains.simulation.options import ExecutionOptions, OnProgress
from warpgrains.sweep.folder import SweepFolder
from warpgrains.sweep.sizes import next_size
from warpgrains.sweep.sweep import Run

if TYPE_CHECKING:
    from distributed import Client, Future

FIRST_BUNDLE, MOST_IN_A_BUNDLE = 16, 16_384  # runs
BUNDLE = 10.0  # s that a bundle is to take ...
HANDLING = 0.05  # ... and for every thread that there is: a scheduler takes some 10 ms for a bundle
AHEAD = 2  # bundles given out a thread
FEWEST_THREADS = 16  # for which there are bundles, as workers come one by one
CONNECT_WITHIN = 30.0  # s
UNSEEN = "its result cannot be read here: all machines must share DIR"

_one_at_a_time = Lock()


def finish_on_cluster(
    folder: SweepFolder,
    runs: list[Run],
    execution: ExecutionOptions,
    on_progress: OnProgress,
    client: Client,
) -> dict[int, str]:
    """Carry runs out to their end on a cluster; return why some are not, by their numbers.

    What dask gives up, since too many workers died of it, is done again in the end, a run at a time. A run
    that is given up alone is left as it is, and standard error says so.

    Parameters
    ----------
    folder, runs, execution, on_progress
        As for `finish_runs`; without `threads`, a worker uses as many as it has.
    client
        Of the cluster, see `connected`.
    """
    left: dict[int, str] = {}
    for run in _left_by_bundles(client, folder, runs, execution, on_progress):
        future = client.submit(finish_bundle, folder, [run], execution, pure=False)
        reason = future.exception() or future.result()[0].get(run.number, UNSEEN)
        if run.number in folder.finished([run]):
            on_progress(1.0)
        else:
            left[run.number] = str(reason)
            print(f"run {run.number} is not finished: {reason}", file=sys.stderr)
    return left


def _left_by_bundles(
    client: Client,
    folder: SweepFolder,
    runs: list[Run],
    execution: ExecutionOptions,
    on_progress: OnProgress,
) -> list[Run]:
    """Have bundles carried out, some at a time; return the runs that they leave unfinished.

    A bundle is as large as the time of the last one allows, and so small that no worker is idle at the end.
    """
    from distributed import as_completed

    waiting, size = deque(runs), FIRST_BUNDLE
    left: list[Run] = []
    submitted: dict[Future, list[Run]] = {}
    completed = as_completed()
    while True:
        threads = max(FEWEST_THREADS, sum(client.nthreads().values()))
        while waiting and len(submitted) < AHEAD * threads:
            most = max(1, len(waiting) // (AHEAD * threads))
            bundle = [waiting.popleft() for _ in range(min(size, most))]
            future = client.submit(finish_bundle, folder, bundle, execution, pure=False)
            submitted[future] = bundle
            completed.add(future)
        if not submitted:
            return left
        future = next(completed)
        bundle = submitted.pop(future)
        finished = folder.finished(bundle)
        on_progress(len(finished))
        left += [run for run in bundle if run.number not in finished]
        if future.status == "finished":
            wanted = max(BUNDLE, HANDLING * threads)
            size = next_size(len(bundle), future.result()[1], wanted, MOST_IN_A_BUNDLE)


def finish_bundle(
    folder: SweepFolder, runs: list[Run], execution: ExecutionOptions
) -> tuple[dict[int, str], float]:
    """Carry out, on a worker, those runs of a bundle that an earlier worker has not finished.

    Returns why some are not, like `finish_runs`, and how long it took [s].

    A worker with many threads is given many bundles at once: each in turn has all its threads.
    """
    from distributed import get_worker

    with _one_at_a_time:
        start = perf_counter()
        start_warp()
        from warpgrains.sweep.runner import finish_runs

        threads = execution.threads or get_worker().state.nthreads
        finished = folder.finished(runs)
        left = [run for run in runs if run.number not in finished]
        reasons = finish_runs(folder, left, replace(execution, threads=threads), lambda runs: None)
        return reasons, perf_counter() - start


@contextmanager
def connected(scheduler: str | None, slurm_jobs: int | None) -> Iterator[Client]:
    """Connect to a cluster until the end of the ``with`` block.

    Parameters
    ----------
    scheduler
        Address of a dask scheduler, such as "tcp://host:8786"; or
    slurm_jobs
        how many jobs Slurm is to start, each as dask-jobqueue is configured.

    Raises
    ------
    InputError
        Dask is not installed, or there is no such cluster.
    """
    try:
        from distributed import Client

        if slurm_jobs is not None:
            with interrupts_end_at_once():  # dask_jobqueue sets a handler that exits as if all were done
                from dask_jobqueue import SLURMCluster
    except ModuleNotFoundError as error:
        raise missing_extra("a cluster", error, "cluster") from error
    if slurm_jobs is None:
        try:
            client = Client(scheduler, timeout=CONNECT_WITHIN)
        except (OSError, ValueError) as error:
            raise InputError(f"no dask scheduler answers at {scheduler!r}: {error}") from error
        with client:
            yield client
        return
    try:
        jobs = SLURMCluster()
    except ValueError as error:
        reason = str(error).partition("\n")[0]
        raise InputError(f"--slurm needs dask-jobqueue's configuration, jobqueue.yaml: {reason}") from error
    with jobs, Client(jobs) as client:
        jobs.scale(jobs=slurm_jobs)
        yield client
