"""Runs on an existing dask cluster: it schedules, watches and restarts; here runs are put in chunks.

All machines must see the folder of the sweep: workers write there what a local process would. A chunk whose
worker died is done again by another one, from the checkpoints, without the runs that are finished.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

from warpgrains.errors import SceneError, SimulationError
from warpgrains.run_folder import RunFolder
from warpgrains.waves import Means, Tell

if TYPE_CHECKING:
    from distributed import Client, Future

CHUNKS_A_THREAD = 16
MOST_IN_A_CHUNK = 64
CONNECT_WITHIN = 30.0  # s

_one_chunk_a_process = Lock()


def finish_on_cluster(
    folders: list[RunFolder], means: Means, tell: Tell, scheduler: str | None, slurm_jobs: int | None
) -> None:
    """Carry runs out to their end on a cluster.

    Parameters
    ----------
    folders
        The runs, none of them finished.
    means
        With what; without `threads`, a chunk takes as many as its worker has.
    tell
        Is called when a chunk is finished.
    scheduler
        Address of a dask scheduler, such as "tcp://host:8786"; or
    slurm_jobs
        how many jobs Slurm is to start, each as dask-jobqueue is configured.

    Raises
    ------
    SceneError
        Dask is not installed, or there is no such cluster.
    SimulationError
        Chunks were given up, since their workers died again and again; or the workers write elsewhere.
    """
    with _client(scheduler, slurm_jobs) as client:
        from distributed import as_completed

        chunks = _chunks(folders, sum(client.nthreads().values()) or slurm_jobs or 1)
        futures = client.map(_finish_chunk, chunks, [means] * len(chunks), pure=False)
        lost: list[str] = []
        for future in as_completed(futures):
            tell(len(chunks[futures.index(future)]))
    ...
