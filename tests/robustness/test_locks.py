"""Two processes, or two threads, that would write the same: the second is refused and loses nothing."""

import errno
import multiprocessing
import os
import signal
import subprocess
import sys

import pytest
from command import exit_code, require_refusal
from recordings import make_frames, moment, record, recorder_of

from warpgrains import InputError, locks
from warpgrains.cli.grade import write_template
from warpgrains.errors import OutputError
from warpgrains.locks import Lock, RunLocks
from warpgrains.simulation.checkpoint import read_checkpoint
from warpgrains.usd.recorder import log_of, recover


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

    def test_binds_the_threads_of_its_own_process(self, tmp_path):
        with Lock(tmp_path / "run.npz"), pytest.raises(OutputError, match=f"by process {os.getpid()} on"):
            Lock(tmp_path / "run.npz")
        Lock(tmp_path / "run.npz").release()
        assert list(tmp_path.iterdir()) == []

    def test_is_not_that_of_a_forked_child(self, tmp_path):
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
            with pytest.raises(OutputError, match="is being written"):
                Lock(tmp_path / "run.npz")

    def test_many_at_once_have_it_one_after_the_other(self, tmp_path):
        """Taken and given back a thousand times by four processes: never by two at once."""
        script = (
            "import os, sys\nfrom pathlib import Path\nfrom warpgrains.errors import OutputError\n"
            "from warpgrains.locks import Lock\ntaken = 0\nwhile taken < 250:\n"
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


@pytest.fixture
def kept(tmp_path, stop_at):
    """The checkpoint of a run of 40 steps, with a recording, that was interrupted after 20."""
    stop_at(20)
    options = ["--every", 10, "--checkpoint", tmp_path / "run.npz", "-o", tmp_path / "run.usdc"]
    assert exit_code("run", "annulus", "--steps", 40, *options) == 130
    return tmp_path / "run.npz"


def contents_of(folder):
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.suffix != ".lock")
    return {path: path.read_bytes() for path in files}


class TestRun:
    @pytest.mark.parametrize(
        ("words", "locked"),
        [
            ("run --resume {home}/run.npz", "run.npz"),
            ("run --resume {home}/run.npz", "run.usdc"),
            ("run annulus -o {}", "run.usdc"),
            ("run annulus -o {}", "run.mp4"),
            ("run annulus -o {}", "run.png"),
            ("run annulus --measure stress --series {}", "run.csv"),
            ("plot {home}/done.usdc -o {}", "run.mp4"),
            ("plot {home}/done.usdc -o {}", "run.png"),
            ("run annulus --checkpoint {}", "run.npz"),
            ("export {home}/done.usdc -o {}", "run.pvd"),
            ("report annulus -o {home}", "report.md"),
            ("grade {home}/homework.c --html {home}", "index.html"),
        ],
    )
    def test_second_writer_is_refused(self, kept, tmp_path, held_elsewhere, capfd, words, locked):
        """And changes nothing."""
        record(tmp_path / "done.usdc", make_frames(1))
        write_template(tmp_path)
        before = contents_of(tmp_path)
        held_elsewhere(tmp_path / locked)
        capfd.readouterr()
        assert exit_code(*words.format(tmp_path / locked, home=tmp_path).split()) == 2
        require_refusal(capfd, f"{locked}' is being written by process")
        assert contents_of(tmp_path) == before

    def test_run_that_went_on_before_the_lock_was_free(self, kept, monkeypatch):
        """It is continued from where it is now, not from where it was when it was first looked at."""
        from warpgrains.cli import run as command

        reads = []

        def read_while_another_goes_on(path):
            start = read_checkpoint(path)
            reads.append(start.state.steps)
            if len(reads) == 1:
                monkeypatch.setattr(command, "read_checkpoint", read_checkpoint)
                assert exit_code("run", "--resume", kept) == 0
                monkeypatch.setattr(command, "read_checkpoint", read_while_another_goes_on)
            return start

        monkeypatch.setattr(command, "read_checkpoint", read_while_another_goes_on)
        assert exit_code("run", "--resume", kept) == 0
        assert reads == [20, 40]


class TestPython:
    def test_recorder(self, tmp_path):
        with recorder_of(tmp_path / "run.usdc") as recorder:
            recorder.record(moment(*make_frames(1)[0]))
            with pytest.raises(OutputError, match="is being written by process"):
                recorder_of(tmp_path / "run.usdc")
            recorder.flush()
            with pytest.raises(OutputError, match="is being written by process"):
                recover(recorder.log)
        record(tmp_path / "run.usdc", make_frames(2))
        assert list(tmp_path.iterdir()) == [tmp_path / "run.usdc"]

    def test_failed_beginning_leaves_no_lock(self, tmp_path):
        log_of(tmp_path / "run.usdc").touch()
        for _ in range(2):
            with pytest.raises(InputError, match="holds frames of another run"):
                recorder_of(tmp_path / "run.usdc")


CLAIM = """
import sys
from pathlib import Path
from warpgrains.locks import RunLocks
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
