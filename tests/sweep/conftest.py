"""The small sweep, carried out once for all tests that hold another one against it; and interruptions."""

import pytest
from sweeps import batch, write

from warpgrains.batch.resident import ResidentSets
from warpgrains.sweep import runner, sizes


class Interrupted(KeyboardInterrupt):
    """What stands for a killed process."""


class Slices:
    """Interrupts the slice after `left` more, as a killed process would be; keeps the steps of those done."""

    def __init__(self):
        self.left, self.steps = 0, []

    def advance(self, sets, steps, *arguments, advance=ResidentSets.advance):
        if self.left == 0:
            raise Interrupted
        self.left -= 1
        self.steps.append(max(steps))
        return advance(sets, steps, *arguments)


@pytest.fixture
def slices(monkeypatch):
    """Slices of equal length, after each of which the runs are kept."""
    slices = Slices()
    monkeypatch.setattr(runner, "BETWEEN_CHECKPOINTS", 0.0)
    monkeypatch.setattr(sizes, "GROWTH", 1)
    monkeypatch.setattr(ResidentSets, "advance", lambda *arguments: slices.advance(*arguments))
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
