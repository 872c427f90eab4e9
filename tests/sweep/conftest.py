"""The small sweep, carried out once for all tests that hold another one against it."""

import pytest
from sweeps import batch, write


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
