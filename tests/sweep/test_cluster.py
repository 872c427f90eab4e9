"""Sweeps on a real dask cluster of worker processes: the results of one process, whatever dies on the way."""

import os
import signal
import stat
import subprocess
import sys
import threading
import time

import pytest
from distributed import LocalCluster
from sweeps import LONG, SMALL, batch, parts, results, rows, write

from warpgrains.sweep import cluster


@pytest.fixture(scope="module")
def workers():
    """Two worker processes of one thread each; dask starts another when one dies."""
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as workers:
        yield workers


def test_same_results_as_here_though_a_worker_is_killed(tmp_path, workers, capfd):
    """Also when failures are repeated and give the same again."""
    sweep, out = (
        write(tmp_path, LONG.replace("count = 3", "count = 6").replace("0.9", "40.0")),
        tmp_path / "there",
    )
    there = ("-o", out, "--scheduler", workers.scheduler_address)
    killed = []

    def kill_a_worker():
        while len(parts(out)) < 3:
            time.sleep(0.01)
        killed.append(next(iter(workers.workers.values())).pid)
        os.kill(killed[0], signal.SIGKILL)

    killer = threading.Thread(target=kill_a_worker, daemon=True)
    killer.start()
    assert batch(sweep, *there) == 1
    killer.join(timeout=0.0)
    assert killed
    assert batch(sweep, "-o", tmp_path / "here") == 1
    assert results(out) == results(tmp_path / "here")
    assert batch(sweep, *there, "--resume") == 1
    assert "is not finished" not in capfd.readouterr().err
    assert results(out) == results(tmp_path / "here")


@pytest.mark.slow
def test_run_that_kills_its_workers_is_named(tmp_path, workers, monkeypatch, capfd):
    """The runs beside it in its bundle are finished; it is left for --resume."""
    sweep, out = write(tmp_path, SMALL.replace("100.0, ", "")), tmp_path / "there"
    with monkeypatch.context() as patch:
        patch.setattr(cluster, "FEWEST_THREADS", 1)
        patch.setattr(cluster, "finish_bundle", finish_bundle_or_die)
        workers.scheduler.allowed_failures = 0
        assert batch(sweep, "-o", out, "--scheduler", workers.scheduler_address) == 1
    workers.scheduler.allowed_failures = 3
    printed = capfd.readouterr()
    assert "run 2 is not finished: Attempted to run task" in printed.err
    assert "not finished      1 (continue with --resume)" in printed.out
    assert [row["run"] for row in rows(out)] == ["0", "1", "3"]
    assert batch(sweep, "-o", out, "--resume", "--scheduler", workers.scheduler_address) == 0
    assert [row["run"] for row in rows(out)] == ["0", "1", "2", "3"]


def finish_bundle_or_die(folder, runs, execution):
    """Do what the real one does, unless run 2 is among the runs."""
    if any(run.number == 2 for run in runs):
        os.kill(os.getpid(), signal.SIGKILL)
    return FINISH_BUNDLE(folder, runs, execution)


FINISH_BUNDLE = cluster.finish_bundle

SBATCH = f"""#!{sys.executable}
import os, shutil, subprocess, sys
shutil.copy(sys.argv[-1], "job.sh")
job = subprocess.Popen(["bash", "job.sh"], stdout=open("job.log", "wb"), stderr=subprocess.STDOUT)
print("Submitted batch job", job.pid)
"""
SCANCEL = f"""#!{sys.executable}
import os, signal, sys
os.kill(int(sys.argv[-1]), signal.SIGTERM)
"""


@pytest.mark.slow
def test_slurm(tmp_path):
    """With programs that stand for Slurm's: the job script that dask-jobqueue submits is run as it is."""
    for name, script in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        (tmp_path / name).write_text(script)
        (tmp_path / name).chmod(stat.S_IRWXU)
    settings = {"CORES": "1", "MEMORY": "4GB", "INTERFACE": "lo"}
    environment = os.environ | {f"DASK_JOBQUEUE__SLURM__{name}": value for name, value in settings.items()}
    environment["PATH"] = f"{tmp_path}:{environment['PATH']}"
    command = [sys.executable, "-m", "warpgrains", "batch", str(write(tmp_path)), "-o", "out", "--slurm", "1"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300)
    assert "6, 0 of them finished before" in done.stdout, done.stderr
    assert done.returncode == 1
    assert "#SBATCH" in (tmp_path / "job.sh").read_text()
    assert [bool(row["error"]) for row in rows(tmp_path / "out")] == [0, 0, 1, 1, 0, 0]
