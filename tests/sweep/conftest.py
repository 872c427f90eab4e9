"""The small sweep, carried out once for all tests that hold another one against it; and interruptions."""

import pytest
from sweeps import Slices, batch, write


@pytest.fixture
def slices(monkeypatch):
    """Slices of four steps, after each of which the runs are kept."""
    return Slices(monkeypatch)


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
