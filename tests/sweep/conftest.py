"""The small sweep, carried out once for all tests that hold another one against it."""

import pytest
from sweeps import batch, write


def small_sweep(folder, *options):
    """Carry it out without any interruption, in a folder with files of others."""
    for name in ("scenes/mine.toml", "parts/mine.csv"):
        (folder / "out" / name).parent.mkdir(parents=True)
        (folder / "out" / name).touch()
    assert batch(write(folder), "-o", folder / "out", *options) == 1
    return folder / "out"


@pytest.fixture(scope="session")
def done(tmp_path_factory):
    return small_sweep(tmp_path_factory.mktemp("done"))


@pytest.fixture(scope="session")
def kept(tmp_path_factory):
    """The same, with a folder for each run."""
    return small_sweep(tmp_path_factory.mktemp("kept"), "--folders")


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """The same, with a recording of each run."""
    return small_sweep(tmp_path_factory.mktemp("recorded"), "--usd")


@pytest.fixture
def meanwhile(monkeypatch):
    """Have another process act once, before or after a call of a function with these arguments."""

    def patch(owner, name, act, before=False, when=lambda *given: True):
        call, to_do = getattr(owner, name), [act]

        def call_as_another_acts(*given):
            if before and to_do and when(*given):
                to_do.pop()()
            found = call(*given)
            if to_do and when(*given):
                to_do.pop()()
            return found

        monkeypatch.setattr(owner, name, call_as_another_acts)

    return patch
