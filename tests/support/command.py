"""Calls of the command line within the process of a test, and checks of what it does."""

import resource
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from warpgrains.base import files
from warpgrains.cli.main import main


def exit_code(*arguments: object) -> int:
    try:
        return main([str(argument) for argument in arguments])
    except SystemExit as exit:
        return int(exit.code or 0)


@contextmanager
def small_disk(most: int) -> Iterator[None]:
    """Limit files that this process writes to `most` bytes each in the ``with`` block, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@contextmanager
def dying_in_writing(error: type[BaseException], publication: int, before: bool) -> Iterator[None]:
    """Raise `error` in the ``with`` block, when the file number `publication` is moved to its final name.

    `before` says whether the error comes before or after this move.
    """
    publish, left = files.publish, [publication]

    def die(*arguments: object) -> None:
        left[0] -= 1
        if left[0] == 0 and before:
            raise error
        publish(*arguments)
        if left[0] == 0:
            raise error

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(files, "publish", die)
        yield


def require_refusal(capfd: pytest.CaptureFixture[str], complaint: str = "") -> None:
    """Assert that the command printed only one line: an error message that contains `complaint`."""
    printed = capfd.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("warpgrains: error: "), printed.err
    assert printed.err.count("\n") == 1, printed.err
    assert complaint in printed.err
