"""The small sweep, carried out once for all tests that hold another one against it; and interruptions."""

import pytest
from sweeps import Interrupted, batch, write

from warpgrains.solver import engine, threads
from warpgrains.sweep import group
from warpgrains.sweep.group import Group


@pytest.fixture
def brief(monkeypatch):
    """Groups of runs without folders end after some steps; if `is_killed`, the process is killed then."""
    advance, clock = Group.advance, [0.0]

    def advance_briefly(group, seconds, on_progress):
        has_folders = any(one.folder is not None for one in group.members)
        if has_folders and advance_briefly.is_killed:
            raise Interrupted

        def end_after_a_step(fraction):
            on_progress(fraction)
            clock[0] += 100.0 if fraction > 0.0 and not has_folders else 0.0

        advance(group, seconds, end_after_a_step)

    advance_briefly.is_killed = False
    monkeypatch.setattr(Group, "advance", advance_briefly)
    monkeypatch.setattr(group, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(engine, "BRIEF", 0)
    monkeypatch.setattr(threads, "GLANCE", 1e-3)  # before the runs are over, on any machine
    return advance_briefly


@pytest.fixture(scope="session")
def done(tmp_path_factory):
    """The small sweep, carried out without any interruption."""
    folder = tmp_path_factory.mktemp("done")
    assert batch(write(folder), "-o", folder / "out") == 1
    return folder / "out"


@pytest.fixture(scope="session")
def kept(tmp_path_factory):
    """The same, with a folder for each run."""
    folder = tmp_path_factory.mktemp("kept")
    assert batch(write(folder), "-o", folder / "out", "--folders") == 1
    return folder / "out"
