"""The small sweep, carried out once for all tests that hold another one against it; and interruptions."""

import pytest
from sweeps import batch, write

from warpgrains.batch.batch import Batch
from warpgrains.sweep import runner


class Interrupted(KeyboardInterrupt):
    """What stands for a killed process."""


class Slices:
    """Interrupts the slice after `left` more, as a killed process would be; keeps the steps of those done."""

    def __init__(self):
        self.left, self.steps = 0, []

    def run(self, batch, steps, run=Batch.run):
        if self.left == 0:
            raise Interrupted
        self.left -= 1
        self.steps.append(max(steps))
        return run(batch, steps)


@pytest.fixture
def slices(monkeypatch):
    """Slices of equal length, after each of which the runs are kept."""
    slices = Slices()
    monkeypatch.setattr(runner, "BETWEEN_CHECKPOINTS", 0.0)
    monkeypatch.setattr(runner, "GROWTH", 1)
    monkeypatch.setattr(Batch, "run", lambda batch, steps: slices.run(batch, steps))
    return slices


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
