"""Runs on an existing dask cluster: dask schedules, watches and restarts; here runs are only put in bundles.

All machines must see the folder of the sweep: workers write there what a local process would. A bundle whose
worker died is done by another one, from the checkpoints, without the runs that are finished.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from threading import Lock
from typing import TYPE_CHECKING

from warpgrains.console import interrupts_end_at_once, start_warp
from warpgrains.errors import SceneError, missing_extra
from warpgrains.simulation.options import ExecutionOptions, OnProgress
from warpgrains.sweep.folder import RunFolder

if TYPE_CHECKING:
    from distributed import Client

BUNDLES_A_THREAD = 16
MOST_IN_A_BUNDLE = 64
CONNECT_WITHIN = 30.0  # s
UNSEEN = "its result is not seen here: all machines must see DIR"

_one_at_a_time = Lock()


def finish_on_cluster(
    folders: list[RunFolder],
    execution: ExecutionOptions,
    on_progress: OnProgress,
    scheduler: str | None,
    slurm_jobs: int | None,
) -> dict[str, str]:
    """Carry runs out to their end on a cluster; return why some are not, by their numbers.

    What dask gives up, since too many workers died of it, is done again in the end, a run at a time. A run
    that is given up alone is left as it is, and standard error says so.

    Parameters
    ----------
    folders, execution, on_progress
        As for `finish_runs`; without `threads`, a worker uses as many as it has.
    scheduler
        Address of a dask scheduler, such as "tcp://host:8786"; or
    slurm_jobs
        how many jobs Slurm is to start, each as dask-jobqueue is configured.

    Raises
    ------
    SceneError
        Dask is not installed, or there is no such cluster.
    """
    left: dict[str, str] = {}
    with _client(scheduler, slurm_jobs) as client:
        threads = sum(client.nthreads().values()) or slurm_jobs or 1
        for run in _left_by_bundles(client, _bundles(folders, threads), execution, on_progress):
            future = client.submit(finish_bundle, [run], execution, pure=False)
            number = run.labels["run"]
            reason = future.exception() or future.result().get(number, UNSEEN)
            if run.is_finished:
                on_progress(1.0)
            else:
                left[number] = str(reason)
                print(f"run {number} is not finished: {reason}", file=sys.stderr)
    return left


def _left_by_bundles(
    client: Client, bundles: Iterable[list[RunFolder]], execution: ExecutionOptions, on_progress: OnProgress
) -> list[RunFolder]:
    """Have bundles carried out; return the runs that are not finished, since their bundle was given up."""
    from distributed import as_completed

    left: list[RunFolder] = []
    given = {client.submit(finish_bundle, bundle, execution, pure=False): bundle for bundle in bundles}
    for future in as_completed(given):
        bundle = given.pop(future)
        lost = [run for run in bundle if not run.is_finished]
        on_progress(len(bundle) - len(lost))
        left += lost
    return left


def finish_bundle(folders: list[RunFolder], execution: ExecutionOptions) -> dict[str, str]:
    """Carry out, on a worker, those runs of a bundle that an earlier worker has not finished.

    Like `finish_runs` it returns why some are not.

    A worker with many threads is given many bundles at once: each in turn has all its threads.
    """
    from distributed import get_worker

    with _one_at_a_time:
        start_warp()
        from warpgrains.sweep.runner import finish_runs

        threads = execution.threads or get_worker().state.nthreads
        left = [folder for folder in folders if not folder.is_finished]
        return finish_runs(left, replace(execution, threads=threads), lambda runs: None)


def _bundles(folders: list[RunFolder], threads: int) -> Iterator[list[RunFolder]]:
    """Split runs in parts, so many that no worker is idle for long at the end."""
    size = min(MOST_IN_A_BUNDLE, max(1, len(folders) // (BUNDLES_A_THREAD * threads)))
    for first in range(0, len(folders), size):
        yield folders[first : first + size]


@contextmanager
def _client(scheduler: str | None, slurm_jobs: int | None) -> Iterator[Client]:
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
            raise SceneError(f"no dask scheduler answers at {scheduler!r}: {error}") from error
        with client:
            yield client
        return
    try:
        cluster = SLURMCluster()
    except ValueError as error:
        reason = str(error).partition("\n")[0]
        raise SceneError(f"--slurm needs dask-jobqueue's configuration, jobqueue.yaml: {reason}") from error
    with cluster, Client(cluster) as client:
        cluster.scale(jobs=slurm_jobs)
        yield client
