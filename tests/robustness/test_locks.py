"""Two processes, or two threads, that would write the same: the second is refused and loses nothing."""

import errno
import multiprocessing
import os
import signal
import subprocess
import sys

import pytest
from command import exit_code
from recordings import make_frames, moment, record, recorder_of

from warpgrains import Simulation
from warpgrains.base import locks
from warpgrains.base.errors import OutputError
from warpgrains.base.locks import Lock, RunLocks
from warpgrains.simulation import run as machine
from warpgrains.simulation.checkpoint import read_checkpoint
from warpgrains.usd.recorder import recover


class TestLock:
    @pytest.mark.parametrize("end", [signal.SIGKILL, None])
    def test_is_of_one_process_until_it_ends(self, tmp_path, held_elsewhere, end):
        holder = held_elsewhere(tmp_path / "run.npz")
        with pytest.raises(OutputError, match=f"run.npz' is being written by process {holder.pid} on "):
            Lock(tmp_path / "run.npz")
        holder.stdin.close() if end is None else holder.send_signal(end)
        holder.wait(timeout=60)
        Lock(tmp_path / "run.npz").release()
        assert list(tmp_path.iterdir()) == []

    def test_binds_the_threads_of_its_process_and_no_forked_child(self, tmp_path):
        """A child that lives on, of multiprocessing for one, keeps nobody out and takes nothing away."""
        lock = Lock(tmp_path / "run.npz")
        go_on = multiprocessing.get_context("fork").Event()
        child = multiprocessing.get_context("fork").Process(target=go_on.wait)
        child.start()
        lock.release()
        with Lock(tmp_path / "run.npz"):
            go_on.set()
            child.join()
            assert child.exitcode == 0
            with pytest.raises(OutputError, match=f"is being written by process {os.getpid()} on"):
                Lock(tmp_path / "run.npz")
        assert list(tmp_path.iterdir()) == []

    def test_many_at_once_have_it_one_after_the_other(self, tmp_path):
        """Taken and given back a thousand times by four processes: never by two at once."""
        script = (
            "import os, sys\nfrom pathlib import Path\nfrom warpgrains.base.errors import OutputError\n"
            "from warpgrains.base.locks import Lock\ntaken = 0\nwhile taken < 250:\n"
            "    try: lock = Lock(Path(sys.argv[1]))\n"
            "    except OutputError: continue\n"
            "    os.close(os.open(sys.argv[1], os.O_CREAT | os.O_EXCL))\n"
            "    os.unlink(sys.argv[1])\n    lock.release()\n    taken += 1\n"
        )
        command = [sys.executable, "-c", script, str(tmp_path / "inside")]
        takers = [subprocess.Popen(command) for _ in range(4)]
        assert [taker.wait(timeout=120) for taker in takers] == [0, 0, 0, 0]
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize(
        ("name", "lock"),
        [("flock", lambda path: Lock(path).release()), ("lockf", lambda path: RunLocks(path).acquire([1]))],
    )
    def test_file_system_without_locks(self, tmp_path, monkeypatch, name, lock):
        def refuse(*arguments):
            raise OSError(errno.ENOLCK, "No locks available")

        monkeypatch.setattr(locks, name, refuse)
        with pytest.warns(UserWarning, match="does not support locks"):
            assert lock(tmp_path / "run") in (None, [1])


def test_run_that_went_on_before_the_lock_was_free(tmp_path, monkeypatch):
    """It is continued from where it is now, not from where it was when it was first looked at."""
    kept, reads = tmp_path / "run.npz", []
    Simulation("annulus").run(20, record=tmp_path / "run.usdc", checkpoint=kept)

    def read_while_another_goes_on(path):
        start = read_checkpoint(path)
        reads.append(start.state.steps)
        if len(reads) == 1:
            monkeypatch.setattr(machine, "read_checkpoint", read_checkpoint)
            assert exit_code("run", "--resume", kept, "--steps", 40) == 0
            monkeypatch.setattr(machine, "read_checkpoint", read_while_another_goes_on)
        return start

    monkeypatch.setattr(machine, "read_checkpoint", read_while_another_goes_on)
    assert exit_code("run", "--resume", kept, "--steps", 40) == 0
    assert reads == [20, 40]


def test_recorder(tmp_path):
    with recorder_of(tmp_path / "run.usdc") as recorder:
        recorder.record(moment(*make_frames(1)[0]))
        recorder.flush()
        for write in (lambda: recorder_of(tmp_path / "run.usdc"), lambda: recover(recorder.log)):
            with pytest.raises(OutputError, match="is being written by process"):
                write()
    record(tmp_path / "run.usdc", make_frames(2))
    assert list(tmp_path.iterdir()) == [tmp_path / "run.usdc"]


CLAIM = """
import sys
from pathlib import Path
from warpgrains.base.locks import RunLocks
claims = RunLocks(Path(sys.argv[1]))
print(claims.acquire(range(2, 6)), flush=True)
claims.release([5])
sys.stdin.read()
"""


def test_locks_of_runs_are_of_one_process_until_it_ends(tmp_path):
    command = [sys.executable, "-c", CLAIM, str(tmp_path / "claims")]
    holder = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert holder.stdout.readline() == "[2, 3, 4, 5]\n"
    claims = RunLocks(tmp_path / "claims")
    while claims.acquire([5]) == []:  # it is about to give it back
        pass
    assert claims.acquire([0, 3, 4, 7]) == [0, 7]
    holder.kill()
    holder.wait(timeout=60)
    assert claims.acquire([3, 4]) == [3, 4]
    claims.close()
