"""Runs on an existing dask cluster.

dask schedules and restarts workers; this module groups runs into bundles. The folder of the sweep must be
shared by all machines, because workers write the same files as a local process. If a worker dies, another one
continues its bundle from the checkpoints, without the finished runs.
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

from warpgrains.base.console import exit_on_interrupt
from warpgrains.base.errors import InputError, requiring
from warpgrains.base.warp_start import start_warp
from warpgrains.sweep.execution import ExecutionOptions, OnFraction, next_size
from warpgrains.sweep.sweep import Run
from warpgrains.sweep.sweep_folder import SweepFolder

if TYPE_CHECKING:
    from distributed import Client, Future

FIRST_BUNDLE, MOST_IN_A_BUNDLE = 16, 16_384  # runs
BUNDLE = 10.0  # least intended duration of a bundle [s]
SECONDS_PER_THREAD = 0.05  # the same, per thread: the scheduler takes about 10 ms per bundle
BUNDLES_PER_THREAD = 2  # submitted bundles per thread
FEWEST_THREADS = 16  # least number assumed, because workers connect one by one
CONNECT_WITHIN = 30.0  # s
NO_RESULT = "its result cannot be read here: all machines must share DIR"

_one_at_a_time = Lock()


def finish_on_cluster(
    folder: SweepFolder,
    runs: list[Run],
    execution: ExecutionOptions,
    on_progress: OnFraction,
    client: Client,
) -> dict[int, str]:
    """Finish runs on a cluster, as `finish_runs` does in one process.

    Return why runs remain unfinished, by number of the run. Runs that a bundle leaves unfinished are tried
    again one by one, because dask gives up a bundle if too many of its workers die.
    """
    reasons: dict[int, str] = {}
    for run in _run_bundles(client, folder, runs, execution, on_progress):
        future = client.submit(finish_bundle, folder, [run], execution, pure=False)
        reason = future.exception() or future.result()[0].get(run.number, NO_RESULT)
        if not folder.finished([run]):
            reasons[run.number] = str(reason)
            print(f"run {run.number} is not finished: {reason}", file=sys.stderr)
        else:
            on_progress(1.0)
    return reasons


def _run_bundles(
    client: Client,
    folder: SweepFolder,
    runs: list[Run],
    execution: ExecutionOptions,
    on_progress: OnFraction,
) -> list[Run]:
    """Execute runs in bundles, which are tasks of the cluster; return the unfinished runs.

    The size of the next bundles follows from the time that the last one took.
    """
    from distributed import as_completed

    waiting, size = deque(runs), FIRST_BUNDLE
    left: list[Run] = []
    submitted: dict[Future, list[Run]] = {}
    completed = as_completed()
    while True:
        threads = max(FEWEST_THREADS, sum(client.nthreads().values()))
        while waiting and len(submitted) < BUNDLES_PER_THREAD * threads:
            most = max(1, len(waiting) // (BUNDLES_PER_THREAD * threads))
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
            wanted = max(BUNDLE, SECONDS_PER_THREAD * threads)
            size = next_size(len(bundle), future.result()[1], wanted, MOST_IN_A_BUNDLE)


def finish_bundle(
    folder: SweepFolder, runs: list[Run], execution: ExecutionOptions
) -> tuple[dict[int, str], float]:
    """On a worker, finish those of `runs` that have no result.

    Return why runs remain unfinished, by number of the run, and the time that the bundle took [s].
    """
    from distributed import get_worker

    with _one_at_a_time:
        start = perf_counter()
        start_warp()
        from warpgrains.sweep.runner import finish_runs

        threads = execution.threads or get_worker().state.nthreads
        left = folder.unfinished(runs)
        reasons = finish_runs(folder, left, replace(execution, threads=threads), lambda runs: None)
        return reasons, perf_counter() - start


@contextmanager
def connected(scheduler: str | None, slurm_jobs: int | None) -> Iterator[Client]:
    """Yield a client of a dask scheduler, such as "tcp://host:8786", or of `slurm_jobs` new Slurm jobs.

    InputError if dask is not installed, or the cluster cannot be reached.
    """
    with requiring("a cluster", "cluster"):
        from distributed import Client

        if slurm_jobs is not None:
            with exit_on_interrupt():  # dask_jobqueue sets a handler that exits with code 0
                from dask_jobqueue import SLURMCluster
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
