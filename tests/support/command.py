"""The command line, as tests call it in their own process."""

import pytest

from warpgrains.cli.main import main


def exit_code(*arguments: object) -> int:
    """Run a command and return its exit code."""
    try:
        return main([str(argument) for argument in arguments])
    except SystemExit as exit:
        return int(exit.code or 0)


def require_refusal(capfd: pytest.CaptureFixture[str], complaint: str = "") -> None:
    """Check that the command printed one line, of what is wrong."""
    printed = capfd.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("warpgrains: error: "), printed.err
    assert printed.err.count("\n") == 1, printed.err
    assert complaint in printed.err
